"""Checks whether a path of the arm is free of all that is believed to be there, and of the arm itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from agents.arm_controller.model.figure import Figure
from agents.arm_controller.model.shapes import LinkBox
from agents.arm_controller.motion.overlap import room
from agents.arm_controller.safety.zones import EDGE, Zone
from agents.arm_controller.scene import Obstacle
from dsr.math3d.boxes import Array, Boxes, stacked
from dsr.math3d.transforms import Pose

MARGIN = 0.01
"""m that the arm and its load keep away from things"""
GRIPPER_MARGIN = 0.003
"""m that the gripper keeps away on a final line, where it works between things"""
STANDOFF = GRIPPER_MARGIN + 0.0001
"""m that grasps are planned to keep: more than is asked for later, because solved joints are some 0.01 mm off"""
HELD_MARGIN = -0.003
"""m for the held object on a final line: it ends in contact, and poses are known to some mm only"""
ITSELF = "the arm itself"

_CLOSER = 0.001  # m by which the arm may come closer to what it is too close to at the start


@dataclass(frozen=True)
class Load:
    """The bodies that move with the tool."""

    opening: float
    """m between the fingers"""
    held: tuple[LinkBox, ...] = ()
    """Boxes of the held object, in the tool's frame."""


class Obstacles:
    """Things around one arm.

    Args:
        figure: the arm's shape.
        things: what must not be touched.
        arm_from_world: where the world is in the arm's frame.
        target: the one of them that the gripper may be around at the end of a path.
        workspace: where the tool point must stay; None for anywhere.
        margins: whether the arm keeps away from the things; else it only must not be in them.
    """

    def __init__(
        self,
        figure: Figure,
        things: Sequence[Obstacle],
        arm_from_world: Pose,
        target: str = "",
        workspace: Zone | None = None,
        *,
        margins: bool = True,
    ) -> None:
        self._figure, self._margins = figure, margins
        self._workspace, self._world_from_arm = workspace, arm_from_world.inverse()
        self._names = [thing.name for thing in things]
        self._target = self._names.index(target) if target in self._names else None
        self._boxes = stacked((arm_from_world @ thing.pose, thing.size) for thing in things)

    def blocking(self, path: Array, load: Load, final: int) -> str | None:
        """Name the first thing that a path (m, n) of joint positions meets; None if the path is free.

        Whatever the arm is too close to at the start it may leave. On the `final` points the gripper works between
        things, and around the target.
        """
        boxes = self._figure.boxes(path, load.opening, load.held)
        found = [*self._meetings(boxes, load, final), *self._leavings(path)]
        return min(found)[1] if found else None

    def free(self, rows: Array, load: Load, spare: float = 0.0) -> NDArray[np.bool_]:
        """(m,) whether the arm at joint positions (m, n) keeps away from everything, by `spare` m beyond the margin."""
        boxes = self._figure.boxes(rows, load.opening, load.held)
        good = np.asarray((self._room(boxes, load, 0) >= spare).all(axis=1))
        if self._workspace is not None:
            good &= self._workspace.room(self._tips(rows)) >= 0.0
        left = np.flatnonzero(good)
        good[left] &= ~self._figure.meets_itself(boxes.at(left), 0.0)
        return good

    def _meetings(self, boxes: Boxes, load: Load, final: int) -> list[tuple[int, str]]:
        """Rows at which things are met, and their names."""
        left = self._room(boxes, load, final)
        met = [(_first_met(column), name) for column, name in zip(left.T, self._names, strict=True)]
        itself = _first_met(np.where(self._figure.meets_itself(boxes, 0.0), -1.0, 1.0))
        return [(row, name) for row, name in [*met, (itself, ITSELF)] if row is not None]

    def _leavings(self, path: Array) -> list[tuple[int, str]]:
        """The row at which the tool point leaves the workspace, if it does."""
        if self._workspace is None:
            return []
        row = _first_met(self._workspace.room(self._tips(path)))
        return [] if row is None else [(row, EDGE)]

    def _tips(self, path: Array) -> Array:
        """(m, 3) m, where the tool point is in the world."""
        world = self._world_from_arm
        return np.asarray(self._figure.tips(path) @ world.rotation_matrix.T + np.array(world.t))

    def _room(self, boxes: Boxes, load: Load, final: int) -> Array:
        """(m, k) m that is left between the arm and each thing beyond the margin; inf where there is plenty."""
        rows, parts = boxes.centers.shape[:2]
        held = len(load.held)
        gripper = parts - self._figure.gripper_boxes(load.opening) - held
        margins = np.full((rows, parts), MARGIN)
        late = rows - final  # where the final line begins
        margins[late:, gripper:] = GRIPPER_MARGIN
        margins[late:, parts - held :] = HELD_MARGIN
        if not self._margins:
            margins = np.minimum(margins, 0.0)
        checked = np.ones((rows, parts, len(self._names)), dtype=bool)
        checked[:, : self._figure.base_boxes] = False
        if self._target is not None:
            checked[late:, gripper:, self._target] = False
        return room(boxes, self._boxes, margins, checked)


def _first_met(room: Array) -> int | None:
    """The first row without room (m), but for those at the beginning on which the arm only leaves; None if none."""
    met = np.flatnonzero(room < 0.0)
    leaving = 0
    while leaving < len(met) and met[leaving] == leaving and room[leaving] >= room[0] - _CLOSER:
        leaving += 1
    return int(met[leaving]) if leaving < len(met) else None
