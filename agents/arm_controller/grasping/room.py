"""Checks whether the gripper has room around an object: the things that it would touch while the fingers close."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from agents.arm_controller.model.figure import Figure
from agents.arm_controller.motion.obstacles import GRIPPER_MARGIN, STANDOFF
from agents.arm_controller.motion.overlap import room
from agents.arm_controller.scene import Obstacle
from dsr.math3d.boxes import Array, Boxes, stacked
from dsr.math3d.transforms import Pose

_STROKE_STEP = 0.005  # m that a finger moves between two openings that are looked at; half of its thinnest box


class Room:
    """The free space around one object.

    Args:
        figure: the shape of the gripper.
        things: what must not be touched, without the object itself.
    """

    def __init__(self, figure: Figure, things: Sequence[Obstacle]) -> None:
        self._figure, self.things = figure, tuple(things)
        """What must not be touched."""
        self._names = [thing.name for thing in things]
        self._boxes = stacked((thing.pose, thing.size) for thing in things)

    @property
    def reach(self) -> float:
        """Length (m) by which the fingers reach beyond the tool point."""
        return self._figure.reach

    def beside(self, things: Sequence[Obstacle]) -> Room:
        """The same with further things that must not be touched."""
        return Room(self._figure, [*self.things, *things])

    def throat(self, width: float) -> float:
        """How far (m) an object of that width between the pads may reach towards the palm from the tool point."""
        return self._figure.throat(width) - GRIPPER_MARGIN

    def blockers(self, tools: Sequence[Pose], width: float, opening: float) -> list[tuple[str, ...]]:
        """Name the things that the gripper is too close to, with the tool at each of `tools` (world_from_tool).

        On the way of the fingers from `opening` to `width` (m), so that they can close there.
        """
        if not tools or not self._names:
            return [()] * len(tools)
        left = self._room(tools, width, opening)
        return [tuple(self._names[index] for index in np.flatnonzero(row < 0.0)) for row in left]

    def _room(self, tools: Sequence[Pose], width: float, opening: float) -> Array:
        """(m, k) m that is left to each thing at m poses of the tool."""
        steps = max(2, math.ceil((opening - width) / 2 / _STROKE_STEP) + 1)
        parts = [box for wide in np.linspace(width, opening, steps) for box in self._figure.gripper(float(wide))]
        local = stacked((box.pose, box.size) for box in parts)
        world_from_tool = np.array([tool.matrix for tool in tools])
        turns, offsets = world_from_tool[:, None, :3, :3], world_from_tool[:, None, :3, 3]
        centers = (turns @ local.centers[..., None])[..., 0] + offsets
        placed = Boxes(centers, turns @ local.axes, np.broadcast_to(local.halves, centers.shape))
        return room(placed, self._boxes, np.full(centers.shape[:2], STANDOFF))
