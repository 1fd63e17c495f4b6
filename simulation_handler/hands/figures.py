"""Models the space that a human hand takes: the palm, the fingers, and the forearm, which is not measured.

Only what it may hide is asked for, so that it is drawn a little too large: what a hand may hide is not missing. Fingers
whose tips are not known are where those of a hand at rest are.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from dsr.math3d import quaternions
from dsr.math3d.quaternions import Vector3
from dsr.math3d.shapes import Part, Shape, bounds, centred
from dsr.math3d.transforms import Pose
from simulation_handler.shapes.geometry import Solid

_PALM = Part("box", (0.115, 0.095, 0.035), (-0.012, 0.0, 0.0))  # m, size of a palm and its centre in the palm's frame
_FOREARM = (
    Part("box", (0.16, 0.08, 0.08), (-0.13, 0.0, -0.01)),
    Part("box", (0.16, 0.12, 0.12), (-0.27, 0.0, -0.025)),
)
"""Where its direction is less and less certain, the wider: wrists bend."""
# m, in the palm's frame, of the thumb first
_KNUCKLES: tuple[Vector3, ...] = (
    (-0.02, 0.04, -0.006),
    (0.022, 0.03, 0.0),
    (0.022, 0.006, 0.0),
    (0.018, -0.016, 0.0),
    (0.008, -0.034, 0.0),
)
_RESTING_FINGERS: tuple[Vector3, ...] = (
    (0.044, 0.072, -0.02),
    (0.107, 0.04, -0.009),
    (0.113, 0.006, -0.01),
    (0.105, -0.028, -0.009),
    (0.076, -0.054, -0.007),
)
"""Where the fingers of a right hand begin and end, in the palm's frame: x towards the fingers, z out of the back."""
_THICKNESS = 0.024  # m, of a finger
_LONGEST = 0.16  # m, of a finger; a tip that is farther away is none of this hand


def hand_solid(name: str, world_from_hand: Pose, tips: Mapping[int, Vector3], *, is_left: bool = False) -> Solid:
    """A hand as one body.

    Args:
        name: of the hand.
        world_from_hand: where its palm is.
        tips: places in the world (m) of the fingertips that are known, from 0 (thumb) to 4 (little finger).
        is_left: a left hand is the mirror image.
    """
    hand_from_world = world_from_hand.inverse()
    mirror = -1.0 if is_left else 1.0
    fingers = []
    for finger, ((x, y, z), (u, v, w)) in enumerate(zip(_KNUCKLES, _RESTING_FINGERS, strict=True)):
        start, end = (x, mirror * y, z), (u, mirror * v, w)
        if finger in tips:
            end = (hand_from_world @ Pose.unchecked(tips[finger], (0.0, 0.0, 0.0, 1.0))).t
        if math.dist(start, end) <= _LONGEST:
            fingers.append(_finger(start, end))
    return _as_solid(name, world_from_hand, (_PALM, *_FOREARM, *fingers))


def _finger(start: Vector3, end: Vector3) -> Part:
    """A straight one, round ends and all."""
    x, y, z = (b - a for a, b in zip(start, end, strict=True))
    length = math.hypot(x, y, z)
    yaw, pitch = math.atan2(y, x), math.atan2(-z, math.hypot(x, y))
    turn = quaternions.product(quaternions.from_rotvec((0.0, 0.0, yaw)), quaternions.from_rotvec((0.0, pitch, 0.0)))
    mx, my, mz = (0.5 * (a + b) for a, b in zip(start, end, strict=True))
    return Part("box", (length + _THICKNESS, _THICKNESS, _THICKNESS), (mx, my, mz), turn)


def _as_solid(name: str, world_from_hand: Pose, parts: Shape) -> Solid:
    shape, middle = centred(parts)
    least, greatest = bounds(shape)
    x, y, z = (b - a for a, b in zip(least, greatest, strict=True))
    centre = world_from_hand @ Pose.unchecked(middle, (0.0, 0.0, 0.0, 1.0))
    return Solid(name, (x, y, z), centre.t, centre.q, fixed=True, shape=shape)
