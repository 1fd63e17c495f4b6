"""The arm's shape at given joint positions: all its collision boxes, and those that must not meet."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from agents.arm_controller.model.arm_model import ArmModel
from agents.arm_controller.model.shapes import LinkBox
from agents.arm_controller.model.urdf import fixed_pose
from dsr.errors import ConfigError
from dsr.math3d.boxes import Array, Boxes, gaps, stacked
from dsr.math3d.transforms import Pose

_NEIGHBOURS = 2
"""Links this many joints apart or less touch by construction."""


_DEPTH_STEP = 0.001  # m between two depths behind the pads that are looked at
_DEEPEST = 0.15  # m behind the pads; no gripper's palm is farther away


class Figure:
    """Collision boxes of one arm.

    Args:
        model: the arm and its gripper.

    Raises:
        ConfigError: for a link with a shape that is neither a part of the arm nor a finger.
    """

    def __init__(self, model: ArmModel) -> None:
        robot, chain, palm = model.robot, model.chain, model.palm
        self._chain = chain
        self._gripper = model.gripper
        self.widest = model.gripper.widest
        """m, between the open fingers"""
        self._tool_from_palm = model.palm_from_tool.inverse()
        links = [model.base, *(joint.child for joint in chain.moving)]
        _check_complete(model, links)
        *arm, last = links
        fixed = [(number, box) for number, link in enumerate(arm) for box in robot.rigid(link, without=palm)]
        self._links = [number for number, _ in fixed]
        self._fixed = [box for _, box in fixed]
        tool_from_last = fixed_pose(robot.between(last, model.tool)).inverse()
        self._hand = [box.seen_from(tool_from_last) for box in robot.rigid(last)]
        self._tip = len(links)
        self.base_boxes = self._links.count(0)
        """How many of the boxes stand still with the base; they come first."""

    @property
    def reach(self) -> float:
        """How far the fingers reach beyond the tool point, along the tool's z axis, m; 0 without any."""
        fingers = [box.seen_from(self._tool_from_palm) for box in self._gripper.boxes(0.0)]
        return max((float(box.corners[:, 2].max()) for box in fingers), default=0.0)

    def throat(self, width: float) -> float:
        """How far (m) something of that width between the pads may reach from the tool point towards the palm.

        Fingers of a linkage come together behind the pads.
        """
        depths = np.arange(_DEPTH_STEP, _DEEPEST, _DEPTH_STEP)
        half = max(width / 2 - _DEPTH_STEP, _DEPTH_STEP / 2)
        between = stacked((Pose((0.0, 0.0, -deep / 2)), (2 * half, _DEPTH_STEP, deep)) for deep in depths.tolist())
        parts = stacked((box.pose, box.size) for box in self.gripper(width))
        one, other = (index.ravel() for index in np.indices((len(depths), len(parts.centers))))
        free = (gaps(between.at(one), parts.at(other)) > 0.0).reshape(len(depths), -1).all(axis=1)
        return float(depths[free].max(initial=0.0))

    def gripper(self, opening: float) -> list[LinkBox]:
        """Boxes of all that is fixed to the tool, and of fingers `opening` m apart, in the tool's frame."""
        fingers = self._gripper.boxes(opening)
        return [*self._hand, *(box.seen_from(self._tool_from_palm) for box in fingers)]

    def gripper_boxes(self, opening: float) -> int:
        """How many of the boxes are of the gripper: of all that is fixed to the tool, and of the fingers."""
        return len(self.gripper(opening))

    def boxes(self, positions: Array, opening: float, held: Sequence[LinkBox] = ()) -> Boxes:
        """Boxes (m, b) in the base frame at joint `positions` (m, n), fingers `opening` m apart.

        Those of the links come first, then those of the gripper, then `held`, given in the tool's frame.
        """
        parts = [*self._fixed, *self.gripper(opening), *held]
        frames = self._chain.frames(positions)
        index = np.array([*self._links, *[self._tip] * (len(parts) - len(self._fixed))])
        local = np.array([box.pose.matrix for box in parts])
        placed = frames[:, index] @ local
        halves = np.broadcast_to(np.array([box.half for box in parts]), (*placed.shape[:2], 3))
        return Boxes(placed[..., :3, 3], placed[..., :3, :3], halves)

    def tips(self, positions: Array) -> Array:
        """(m, 3) m, where the tool point is in the base frame at joint `positions` (m, n)."""
        return np.asarray(self._chain.frames(positions)[:, -1, :3, 3])

    def meets_itself(self, boxes: Boxes, margin: float) -> NDArray[np.bool_]:
        """(m,) whether parts of the arm that are not neighbours are closer than `margin` m."""
        count = boxes.centers.shape[1]
        number = np.array([*self._links, *[self._tip - 1] * (count - len(self._fixed))])
        one, other = np.nonzero(np.subtract.outer(number, number) > _NEIGHBOURS)
        a, b = (Boxes(*(part[:, pick].reshape(-1, *part.shape[2:]) for part in boxes)) for pick in (one, other))
        close = np.linalg.norm(a.centers - b.centers, axis=1) < a.radii + b.radii + margin
        near = np.flatnonzero(close)
        hit = np.zeros(len(close), dtype=bool)
        hit[near] = gaps(a.at(near), b.at(near)) < margin
        return np.asarray(hit.reshape(len(boxes.centers), len(one)).any(axis=1))


def _check_complete(model: ArmModel, links: Sequence[str]) -> None:
    """No shape of the robot is left out: each is fixed to one of `links`, or to a finger."""
    robot = model.robot
    known = {other for link in [*links, *model.gripper.links] for other, _ in robot.fixed_to(link)}
    lost = [link for link, boxes in robot.boxes.items() if boxes and link not in known]
    if lost:
        raise ConfigError(
            f"robot {robot.name!r}: link {lost[0]!r} has a collision shape, but is neither a part of the arm from "
            f"{model.base!r} on nor a finger that hangs from {model.palm!r}; nobody would know where it is"
        )
