"""How well are tags and colours seen? Errors and time of the scene estimator, beside plain IPPE for tags.

    python -m benchmarks.perception --trials 100
    python -m benchmarks.perception --distances 0.6 --bias 0.01 --json perception.json
    python -m benchmarks.perception --colors --distances 0.6 1.0 1.3
    python -m benchmarks.perception --tilted --distances 0.9 1.4 --trials 5
    python -m benchmarks.perception --shapes --distances 0.6 1.0 1.4
    python -m benchmarks.perception --touching --distances 0.6 1.0
    python -m benchmarks.perception --corners --distances 0.3 0.6 1.0 1.3 --blur 0.6

A 40 mm cube with a 32 mm tag stands at each distance, turned and tilted at random by up to 50 degrees; grey and depth
are as noisy as a RealSense's at 640 x 480, depth alike over 4 px. The peer is what most tag libraries do: OpenCV's
detector with sub-pixel corners, then the better of the two poses of IPPE; the row between is ours on colour alone.
Errors are those of the tag, median and 95 %; `flips` counts rotations off by more than 15 degrees; the time is that of
a frame, detection included.

With --colors, each object of `etc/objects` stands on a table in rendered frames of cameras all around it, turned by
up to 45 degrees, and is recognised by its colour: errors of its centre and, where its shape tells that, of its yaw, in
the fourth frame of a camera that stands still, median and 95 %.

With --tilted, it is turned in the air by 0.1 rad a frame about a random horizontal axis, up to 135 degrees, as often as
--trials says, and followed: errors of its centre and of the direction of its own z axis, over the frames in which that
is told.

With --shapes, boxes and cylinders without tags are found by depth (benchmarks/blocks.py): errors of centre, extents and
yaw, counts of wrong shapes, CPU time, and the smallest rectangle around the points for comparison.

With --touching, two blocks touch from the beginning, of one colour or two (benchmarks/touching.py): how many are found
surely, how many of those are wrong, and errors, beside taking each piece of one colour for one block.

With --corners, errors of the corners of tags (benchmarks/corners.py), beside two of OpenCV's detectors.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table

from agents.object_models import model_files
from agents.scene_estimator.color_reader import ColorReader
from agents.scene_estimator.detection import tag_corners
from agents.scene_estimator.pose import NoiseModel
from agents.scene_estimator.sighting import FrameSource
from agents.scene_estimator.turning import nearest_alike, order
from benchmarks.blocks import shape_rows, shape_table
from benchmarks.color_scene import ColorScene, looking_at
from benchmarks.corners import corner_rows, corner_table
from benchmarks.options import whole_number
from benchmarks.tag_camera import DICTIONARY, Camera, facing
from benchmarks.touching import pair_rows, pair_table
from dsr.clock import WALL_CLOCK
from dsr.images.blobs import Frame
from dsr.math3d.transforms import Pose
from dsr.vocabulary.intrinsics import Intrinsics
from dsr.vocabulary.tags import TAG_RATIO

SIZE = 0.04
MARKER = 5
STEEPEST = np.radians(50)
FLIP = np.radians(15)
CUBE_FROM_TAG = Pose((0.0, 0.0, SIZE / 2))

Method = Callable[[Frame], Pose | None]
"""camera_from_tag of the only tag in a frame; None if it is not found."""
ColorTrial = Callable[[ColorScene, str, float, np.random.Generator], list["Result"]]
"""What was made of each frame of an object (its model) at a distance, m."""
_LOOKS = 4  # frames from one place
_HIGH = (0.35, 0.02, 0.25)  # m, in the air, where nothing is in the way


class Result(NamedTuple):
    """What one method made of one frame."""

    found: bool
    translation: float
    """m, error"""
    rotation: float
    """rad, error"""
    seconds: float


def main() -> None:
    """Measure what the command line asks for and print a row for each distance and method."""
    options = _parser().parse_args()
    if options.shapes:
        blocks = list(shape_rows(options.distances, options.trials, options.seed))
        Console().print(shape_table(blocks))
        _write(blocks, options)
        return
    if options.touching:
        pairs = list(pair_rows(options.distances, options.trials, options.seed))
        Console().print(pair_table(pairs))
        _write(pairs, options)
        return
    if options.corners:
        corners = list(corner_rows(options.distances, options.trials, options.seed, options.blur))
        Console().print(corner_table(corners))
        _write(corners, options)
        return
    if options.colors or options.tilted:
        trial = _turning if options.tilted else _standing
        rows = [row for model in sorted(model_files()) for row in _rows(model, trial, options)]
        what = (
            "Centre and own z axis of an object followed"
            if options.tilted
            else "Centre and yaw of an object recognised"
        )
        Console().print(_table(rows, f"{what} by its colour: median / 95 %"))
        _write(rows, options)
        return
    methods = {"ours": ours(), "colour": ours(depth=False), "IPPE": plain_ippe()}
    rows = []
    for distance in options.distances:
        results = _measure(methods, distance, options)
        rows += [_row(distance, name, results[name]) for name in methods]
    Console().print(_table(rows, "Pose of a 32 mm tag: median / 95 %"))
    _write(rows, options)


def _write(rows: list[dict[str, Any]], options: argparse.Namespace) -> None:
    if options.json:
        asked = {"trials": options.trials, "seed": options.seed, "bias_m": options.bias}
        options.json.write_text(json.dumps({**asked, "rows": rows}, indent=1), encoding="utf-8")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "python -m benchmarks.perception",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--trials", type=whole_number(1), default=50, help="frames at each distance (default: 50)")
    parser.add_argument("--seed", type=int, default=0, help="of poses and noise (default: 0)")
    parser.add_argument(
        "--distances", type=float, nargs="+", default=[0.3, 0.6, 1.0], metavar="M", help="m (default: 0.3 0.6 1.0)"
    )
    parser.add_argument(
        "--bias", type=float, default=0.0, metavar="M", help="m, by which all depths are too small (default: 0)"
    )
    parser.add_argument("--colors", action="store_true", help="objects recognised by their colour instead of tags")
    parser.add_argument("--tilted", action="store_true", help="the same, tilted in the air")
    parser.add_argument("--shapes", action="store_true", help="boxes and cylinders found by depth")
    parser.add_argument("--touching", action="store_true", help="pairs of boxes that touch, found by depth")
    parser.add_argument("--corners", action="store_true", help="errors of the corners of tags")
    parser.add_argument(
        "--blur", type=_not_negative, default=0.0, metavar="PX", help="standard deviation of their blur (0)"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the rows to this file, in SI units")
    return parser


def _not_negative(text: str) -> float:
    number = float(text)
    if not 0.0 <= number < float("inf"):
        raise argparse.ArgumentTypeError(f"{text}: expected 0 or more")
    return number


def ours(*, depth: bool = True) -> Method:
    """The scene estimator's way, as the agent calls it; or without the depth image."""
    reader = FrameSource(lambda _: (SIZE, SIZE, SIZE), TAG_RATIO, NoiseModel())

    def see(frame: Frame) -> Pose | None:
        seen = frame if depth else Frame(frame.stamp, {"color": frame.arrays["color"]}, frame.meta)
        sightings, _ = reader.read(seen)
        return sightings[0].pose @ CUBE_FROM_TAG if sightings else None

    return see


def plain_ippe() -> Method:
    """Sub-pixel corners and the IPPE pose that fits them better."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector = cv2.aruco.ArucoDetector(DICTIONARY, parameters)
    square = tag_corners(SIZE * TAG_RATIO)

    def see(frame: Frame) -> Pose | None:
        quads, _, _ = detector.detectMarkers(cv2.cvtColor(frame.arrays["color"], cv2.COLOR_RGB2GRAY))
        if len(quads) == 0:
            return None
        corners = np.asarray(quads[0], dtype=np.float64).reshape(4, 2)
        matrix = Intrinsics.from_meta(frame.meta, frame.arrays["color"].shape[:2]).matrix
        _, rotation, translation = cv2.solvePnP(square, corners, matrix, None, flags=cv2.SOLVEPNP_IPPE_SQUARE)
        return Pose.from_rotvec(translation.ravel(), rotation.ravel())

    return see


def _measure(methods: dict[str, Method], distance: float, options: argparse.Namespace) -> dict[str, list[Result]]:
    results: dict[str, list[Result]] = {name: [] for name in methods}
    for pose, frame in track(
        _frames(distance, options), f"{distance} m", options.trials, console=Console(stderr=True), transient=True
    ):
        for name, method in methods.items():
            results[name].append(_judged(method, frame, pose))
    return results


def _frames(distance: float, options: argparse.Namespace) -> Iterator[tuple[Pose, Frame]]:
    """(camera_from_tag, frame) of every trial."""
    camera, rng = Camera(), np.random.default_rng([options.seed, round(distance * 1000)])
    for _ in range(options.trials):
        camera_from_cube = facing(distance, rng.uniform(0.0, STEEPEST), rng)
        yield camera_from_cube @ CUBE_FROM_TAG, camera.frame({MARKER: camera_from_cube}, rng, bias=options.bias)


def _rows(model: str, trial: ColorTrial, options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """A row for each distance."""
    rng = np.random.default_rng(options.seed)
    scene = ColorScene([model], rng)
    for distance in track(options.distances, model, console=Console(stderr=True), transient=True):
        trials = [trial(scene, model, distance, rng) for _ in range(options.trials)]
        yield _row(distance, model, list(chain.from_iterable(trials)))
    scene.close()


def _standing(scene: ColorScene, model: str, distance: float, rng: np.random.Generator) -> list[Result]:
    """The fourth frame of the object on the table; the rotation is its yaw, up to its symmetry, if that is told."""
    x, y, yaw = rng.uniform((0.25, -0.1, -np.pi / 4), (0.45, 0.1, np.pi / 4))
    truth = Pose.from_rotvec((x, y, scene.height(model)), (0.0, 0.0, yaw))
    scene.put(model, truth)
    camera = looking_at(truth.t, distance, rng)
    reader = ColorReader(NoiseModel())
    for _ in range(_LOOKS - 1):
        reader.read(scene.frame(camera), scene.known, camera)
    frame = scene.frame(camera)
    begun = WALL_CLOCK.monotonic()
    found = reader.read(frame, scene.known, camera)
    seconds = WALL_CLOCK.monotonic() - begun
    if not found:
        return [Result(False, np.nan, np.nan, seconds)]
    (one, *_), (made, *_) = found, scene.known
    off = float(np.linalg.norm(one.position - camera.inverse().apply(truth.t)))
    apart = abs(nearest_alike(one.yaw, yaw, order(made.shape, made.size)) - yaw)
    return [Result(True, off, apart if np.isfinite(one.yaw_sigma) else np.nan, seconds)]


def _turning(scene: ColorScene, model: str, distance: float, rng: np.random.Generator) -> list[Result]:
    """The frames of the object as it is turned in the air."""
    reader, azimuth, yaw = ColorReader(NoiseModel()), rng.uniform(0.0, 2.0 * np.pi), rng.uniform(-0.1, 0.1)
    camera, results = looking_at(_HIGH, distance, rng), []
    for tilt in (0.0, 0.0, *np.arange(0.0, np.radians(135.0), 0.1)):
        leaning = Pose.from_rotvec(_HIGH, (tilt * np.cos(azimuth), tilt * np.sin(azimuth), 0.0))
        truth = leaning @ Pose.from_rotvec((0.0, 0.0, 0.0), (0.0, 0.0, yaw))
        scene.put(model, truth)
        results.append(_followed(reader, scene, camera, truth))
    return results


def _followed(reader: ColorReader, scene: ColorScene, camera: Pose, truth: Pose) -> Result:
    frame = scene.frame(camera)
    begun = WALL_CLOCK.monotonic()
    found = [one for one in reader.read(frame, scene.known, camera) if one.lean is not None]
    seconds = WALL_CLOCK.monotonic() - begun
    if not found or found[0].lean is None:
        return Result(False, np.nan, np.nan, seconds)
    up = Pose((0.0, 0.0, 0.0), found[0].lean).rotation_matrix[:, 2]
    angle = float(np.arccos(np.clip(up @ truth.rotation_matrix[:, 2], -1.0, 1.0)))
    return Result(True, float(np.linalg.norm(camera.apply(found[0].position) - truth.t)), angle, seconds)


def _judged(method: Method, frame: Frame, truth: Pose) -> Result:
    begun = WALL_CLOCK.monotonic()
    pose = method(frame)
    seconds = WALL_CLOCK.monotonic() - begun
    translation, rotation = (np.nan, np.nan) if pose is None else pose.distance(truth)
    return Result(pose is not None, translation, rotation, seconds)


def _row(distance: float, method: str, results: list[Result]) -> dict[str, Any]:
    """In SI units; None where nothing was found."""
    found = np.array([result[1:3] for result in results if result.found]).reshape(-1, 2)
    return {
        "distance_m": distance,
        "method": method,
        "found": len(found),
        "trials": len(results),
        **_quantiles("translation", "m", found[:, 0]),
        **_quantiles("rotation", "rad", found[:, 1]),
        "flips": int((found[:, 1] > FLIP).sum()),
        "median_time_s": float(np.median([result.seconds for result in results])),
    }


def _quantiles(name: str, unit: str, errors: NDArray[np.float64]) -> dict[str, float | None]:
    errors = errors[~np.isnan(errors)]
    return {
        f"{name}_{label}_{unit}": float(np.quantile(errors, share)) if len(errors) else None
        for label, share in (("median", 0.5), ("p95", 0.95))
    }


def _table(rows: list[dict[str, Any]], title: str) -> Table:
    table = Table(title=title, caption="ms: median time of a frame")
    for heading in ("distance", "method", "found", "transl. mm", "rotation deg", "flips", "ms"):
        table.add_column(heading, justify="left" if heading == "method" else "right")
    for row in rows:
        millimetres = _pair(row, "translation", "m", 1e3)
        degrees = _pair(row, "rotation", "rad", 180 / np.pi)
        found, time = f"{row['found']}/{row['trials']}", f"{row['median_time_s'] * 1e3:.1f}"
        table.add_row(
            f"{row['distance_m']} m", row["method"], found, millimetres, degrees, str(row["flips"]), time,
            end_section=row["method"] == "IPPE",
        )  # fmt: skip
    return table


def _pair(row: dict[str, Any], name: str, unit: str, factor: float) -> str:
    values = [row[f"{name}_{label}_{unit}"] for label in ("median", "p95")]
    return " / ".join("-" if value is None else f"{value * factor:.2f}" for value in values)


if __name__ == "__main__":
    main()
