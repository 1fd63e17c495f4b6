"""Hand-eye calibration on a circle grid, ours beside OpenCV's: views are held out, and predicted from the robot's pose.

The grid is found once, for all methods. Each method gets the same views; OpenCV's also the intrinsics that its
`calibrateCamera` finds from these, or those that come with the recording.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from agents.calibrator.hand_eye.calibrate import Setting, observed, solve
from agents.calibrator.hand_eye.observations import Observations
from agents.calibrator.hand_eye.reading import ToldHands, read_images
from agents.calibrator.hand_eye.start import find_start, target_poses
from agents.calibrator.hand_eye.targets import read_target
from benchmarks.peers.opencv_hand_eye import OpenCv
from benchmarks.real.drawing import draw_points
from benchmarks.real.held_out import Mount, errors, predicted, table_of
from benchmarks.real.recordings import DataError, Outcome, RealBenchmark, needed
from dsr.math3d.transforms import Array, Pose
from dsr.vocabulary.distortion import Distortion
from dsr.vocabulary.intrinsics import Intrinsics

_NUMBER = re.compile(r"^\s*(\w+):\s*(-?[\d.]+(?:e-?\d+)?)\b", re.MULTILINE)
_PAIR = re.compile(r"pose:\s*(\S+)\s+image:\s*(\S+)")


_HELD, _ROUNDS = 3, 2
"""Views that are held out at a time, and how often each is"""
_SEED = 0
"""Of the views' order"""


def run(folder: Path) -> Outcome:
    """Predict views that were held out, by each method."""
    views, given, images = _read(folder)
    remarks = [f"The grid is found in {len(views)} of {images} images.", "mm: distances from rays, at the target."]
    try:
        peer = OpenCv(Path(sys.prefix) / "opencv4")
    except OSError as error:
        remarks.append(f"OpenCV's methods are left out: {error}.")
        peer = None
    found: dict[str, list[Array]] = {}
    for fitted, held in _splits(len(views)):
        train, test = views.subset(fitted), views.subset(held)
        for method, mount in _mounts(train, given, peer):
            found.setdefault(method, []).append(errors(mount, test))
    splits = max(map(len, found.values()))
    for method, parts in found.items():
        if len(parts) < splits:
            remarks.append(f"{method} fails in {splits - len(parts)} of {splits} splits, which do not count.")
    table, figures = table_of(found)
    return Outcome(table, remarks, {"views": len(views), "images": images, "methods": figures})


def draw(folder: Path) -> Iterator[tuple[str, NDArray[np.uint8]]]:
    """Each image with the points that were found, and where our calibration of all views and the robot put them."""
    views, _, _ = _read(folder)
    mount = Mount.of(solve(views, None, Setting(lens="plumb_bob")).fitted.parameters)
    for name, found, expected in zip(views.names, views.pixels, predicted(mount, views), strict=True):
        picture = np.asarray(cv2.imread(str(folder / name)), np.uint8)
        draw_points(picture, found, expected)
        yield Path(name).name, picture


def _mounts(train: Observations, given: Intrinsics, peer: OpenCv | None) -> Iterator[tuple[str, Mount]]:
    """What each method makes of the same views."""
    setting = Setting(lens="plumb_bob")
    yield "ours, lens fitted", Mount.of(solve(train, None, setting).fitted.parameters)
    yield "ours, lens given", Mount.of(solve(train, given, Setting()).fitted.parameters)
    start = find_start(train, given, 0)
    yield "ours, closed form", Mount(start.mount, start.target, given)
    if peer is None:
        return
    ordered = train.reordered(start.orders)
    calibrated = _calibrated(ordered)
    for name, lens in (("fitted", calibrated), ("given", given)):
        targets = _refined(ordered, lens)
        for method, (camera, target) in peer.mounts(ordered.hands, targets).items():
            yield f"OpenCV {method.capitalize()}, lens {name}", Mount(camera, target, lens)


def _refined(views: Observations, lens: Intrinsics) -> Array:
    """(v, 4, 4) camera_from_target of least squares, by OpenCV from its own closed form on."""
    found = []
    for poses, pixels, seen in zip(target_poses(views, lens), views.pixels, views.seen, strict=True):
        rays = np.ascontiguousarray(lens.rays(pixels[seen])[:, :2])
        start = np.ascontiguousarray(poses[0])
        turn, shift = cv2.Rodrigues(np.ascontiguousarray(start[:3, :3]))[0], start[:3, 3:].copy()
        points = np.ascontiguousarray(views.points[seen])
        flag = cv2.SOLVEPNP_ITERATIVE
        _, turn, shift = cv2.solvePnP(points, rays, np.eye(3), None, turn, shift, useExtrinsicGuess=True, flags=flag)
        found.append(Pose.from_rotvec(np.ravel(shift), np.ravel(turn)).matrix)
    return np.array(found)


def _calibrated(views: Observations) -> Intrinsics:
    """Intrinsics by OpenCV's `calibrateCamera`, with five coefficients."""
    points = [views.points[seen].astype(np.float32) for seen in views.seen]
    pixels = [view[seen].astype(np.float32) for view, seen in zip(views.pixels, views.seen, strict=True)]
    _, matrix, coefficients, *_ = cv2.calibrateCamera(points, pixels, views.size, np.eye(3), np.zeros(5))
    (fx, _, cx), (_, fy, cy), _ = matrix.tolist()
    lens = Distortion("plumb_bob", tuple(float(value) for value in np.ravel(coefficients)[:5]))
    return Intrinsics(fx, fy, cx, cy, *views.size, lens)


def _splits(count: int) -> Iterator[tuple[list[int], list[int]]]:
    """Views to fit to and views to predict: each is predicted once a round."""
    rng = np.random.default_rng(_SEED)
    for _ in range(_ROUNDS):
        order = rng.permutation(count)
        for first in range(0, count, _HELD):
            held = order[first : first + _HELD].tolist()
            yield [one for one in range(count) if one not in held], held


def _read(data: Path) -> tuple[Observations, Intrinsics, int]:
    needed(data, "cal_data.yaml", "target.yaml", "camera_intr_calibrated.yaml")
    pairs = _PAIR.findall(_text(data / "cal_data.yaml"))
    told = _numbers(data / "target.yaml")
    lens = _numbers(data / "camera_intr_calibrated.yaml")
    target = read_target(f"circles:{told['cols']:.0f}x{told['rows']:.0f}:{told['spacing']}")
    images = read_images([data / image for _, image in pairs])
    poses = []
    for pose, _ in pairs:
        n = _numbers(data / pose)
        poses.append(Pose((n["x"], n["y"], n["z"]), (n["qx"], n["qy"], n["qz"], n["qw"])).matrix)
    found = [target.find(image) for image in images]
    rows = [index for index, points in enumerate(found) if points is not None]
    height, width = images[0].shape
    names = [pairs[index][1] for index in rows]
    pixels = np.array([found[index] for index in rows])
    views = observed(names, ToldHands((), np.array(poses)[rows], None), pixels, target, (width, height), Setting())
    given = msgspec.convert(lens | {"width": width, "height": height}, Intrinsics, strict=False)
    return views, given, len(images)


def _numbers(file: Path) -> dict[str, float]:
    """All lines `name: number` of a file in YAML."""
    return {name: float(value) for name, value in _NUMBER.findall(_text(file))}


def _text(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"{file} cannot be read") from error


BENCHMARK = RealBenchmark(
    "hand-eye",
    f"""Hand-eye calibration on images of a circle grid, beside OpenCV's methods.

The pixels of {_HELD} views at a time are predicted from the robot's poses, by a mount fitted to the others.""",
    "Published under Apache-2.0: GitHub Jmeyer1292/robot_cal_tools (2089a06), example data.\n"
    "Needed: cal_data.yaml, target.yaml, camera_intr_calibrated.yaml, images and poses. OpenCV 4 is fetched, once.",
    run,
    draw,
)
