"""How well are hands seen? Errors of palms and fingertips of each source, on hands that the plant renders.

    python -m benchmarks.hands --trials 5
    python -m benchmarks.hands --json hands.json

Each trial: two hands come from random sides without crossing, one grasps a cube and carries it, the other lays two
fingertips on a box and drags it; an overhead camera at 0.65 m with the errors of a RealSense at 640 x 480 sees them
ten times a second. `poses` are the plant's landmarks with noise instead of images, `skin colour` goes without a model,
`mediapipe` is the model that `dsr hands fetch` got, or that `--model` names. Errors are those after tracking and
smoothing, in the world, median and 95 %: of the palm's centre, of fingertips by name, and of fingertips from the
nearest true one (colour does not tell which finger is which). `tips` is how many of those in view were seen; `false`
how many are more than 25 mm from any true one; `ms` the median time of a frame.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table

from agents.hand_tracker.agent import in_world, read_sensor
from agents.hand_tracker.config import HandTrackerConfig
from agents.hand_tracker.landmarker import ModelFinder
from agents.hand_tracker.model.loading import load_landmarker, wants_model
from agents.hand_tracker.sighting import PALM, TIPS, Finder, SeenHand, Source
from agents.hand_tracker.skin import SkinFinder
from agents.hand_tracker.tracks import Tracks
from agents.plant.config import PlantConfig
from agents.plant.hand_sensor import landmarks_in_view
from agents.plant.reality import Reality
from agents.plant.world import RATE_HZ, STEP
from agents.scenario.format.scenario import Event, HandEnter, HandGraspEvent, HandMove, ObjectSpec, Scenario
from dsr.clock import WALL_CLOCK
from dsr.images.blobs import Frame
from dsr.math3d.transforms import Pose

SECONDS = 8.0
CAMERA_EVERY = RATE_HZ // 10
FALSE = 0.025
"""m from any true fingertip, beyond which one is not real"""
Array = NDArray[np.float64]
Look = Callable[[Reality, Frame | None, float], list[SeenHand]]
"""The hands in the camera's frame at a time, seen in a picture if the source needs one."""


class Sample(NamedTuple):
    """One tracker's state beside the truth, at one frame."""

    palms: list[float]
    """m, errors"""
    named: list[float]
    """m, errors of fingertips by name"""
    nearest: list[float]
    """m, from the nearest true fingertip"""
    visible: int
    """True fingertips in view."""
    seconds: float


def main() -> None:
    """Measure what the command line asks for and print a row for each source."""
    options = _parser().parse_args()
    config = HandTrackerConfig(model=options.model)
    results: dict[str, list[Sample]] = {}
    trials = range(options.seed, options.seed + options.trials)
    for seed in track(trials, "trials", console=Console(stderr=True), transient=True):
        for source, samples in _measure(seed, config).items():
            results.setdefault(source, []).extend(samples)
    rows = [_row(source, samples) for source, samples in results.items()]
    Console().print(_table(rows))
    if options.json:
        asked = {"trials": options.trials, "seed": options.seed}
        options.json.write_text(json.dumps({**asked, "rows": rows}, indent=1), encoding="utf-8")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "python -m benchmarks.hands", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--trials", type=int, default=5, help="runs of 8 s (default: 5)")
    parser.add_argument("--seed", type=int, default=0, help="of the first trial (default: 0)")
    parser.add_argument("--model", default="", metavar="FILE", help="of hands; default: the fetched one")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the rows to this file, in SI units")
    return parser


def _measure(seed: int, config: HandTrackerConfig) -> dict[str, list[Sample]]:
    with closing(Reality(_scenario(seed), PlantConfig(sensor="pixels"), seed)) as reality:
        finders: list[Finder] = [SkinFinder(config)]
        if wants_model(config):
            finders.append(ModelFinder(config, load_landmarker(config)()))
        looks: dict[Source, Look] = {"poses": _poses}
        looks.update((finder.source, _pixels(finder)) for finder in finders)
        tracks = {source: Tracks(config) for source in looks}
        samples: dict[str, list[Sample]] = {source: [] for source in looks}
        for stamp in _play(reality):
            for source, look in looks.items():
                if not reality.hands.present:
                    continue
                frame = reality.frame(stamp) if source != "poses" else None
                begun = WALL_CLOCK.monotonic()
                hands = [in_world(hand, reality.camera.pose, stamp) for hand in look(reality, frame, stamp)]
                tracks[source].update(hands, source, stamp)
                seconds = WALL_CLOCK.monotonic() - begun
                samples[source].append(_sample(reality, tracks[source], stamp, seconds))
        return samples


def _scenario(seed: int) -> Scenario:
    rng = np.random.default_rng(seed)
    sides = [(float(np.cos(angle)), float(np.sin(angle))) for angle in (rng.uniform(0.0, 0.9), rng.uniform(-0.9, 0.0))]
    (x0, y0), (x1, y1) = rng.uniform((0.25, 0.05), (0.40, 0.12)), rng.uniform((0.25, -0.12), (0.40, -0.05))
    objects = [
        ObjectSpec(name="cube", marker_id=3, position=(float(x0), float(y0), 0.02)),
        ObjectSpec(name="box", type="box", marker_id=4, size=(0.06, 0.06, 0.08), position=(float(x1), float(y1), 0.04)),
    ]
    events: list[Event] = [
        HandEnter(at=0.1, hand=0, position=(0.48, 0.12, 0.10), side=sides[0]),
        HandGraspEvent(at=1.5, hand=0, object="cube", side=sides[0]),
        HandMove(at=4.0, hand=0, by=(-0.03, 0.02, 0.08), turn=float(rng.uniform(-0.4, 0.4))),
        HandGraspEvent(at=0.5, hand=1, object="box", style="touch", side=sides[1]),
        HandMove(at=5.0, hand=1, by=(0.04, -0.02, 0.0), speed=0.1),
    ]
    return Scenario(name="hands", title="", duration=SECONDS, objects=objects, events=events)


def _play(reality: Reality) -> Iterator[float]:
    """Times (s) at which the camera exposes."""
    for step in range(round(SECONDS * RATE_HZ)):
        reality.step(step * STEP)
        if (step + 1) % CAMERA_EVERY == 0:
            yield (step + 1) * STEP


def _poses(reality: Reality, frame: Frame | None, stamp: float) -> list[SeenHand]:
    readings = reality.hand_readings(stamp)
    return [] if readings is None else read_sensor(readings)


def _pixels(finder: Finder) -> Look:
    def look(reality: Reality, frame: Frame | None, stamp: float) -> list[SeenHand]:
        assert frame is not None
        world_from_camera = reality.camera.pose
        height = np.array([*world_from_camera.rotation_matrix[2], world_from_camera.t[2]])
        return finder.find(frame, height)

    return look


def _sample(reality: Reality, tracks: Tracks, stamp: float, seconds: float) -> Sample:
    """Each track beside the true hand nearest to it; only what this frame showed counts."""
    truth = {number: np.array(points) for number, points in reality.truth(stamp).hands.items()}
    palms: list[float] = []
    named: list[float] = []
    nearest: list[float] = []
    for hand in tracks.by_number.values():
        if hand.last_seen < stamp or not truth:
            continue
        off = {number: _distance(points[list(PALM)].mean(axis=0), hand.palm) for number, points in truth.items()}
        number = min(off, key=lambda key: off[key])
        palms.append(off[number])
        tips = truth[number][list(TIPS)]
        for finger, tip in hand.tips.items():
            if tip.last_seen == hand.last_seen:
                errors = np.linalg.norm(tips - tip.filter.point, axis=1)
                named.append(float(errors[finger]))
                nearest.append(float(errors.min()))
    return Sample(palms, named, nearest, _visible(reality), seconds)


def _visible(reality: Reality) -> int:
    seen = [landmarks_in_view(reality.camera, reality.world, reality.hands, hand) for hand in reality.hands.present]
    return int(sum(flags[list(TIPS)].sum() for flags in seen))


def _distance(point: Array, pose: Pose) -> float:
    return float(np.linalg.norm(point - pose.translation))


def _row(source: str, samples: list[Sample]) -> dict[str, Any]:
    """In SI units."""
    pooled = {name: np.array([error for sample in samples for error in getattr(sample, name)])
              for name in ("palms", "named", "nearest")}  # fmt: skip
    real = pooled["nearest"] <= FALSE
    return {
        "source": source,
        "frames": len(samples),
        **_quantiles("palm", pooled["palms"]),
        **_quantiles("fingertip_by_name", pooled["named"] if source != "skin colour" else np.array([])),
        **_quantiles("fingertip", pooled["nearest"]),
        "fingertips_seen": float(real.sum() / max(sum(sample.visible for sample in samples), 1)),
        "fingertips_false": float((~real).mean()) if len(real) else None,
        "median_time_s": float(np.median([sample.seconds for sample in samples])),
    }


def _quantiles(name: str, errors: Array) -> dict[str, float | None]:
    shares = (("median", 0.5), ("p95", 0.95))
    return {f"{name}_{label}_m": float(np.quantile(errors, share)) if len(errors) else None for label, share in shares}


def _table(rows: list[dict[str, Any]]) -> Table:
    table = Table(title="Hands: errors in mm, median / 95 %")
    for heading in ("source", "frames", "palm", "tip by name", "nearest tip", "tips", "false", "ms"):
        table.add_column(heading, justify="left" if heading == "source" else "right")
    for row in rows:
        errors = [_pair(row, name) for name in ("palm", "fingertip_by_name", "fingertip")]
        shares = [_share(row[name]) for name in ("fingertips_seen", "fingertips_false")]
        table.add_row(row["source"], str(row["frames"]), *errors, *shares, f"{row['median_time_s'] * 1e3:.1f}")
    return table


def _pair(row: dict[str, Any], name: str) -> str:
    values = [row[f"{name}_{label}_m"] for label in ("median", "p95")]
    return " / ".join("-" if value is None else f"{value * 1e3:.1f}" for value in values)


def _share(value: float | None) -> str:
    return "-" if value is None else f"{value:.0%}"


if __name__ == "__main__":
    main()
