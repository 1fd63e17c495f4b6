"""Hand-eye calibration on a circle grid, ours beside OpenCV's: views are held out, and predicted from the robot's pose.

The grid is found once, for all methods. Each method gets the same views; OpenCV's also the intrinsics that its
`calibrateCamera` finds from these, or those that come with the recording.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np

from agents.calibrator.hand_eye.calibrate import Setting, observed, solve
from agents.calibrator.hand_eye.observations import Observations
from agents.calibrator.hand_eye.reading import Hands, read_images
from agents.calibrator.hand_eye.start import find_start, target_poses
from agents.calibrator.hand_eye.targets import read_target
from benchmarks.peers.opencv_hand_eye import OpenCv
from benchmarks.real.held_out import Mount, errors, row, show
from benchmarks.real.subcommand import MissingDataError, Subcommand
from dsr.math3d.transforms import Array, Pose
from dsr.vocabulary.distortion import Distortion
from dsr.vocabulary.intrinsics import Intrinsics

_NUMBER = re.compile(r"^\s*(\w+):\s*(-?[\d.]+(?:e-?\d+)?)\b", re.MULTILINE)
_PAIR = re.compile(r"pose:\s*(\S+)\s+image:\s*(\S+)")


def run(data: Path, options: argparse.Namespace) -> list[dict[str, Any]]:
    """Measure on a folder with cal_data.yaml, target.yaml and camera_intr_calibrated.yaml."""
    views, given = _read(data)
    sys.stderr.write(f"the grid is found in {len(views)} images\n")
    try:
        peer = None if options.without_opencv else OpenCv(options.opencv)
    except OSError as error:
        sys.stderr.write(f"OpenCV's methods are left out: {error}\n")
        peer = None
    found: dict[str, list[Array]] = {}
    for fitted, held in _splits(len(views), options.hold, options.rounds, options.seed):
        train, test = views.subset(fitted), views.subset(held)
        for method, mount in _mounts(train, given, peer):
            found.setdefault(method, []).append(errors(mount, test))
    rows = [row(method, np.concatenate(parts)) for method, parts in found.items()]
    show(f"views held out: {options.hold} of {len(views)} at a time, {options.rounds} rounds", rows)
    return rows


def _mounts(train: Observations, given: Intrinsics, peer: OpenCv | None) -> Iterator[tuple[str, Mount]]:
    """What each method makes of the same views."""
    setting = Setting(lens="plumb_bob")
    yield "ours, intrinsics fitted", Mount.of(solve(train, None, setting).fitted.parameters)
    yield "ours, intrinsics given", Mount.of(solve(train, given, Setting()).fitted.parameters)
    start = find_start(train, given, 0)
    yield "ours, closed form alone", Mount(start.mount, start.target, given)
    if peer is None:
        return
    ordered = train.reordered(start.orders)
    calibrated = _calibrated(ordered)
    for name, lens in (("calibrateCamera", calibrated), ("given", given)):
        targets = np.array([poses[0] for poses in target_poses(ordered, lens)])
        for method, (camera, target) in peer.mounts(ordered.hands, targets).items():
            yield f"OpenCV {method}, intrinsics {name}", Mount(camera, target, lens)


def _calibrated(views: Observations) -> Intrinsics:
    """Intrinsics by OpenCV's `calibrateCamera`, with five coefficients."""
    points = [views.points[seen].astype(np.float32) for seen in views.seen]
    pixels = [view[seen].astype(np.float32) for view, seen in zip(views.pixels, views.seen, strict=True)]
    _, matrix, coefficients, *_ = cv2.calibrateCamera(points, pixels, views.size, np.eye(3), np.zeros(5))
    (fx, _, cx), (_, fy, cy), _ = matrix.tolist()
    lens = Distortion("plumb_bob", tuple(float(value) for value in np.ravel(coefficients)[:5]))
    return Intrinsics(fx, fy, cx, cy, *views.size, lens)


def _splits(count: int, hold: int, rounds: int, seed: int) -> Iterator[tuple[list[int], list[int]]]:
    """Views to fit to and views to predict: each is predicted once a round."""
    rng = np.random.default_rng(seed)
    for _ in range(rounds):
        order = rng.permutation(count)
        for first in range(0, count, hold):
            held = order[first : first + hold].tolist()
            yield [one for one in range(count) if one not in held], held


def _read(data: Path) -> tuple[Observations, Intrinsics]:
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
    views = observed(names, Hands((), np.array(poses)[rows], None), pixels, target, (width, height), Setting())
    return views, msgspec.convert(lens | {"width": width, "height": height}, Intrinsics, strict=False)


def _numbers(file: Path) -> dict[str, float]:
    """All lines `name: number` of a file in YAML."""
    return {name: float(value) for name, value in _NUMBER.findall(_text(file))}


def _text(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8")
    except OSError as error:
        raise MissingDataError(f"{file} cannot be read") from error


def _options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--hold", type=int, default=3, metavar="K", help="views to hold out at a time (default: 3)")
    parser.add_argument("--rounds", type=int, default=2, help="how often each view is held out (default: 2)")
    folder = Path(sys.prefix) / "opencv4"
    parser.add_argument(
        "--opencv", type=Path, default=folder, metavar="FOLDER", help="gets OpenCV 4 if this one lacks the methods"
    )
    parser.add_argument("--without-opencv", action="store_true", help="fetch nothing, measure ours alone")


SUBCOMMAND = Subcommand(
    "hand-eye",
    "Hand-eye calibration on a circle grid, beside OpenCV's methods.",
    "https://github.com/Jmeyer1292/robot_cal_tools (rct_examples/data/target_10x10_inch_spacing)",
    run,
    _options,
)
