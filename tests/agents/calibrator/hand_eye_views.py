"""Synthetic views of a target with known truth: where a robot's hand was, and what a camera saw."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from agents.calibrator.hand_eye.calibrate import Setting, Solution, observed, solve
from agents.calibrator.hand_eye.observations import Observations
from agents.calibrator.hand_eye.reading import ToldHands
from agents.calibrator.hand_eye.targets import Target, read_target
from dsr.math3d.transforms import Array, Pose, exp, log, looking_at
from dsr.vocabulary.distortion import Distortion
from dsr.vocabulary.intrinsics import Intrinsics

SIZE = (640, 480)
LENS = Intrinsics(600.0, 598.0, 322.0, 236.0, *SIZE, Distortion("plumb_bob", (-0.12, 0.05, 0.001, -0.0015, 0.0)))
MOUNT = Pose.from_rotvec((0.03, -0.06, 0.05), (0.1, -0.2, 1.5)).matrix
HELD = Pose.from_rotvec((0.5, 0.1, 0.02), (np.pi - 0.05, 0.02, 0.1)).matrix
"""holder_from_target of grids, whose z points away from the camera"""


@dataclass(frozen=True)
class Truth:
    """What was simulated."""

    mount: Array
    held: Array
    hands: Array
    """(v, 4, 4) where the hand really was"""


def looks(count: int, seed: int, target: Target, spread: float = 0.35) -> Array:
    """(v, 4, 4) camera_from_target, with the target in view, from all sides and rolled."""
    rng = np.random.default_rng(seed)
    middle = target.points.mean(axis=0)
    extent = float(np.ptp(target.points, axis=0).max())
    poses = []
    for _ in range(count):
        place = rng.normal(0.0, spread, 2)
        distance = extent * rng.uniform(1.9, 2.8)
        sign = 1.0 if target.name.startswith("tag") else -1.0  # on which side of the target one stands
        eye = middle + distance * np.array([place[0], place[1], sign * np.sqrt(max(0.2, 1.0 - place @ place))])
        pose = looking_at(tuple(eye.tolist()), tuple(middle.tolist()), (0.0, 1.0, 0.0)).inverse()
        poses.append((Pose.from_rotvec((0.0, 0.0, 0.0), (0.0, 0.0, rng.uniform(-1.2, 1.2))) @ pose).matrix)
    return np.array(poses)


def simulated(
    name: str,
    *,
    count: int = 12,
    seed: int = 0,
    is_in_hand: bool = True,
    pixel_std: float = 0.1,
    position_std: float = 3e-4,
    rotation_std: float = 3e-4,
    spread: float = 0.35,
    lens: Intrinsics = LENS,
    setting: Setting | None = None,
) -> tuple[Observations, Truth]:
    """Observations of a target, with normal errors of points and of the hand's poses as the robot tells them."""
    target = read_target(name)
    rng = np.random.default_rng([seed, 1])
    seen = looks(count, seed, target, spread)
    carrier_from_holder = MOUNT @ seen @ np.linalg.inv(HELD)
    hands = np.linalg.inv(carrier_from_holder) if is_in_hand else carrier_from_holder
    noise = np.concatenate(
        [rng.normal(0.0, position_std, (count, 3)), rng.normal(0.0, rotation_std, (count, 3))], axis=1
    )
    told = np.array([hand @ exp(twist).matrix for hand, twist in zip(hands, noise, strict=True)])
    points = np.einsum("vij,nj->vni", seen[:, :3, :3], target.points) + seen[:, None, :3, 3]
    pixels = (
        lens.project(points) + rng.normal(0.0, pixel_std, (*points.shape[:2], 2)) if pixel_std else lens.project(points)
    )
    setting = setting or Setting(is_in_hand=is_in_hand)
    names = [f"{row}.png" for row in range(count)]
    return observed(names, ToldHands((), told, None), pixels, target, SIZE, setting), Truth(MOUNT, HELD, hands)


def off(solution: Solution, truth: Truth) -> Array:
    """(6,) twist from the true mount to the one that was found, m and rad."""
    found = Pose.from_matrix(solution.fitted.parameters.mount)
    return log(Pose.from_matrix(truth.mount).inverse() @ found)


def solved(observations: Observations, setting: Setting | None = None, lens: Intrinsics | None = LENS) -> Solution:
    """The fit, with the true lens unless another is given."""
    return solve(observations, lens, setting or Setting(is_in_hand=observations.is_in_hand))
