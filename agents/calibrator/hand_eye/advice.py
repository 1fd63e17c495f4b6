"""Which kind of view to add: of some that can be imagined, the one after which the mount would be known best."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from agents.calibrator.hand_eye.equations import inverse
from agents.calibrator.hand_eye.fit import Fitted, hand_covariances
from agents.calibrator.hand_eye.model import ViewModel
from dsr.math3d.batches import inverses
from dsr.math3d.transforms import Array, Pose

_TILT = math.radians(35.0)
"""rad, of the direction from which the target is looked at, off its normal"""
_ROLL = math.radians(90.0)
_SIDES = {"the right": (1.0, 0.0), "the left": (-1.0, 0.0), "below": (0.0, 1.0), "above": (0.0, -1.0)}
"""Where the camera goes, in the target's plane as a present view shows it"""
_IN_VIEW = 0.9
"""Share of the points that an imagined view must show"""
_GAIN = 0.95
"""Share of the present error that must not be passed, for a view to be worth it"""


class _Idea(NamedTuple):
    text: str
    camera_from_target: Array


def advise(model: ViewModel, fitted: Fitted) -> str:
    """A sentence that says which view to add, and what that would be good for; empty if none is worth it."""
    now, observations = fitted.parameters, model.observations
    present = inverses(now.mount) @ observations.holders @ now.target
    distance = float(np.median(np.linalg.norm(present[:, :3, 3], axis=1)))
    before = _error(fitted.covariance, distance)
    rated = []
    for idea in _ideas(present, observations.points.mean(axis=0), distance):
        after = _after(model, fitted, idea.camera_from_target)
        if after is not None:
            rated.append((_error(after, distance), idea.text))
    if not rated:
        return ""
    least, text = min(rated)
    if least > _GAIN * before:
        return ""
    errors = f"from {1e3 * before:.2f} to {1e3 * least:.2f} mm"
    return f"add a view {text}: that would bring the error at the target {errors}"


def _ideas(present: Array, middle: Array, distance: float) -> list[_Idea]:
    """Views with the target in the middle of the image, as seen from the most frontal of the present ones."""
    frontal = present[int(np.argmax(np.abs(present[:, 2, 2])))]
    upright = frontal[:3, :3]
    ideas = []
    for side, (x, y) in {"the front": (0.0, 0.0), **_SIDES}.items():
        axis = np.array([-y, x, 0.0])  # the target turns its other side to us when the camera goes there
        tilted = Pose.from_rotvec((0.0, 0.0, 0.0), _TILT * axis).rotation_matrix @ upright
        for roll in (0.0, _ROLL, -_ROLL):
            for share, where in ((1.0, ""), (0.6, ", from closer")):
                turn = Pose.from_rotvec((0.0, 0.0, 0.0), (0.0, 0.0, roll)).rotation_matrix @ tilted
                pose = np.eye(4)
                pose[:3, :3] = turn
                pose[:3, 3] = np.array([0.0, 0.0, share * distance]) - turn @ middle
                rolled = f", rolled by {math.degrees(roll):+.0f} degrees" if roll else ""
                tilt = f"from {math.degrees(_TILT):.0f} degrees to {side}" if x or y else "from the front"
                ideas.append(_Idea(f"{tilt}{rolled}{where}", pose))
    return ideas


def _after(model: ViewModel, fitted: Fitted, camera_from_target: Array) -> Array | None:
    """Covariance of the common parameters with one view more; None if that does not show the target."""
    now, observations = fitted.parameters, model.observations
    holder = now.mount @ camera_from_target @ inverses(now.target)
    hand = inverses(holder) if observations.is_in_hand else holder
    mean = hand_covariances(observations.noises, fitted.noise).mean(axis=0)
    one = replace(
        observations, names=("",), hands=hand[None], pixels=np.zeros((1, len(observations.points), 2)),
        noises=(), joint_effects=None,
    )  # fmt: skip
    imagined = ViewModel(one, fits_lens=model.fits_lens, fits_offsets=False)
    there = now._replace(slips=np.eye(4)[None])
    points = imagined.points(there)[0]
    with np.errstate(invalid="ignore"):
        pixels = now.intrinsics.project(np.where(points[:, 2:] > 0.0, points, np.nan))
    inside = np.asarray(((pixels >= 0.0) & (pixels <= np.array(observations.size) - 1.0)).all(axis=1))
    if inside.mean() < _IN_VIEW:
        return None
    linear = imagined.linearised(there)
    std = math.hypot(fitted.noise.pixel / math.sqrt(len(points)), fitted.noise.smooth)
    shares = inside[None, :, None, None] / (std * math.sqrt(len(points)))
    by_common = np.zeros((2 * len(points), len(fitted.covariance)))
    own = (shares * linear.by_common)[0].reshape(2 * len(points), -1)
    by_common[:, : own.shape[1]] = own
    by_slip = (shares * linear.by_slip)[0].reshape(-1, 6)
    spread = by_slip @ mean @ by_slip.T + np.eye(len(by_slip))
    return inverse(inverse(fitted.covariance) + by_common.T @ np.linalg.solve(spread, by_common))


def _error(covariance: Array, distance: float) -> float:
    """m, standard deviation of the place of what is seen at a distance (m), by that of the mount."""
    by_mount = np.hstack([np.eye(3), np.array([[0.0, distance, 0.0], [-distance, 0.0, 0.0], [0.0, 0.0, 0.0]])])
    return math.sqrt(float(np.trace(by_mount @ covariance[:6, :6] @ by_mount.T)))
