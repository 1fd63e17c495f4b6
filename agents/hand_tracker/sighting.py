"""A hand as any source sees it in one frame, and its derivation from 21 landmarks."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from dsr.images.blobs import Frame
from dsr.math3d import quaternions
from dsr.math3d.batches import rigid_fit
from dsr.math3d.quaternions import Quaternion
from dsr.math3d.transforms import Pose

Array = NDArray[np.float64]
Side = Literal["left", "right", "unknown"]
Source = Literal["mediapipe", "skin colour", "poses"]

LANDMARKS = 21
TIPS = (4, 8, 12, 16, 20)
"""Landmarks of the fingertips, from thumb to little finger."""
PALM = (0, 5, 9, 13, 17)
"""Landmarks whose mean is the palm's centre: the wrist and the knuckles of the four fingers."""
LEAST_OF_PALM = 3
"""Landmarks of the palm without which there is no hand."""
MOST_TURN = 1.0
"""rad, standard deviation that stands for a rotation of which nothing is known"""
SHAPE_TURN = 0.5
"""rad, standard deviation of the rotation that a network tells with its shape of a hand: it is 7 to 45 degrees off"""

_PALM_SHAPE = np.array([
    [0.0, 0.0, 0.0], [0.088, 0.025, 0.0], [0.090, 0.004, 0.0], [0.084, -0.016, 0.0], [0.075, -0.034, 0.0],
])  # fmt: skip
"""(5, 3) m, `PALM` of a right hand of common size; x towards the fingers, z out of the back of the hand."""
_SHAPE = _PALM_SHAPE - _PALM_SHAPE.mean(axis=0)
_LEAST_SIGMA = 1e-6  # m
_LEAST_SPREAD = 1e-4  # m, below which landmarks do not tell an orientation
_STEPS = 5  # of Gauss-Newton; two or three do


class OutlinedTip(NamedTuple):
    """A fingertip that the outline of a hand shows, without the name of its finger."""

    point: Array
    """(3,) m, its centre"""
    across: Array
    """(5,) m, how far across the view it is from each finger's tip as the landmarks have it"""


class Outline(NamedTuple):
    """The outline of a hand in the image."""

    middle: Array
    """(3,) m, the middle of its widest place"""
    area: float
    """m^2, across the view"""


class SeenHand(NamedTuple):
    """One hand in one frame, in the camera's optical frame."""

    palm: Pose
    """camera_from_palm: x towards the fingers, z out of the back of the hand"""
    tips: dict[int, Array]
    """Centres (3,) of fingertips, m. If `is_labelled` the keys say which: 0 (thumb) to 4 (little finger)."""
    is_labelled: bool
    side: Side
    sigma: float
    """m, standard deviation of each coordinate"""
    turn_covariance: Array | None = None
    """(3, 3) rad^2, of the palm's rotation, about the same axes as its pose; None if unknown"""
    palm_sigma: float = 0.0
    """m, standard deviation of each coordinate of the palm's centre, where that is more than landmarks would give it"""
    is_whole: bool = True
    """Whether this is a hand for certain, not perhaps a part of one that something cuts in two."""
    outline: Outline | None = None
    """That of its skin, if this was looked for, and nothing hides a part of it"""
    begins: bool = True
    """Whether this may be a hand that was not known before."""
    outlined: tuple[OutlinedTip, ...] = ()
    """Fingertips that were seen beside the labelled ones, and better: some of these may be hidden, and guessed"""


class Finder(Protocol):
    """Finds hands in camera frames."""

    source: Source

    def find(self, frame: Frame, table: Array | None) -> list[SeenHand]:
        """The hands in a frame with colour, depth and intrinsics.

        `table` is the plane (4,) of a table's top in the camera's frame, pointing up, if known: n . X + d is the height
        of a point above it in m. Raises `WireError` for an unusable frame.
        """

    def close(self) -> None:
        """Release what it holds."""


def hand_of_landmarks(
    points: Array, seen: NDArray[np.bool_], side: Side, sigma: float, shape: Array | None = None
) -> SeenHand | None:
    """A hand of landmarks (21, 3) m in the camera's frame, of which those `seen` (21,) count.

    None if too few of the palm are seen. Where all are, its centre is their mean; else the common shape of a palm is
    fitted (Umeyama 1991), so that the centre does not depend on which are seen.

    Args:
        points: (21, 3) m.
        seen: (21,)
        side: of the hand.
        sigma: m, standard deviation of each coordinate.
        shape: (21, 3) m about any origin, turned as the camera sees the hand, if a network tells that. Landmarks in a
            line leave a rotation open, which the shape tells about as well as `SHAPE_TURN`. None if nothing does.
    """
    chosen = [k for k, landmark in enumerate(PALM) if seen[landmark]]
    if len(chosen) < LEAST_OF_PALM:
        return None
    palm = _SHAPE * (1.0, -1.0, 1.0) if side == "left" else _SHAPE
    there = points[[PALM[k] for k in chosen]]
    told = None if shape is None else _fit(palm, shape[list(PALM)])[1]
    if told is None:
        centre, rotation = _fit(palm[chosen], there)
        covariance = _turn_covariance(there, sigma, MOST_TURN)
    else:
        centre, rotation, covariance = _turned(palm, told, chosen, there, sigma)
    if rotation is None:
        return None
    if len(chosen) == len(PALM):
        centre = there.mean(axis=0)
    tips = {finger: points[landmark] for finger, landmark in enumerate(TIPS) if seen[landmark]}
    return SeenHand(Pose(centre, rotation), tips, True, side, sigma, covariance)


def _turned(
    palm: Array, told: Quaternion, chosen: list[int], there: Array, sigma: float
) -> tuple[Array, Quaternion, Array]:
    """Centre, rotation and its covariance (3, 3) rad^2 of a palm (5, 3) of which the `chosen` are `there` (n, 3).

    The most likely ones, if the rotation that was `told` is off by `SHAPE_TURN`, by Gauss-Newton steps.
    """
    middle, target = palm[chosen].mean(axis=0), there - there.mean(axis=0)
    shape = palm - middle
    shape = shape * math.sqrt(float((target**2).sum() / (shape[chosen] ** 2).sum()))
    rotation = told
    for _ in range(_STEPS):
        now = shape[chosen] @ np.array(quaternions.to_matrix(rotation)).T
        covariance = _turn_covariance(now, sigma, SHAPE_TURN)
        apart = np.cross(now, target).sum(axis=0) / max(sigma, _LEAST_SIGMA) ** 2
        turned = np.array(quaternions.to_rotvec(quaternions.product(rotation, quaternions.conjugate(told))))
        x, y, z = (covariance @ (apart - turned / SHAPE_TURN**2)).tolist()
        rotation = quaternions.product(quaternions.from_rotvec((x, y, z)), rotation)
    offsets = shape @ np.array(quaternions.to_matrix(rotation)).T
    return there.mean(axis=0) + offsets.mean(axis=0), rotation, covariance


def _turn_covariance(points: Array, sigma: float, most: float) -> Array:
    """(3, 3) rad^2, of the rotation of points (n, 3) that are off by `sigma` m: great about a line on which all lie.

    `most` (rad) is the standard deviation of a rotation that no points tell.
    """
    x, y, z = (points - points.mean(axis=0)).T
    arms = np.array([[y @ y + z @ z, -x @ y, -x @ z], [-x @ y, x @ x + z @ z, -y @ z], [-x @ z, -y @ z, x @ x + y @ y]])
    information = arms / max(sigma, _LEAST_SIGMA) ** 2 + np.eye(3) / most**2
    return np.asarray(np.linalg.inv(information), dtype=np.float64)


def _fit(shape: Array, there: Array) -> tuple[Array, Quaternion | None]:
    """Where the origin of a shape (n, 3) is and how it is turned, if it is scaled, turned and moved to `there`."""
    shape_mean, there_mean = shape.mean(axis=0), there.mean(axis=0)
    a, b = shape - shape_mean, there - there_mean
    spread = np.linalg.svd(b, compute_uv=False)
    if spread[1] < _LEAST_SPREAD:
        return there_mean, None
    rotation, _ = rigid_fit(a, b)
    scale = float(((a @ rotation.T) * b).sum() / (a * a).sum())
    return there_mean - scale * (rotation @ shape_mean), quaternions.from_matrix(rotation.tolist())
