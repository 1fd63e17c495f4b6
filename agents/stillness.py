"""Whether a camera stood still when a frame was taken: if not, its pose at that instant is not known well enough."""

from __future__ import annotations

from dsr.errors import NoPathError, TransformError
from dsr.math3d.tolerance import PoseTolerance
from dsr.memory import Memory

_SPAN = 0.1
"""s before the exposure over which the motion is measured."""


def stood_still(memory: Memory, camera: str, stamp: float, max_speed: float, max_turn: float) -> bool:
    """Whether the camera node moved slower than `max_speed` (m/s) and `max_turn` (rad/s) before `stamp` (s).

    A camera without a frame chain to the world cannot be said to move; one whose chain is not known at that
    time (the arm's state is missing) might.
    """
    try:
        world_from_camera = memory.transform("world", camera, at=stamp)
        world_from_camera_before = memory.transform("world", camera, at=stamp - _SPAN)
    except NoPathError:
        return True
    except TransformError:
        return False
    return PoseTolerance(max_speed * _SPAN, max_turn * _SPAN).covers(world_from_camera_before, world_from_camera)
