"""The figure of a human hand: 21 joints, and where they are when the fingertips are to be in given places.

The joints are those of MediaPipe, in its order: wrist, then four of each digit from thumb to little finger, the last
of which is the centre of the fingertip. The palm's frame is at the mean of the wrist and the knuckles of the four
fingers, x towards the fingers, z out of the back of the hand. All joints of a right hand are given; a left hand is its
mirror image in y.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from agents.plant.world import upright
from dsr.math3d import quaternions
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose

Side = Literal["left", "right"]
Array = NDArray[np.float64]

JOINTS = 21
TIPS = (4, 8, 12, 16, 20)
"""Indices of the fingertips, from thumb to little finger."""
PALM = (0, 5, 9, 13, 17)
"""Indices of the joints whose mean is the palm's centre."""
TIP_RADIUS = 0.008
"""m, of all fingers: a fingertip's centre is this far from what it touches."""
PALM_RADIUS = 0.012
"""m, half the thickness of the palm"""
BONES = ((0, 1), (1, 2), (2, 3), (3, 4), *((a, b) for k in (5, 9, 13, 17) for a, b in ((0, k), *zip(
    range(k, k + 3), range(k + 1, k + 4), strict=True))))  # fmt: skip
"""Pairs of joints with a rounded piece of hand around them."""

_WRIST: Vector3 = (0.0, 0.0, 0.0)
_BASES = ((0.022, 0.028, -0.006), (0.088, 0.025, 0.0), (0.090, 0.004, 0.0), (0.084, -0.016, 0.0), (0.075, -0.034, 0.0))
_LENGTHS = ((0.045, 0.034, 0.028), (0.042, 0.026, 0.022), (0.043, 0.028, 0.022), (0.043, 0.027, 0.022),
            (0.034, 0.021, 0.019))  # fmt: skip
_RELAXED = ((0.112, 0.072, -0.020), (0.175, 0.040, -0.009), (0.181, 0.006, -0.010), (0.173, -0.028, -0.009),
            (0.144, -0.054, -0.007))  # fmt: skip
_STRAIGHT = ((0.60, 0.77, -0.22), (0.985, 0.17, 0.0), (1.0, 0.02, 0.0), (0.98, -0.17, 0.0), (0.93, -0.36, 0.0))
"""Directions in which straight fingers point that do not touch each other."""
_CENTRE = np.mean([_WRIST, *_BASES[1:]], axis=0)
_BULGES = ((0.3, 0.7, 0.6), (0.0, 0.0, 1.0), (0.0, 0.0, 1.0), (0.0, 0.0, 1.0), (0.0, 0.0, 1.0))
_LAST_SHARE = 0.67  # of the bend of the middle joint, by which the last joint bends
_MOST_BENT = math.radians(115)
_HALVINGS = 24


def relaxed(side: Side) -> Array:
    """(5, 3) fingertips in the palm's frame of a hand that does nothing, m."""
    return _mirrored(np.array(_RELAXED) - _CENTRE, side)


def outstretched(side: Side) -> Array:
    """(21, 3) joints in the palm's frame, m, of a hand whose fingers are straight and apart."""
    found = [np.array(_WRIST)]
    for base, lengths, direction in zip(_BASES, _LENGTHS, _STRAIGHT, strict=True):
        along = np.array(direction) / np.linalg.norm(direction)
        found += [np.array(base) + far * along for far in np.cumsum((0.0, *lengths))]
    return _mirrored(np.array(found) - _CENTRE, side)


def joints(tips: Array, side: Side) -> Array:
    """(21, 3) joints in the palm's frame (m) of a hand with fingertips (5, 3) there.

    Bones keep their lengths as long as the fingertip is within reach; beyond, the finger is straight and stretched.
    The array is not to be written to.
    """
    return _joints(np.ascontiguousarray(tips, np.float64).tobytes(), side)


@lru_cache(maxsize=64)  # a hand that holds something keeps its figure
def _joints(tips: bytes, side: Side) -> Array:
    mirrored = _mirrored(np.frombuffer(tips).reshape(5, 3), side)
    found = np.empty((JOINTS, 3))
    found[0] = _WRIST - _CENTRE
    for finger in range(5):
        base = np.array(_BASES[finger]) - _CENTRE
        found[1 + 4 * finger : 5 + 4 * finger] = _finger(
            base, mirrored[finger], _LENGTHS[finger], np.array(_BULGES[finger])
        )
    found = _mirrored(found, side)
    found.setflags(write=False)
    return found


def radius(bone: tuple[int, int]) -> float:
    """m, of the flesh around a bone."""
    return PALM_RADIUS if bone[0] == 0 else TIP_RADIUS


def palm_pose(position: Vector3, side: tuple[float, float], pitch: float) -> Pose:
    """world_from_palm of a hand that comes from the direction `side` (world x, y), fingers `pitch` rad downwards."""
    towards = upright((0.0, 0.0, 0.0), math.atan2(-side[1], -side[0]))
    return Pose(position, quaternions.product(towards.q, quaternions.from_rotvec((0.0, pitch, 0.0))))


def _finger(base: Array, tip: Array, lengths: tuple[float, float, float], bulge: Array) -> Array:
    """(4, 3) joints of one finger, in the plane of the chord and the direction in which it bulges."""
    chord = tip - base
    distance = float(np.linalg.norm(chord))
    along = chord / distance if distance > 0.0 else np.array([1.0, 0.0, 0.0])
    across = bulge - (bulge @ along) * along
    across /= max(float(np.linalg.norm(across)), 1e-9)
    flat = _bent(lengths, _bend(lengths, distance))
    flat *= distance / max(float(flat[-1, 0]), 1e-9)
    return np.asarray(base + flat[:, :1] * along + flat[:, 1:] * across)


def _bend(lengths: tuple[float, float, float], distance: float) -> float:
    """rad, by which the middle joint is bent for its ends to be `distance` m apart."""
    low, high = 0.0, _MOST_BENT
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if _chord(lengths, middle) > distance:
            low = middle
        else:
            high = middle
    return low


def _chord(lengths: tuple[float, float, float], bend: float) -> float:
    """Distance between the ends of a bent finger, m."""
    first, middle, last = lengths
    further = bend * (1 + _LAST_SHARE)
    along = first + middle * math.cos(bend) + last * math.cos(further)
    return math.hypot(along, middle * math.sin(bend) + last * math.sin(further))


def _bent(lengths: tuple[float, float, float], bend: float) -> Array:
    """(4, 2) joints of a bent finger: along its chord, and how far off it."""
    angles = np.array([0.0, -bend, -bend * (1 + _LAST_SHARE)])
    steps = np.column_stack([np.cos(angles), np.sin(angles)]) * np.array(lengths)[:, None]
    points = np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])
    end = points[-1] / np.linalg.norm(points[-1])
    return np.asarray(points @ np.array([[end[0], -end[1]], [end[1], end[0]]]))


def _mirrored(points: Array, side: Side) -> Array:
    return points * (1.0, -1.0, 1.0) if side == "left" else points
