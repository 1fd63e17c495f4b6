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
from simulation_handler.hands.anatomy import HAND
from simulation_handler.hands.state import HAND_REACH
from simulation_handler.shapes.geometry import Solid


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
    for finger, known in enumerate(HAND.fingers):
        (x, y, z), (u, v, w) = known.knuckle, known.tip
        start, end = (x, mirror * y, z), (u, mirror * v, w)
        if finger in tips:
            end = (hand_from_world @ Pose.unchecked(tips[finger], (0.0, 0.0, 0.0, 1.0))).t
        if math.dist(start, end) <= HAND_REACH:  # else the tip is none of this hand
            fingers.append(_finger(start, end))
    return _as_solid(name, world_from_hand, (*(block.part for block in (HAND.palm, *HAND.forearm)), *fingers))


def _finger(start: Vector3, end: Vector3) -> Part:
    """A straight one, round ends and all."""
    x, y, z = (b - a for a, b in zip(start, end, strict=True))
    length, thickness = math.hypot(x, y, z), HAND.finger_thickness
    yaw, pitch = math.atan2(y, x), math.atan2(-z, math.hypot(x, y))
    turn = quaternions.product(quaternions.from_rotvec((0.0, 0.0, yaw)), quaternions.from_rotvec((0.0, pitch, 0.0)))
    mx, my, mz = (0.5 * (a + b) for a, b in zip(start, end, strict=True))
    return Part("box", (length + thickness, thickness, thickness), (mx, my, mz), turn)


def _as_solid(name: str, world_from_hand: Pose, parts: Shape) -> Solid:
    shape, middle = centred(parts)
    least, greatest = bounds(shape)
    x, y, z = (b - a for a, b in zip(least, greatest, strict=True))
    centre = world_from_hand @ Pose.unchecked(middle, (0.0, 0.0, 0.0, 1.0))
    return Solid(name, (x, y, z), centre.t, centre.q, fixed=True, shape=shape)
