"""Finds the object that the gripper holds, by the gripper's contact and the believed pose of the object between its
pads.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from agents.arm_controller.config import ArmControllerConfig
from agents.arm_controller.grasping.forms import PLAIN, form
from agents.arm_controller.joints import Joints
from agents.arm_controller.scene import ArmScene, Obstacle
from dsr import Memory
from dsr.errors import TransformError
from dsr.math3d.transforms import Pose

LOST_AFTER = 0.1
"""s without contact after which an object counts as lost"""
WIDTH_TOLERANCE = 0.008
"""m by which an opening may differ from the width of what is between the pads"""

_SEARCH_PERIOD = 0.1  # s between two looks at the belief while what is touched is unknown
_ASKEW = 0.35  # rad about the vertical up to which pads turn a face towards them
_BESIDE = 0.012  # m that the tool point may be outside of the believed object
_CATCHING_UP = 1.0  # s in which the belief of what is known to be held may come to where the gripper is


@dataclass(frozen=True)
class Expected:
    """What fingers are about to close on."""

    name: str
    width: float
    """m of it between the pads"""
    tool_from_object: Pose
    """Where it will be between them."""


class GraspEdges:
    """Keeps the edge `gripper -grasping-> object` in step with the gripper.

    Args:
        memory: where the edge goes.
        scene: the belief.
        config: names.
        forward: arm_from_tool at joint positions.
        gripper_from_tool: from the gripper's node to the tool point; fixed.
    """

    def __init__(
        self,
        memory: Memory,
        scene: ArmScene,
        config: ArmControllerConfig,
        forward: Callable[[tuple[float, ...]], Pose],
        gripper_from_tool: Pose,
    ) -> None:
        self._memory = memory
        self._scene = scene
        self._config = config
        self._forward = forward
        self.gripper_from_tool = gripper_from_tool
        """As given."""
        self.held: str | None = None
        """Name of the object in the gripper."""
        self.tool_from_object: Pose | None = None
        """Where it was in the gripper when it was grasped: as believed, with its faces on the pads."""
        self._grasped: Obstacle | None = None
        """The object as it was believed when it was grasped."""
        self._expected: Expected | None = None
        self._contact_at = -math.inf
        self._look_at = -math.inf
        self._doubtful_since: float | None = None

    @property
    def held_object(self) -> Obstacle | None:
        """The object in the gripper, as believed, or as it was believed last if it is nowhere now; None for none."""
        if self.held is not None:
            self._grasped = self._scene.object(self.held) or self._grasped
        return None if self.held is None else self._grasped

    def expect(self, expected: Expected | None) -> None:
        """Tell what the fingers are about to close on; None: whatever is there."""
        self._expected = expected

    def tick(self, joints: Joints) -> None:
        """Take over one sample of the gripper."""
        if joints.contact:
            self._contact_at = joints.stamp
            if self.held is None and joints.stamp >= self._look_at:
                self._look_at = joints.stamp + _SEARCH_PERIOD
                self._search(joints)
        elif joints.stamp - self._contact_at > LOST_AFTER:
            self._lose()
        if self.held is not None and self._memory.get_edge(self._config.gripper, self.held, "grasping") is None:
            self.held = None  # its node is gone, or somebody removed the edge

    def _search(self, joints: Joints) -> None:
        known = [edge.dst for edge in self._memory.edges("grasping", src=self._config.gripper)]
        try:
            world_from_tool = self._scene.world_from(self._config.arm) @ self._forward(joints.positions)
        except TransformError:
            return
        candidates = [thing for name in known if (thing := self._scene.object(name)) is not None]
        if not known and (meant := self._meant(world_from_tool, joints.opening)) is not None:
            self._take(meant, world_from_tool, joints.stamp, known)
            return
        found = _between(candidates or self._scene.objects(), world_from_tool, joints.opening)
        if found is None and candidates:
            self._look_at = joints.stamp
            found = None if self._is_catching_up(joints.stamp) else candidates[0]
        if found is None:
            return
        self._take(found, world_from_tool, joints.stamp, known)

    def _meant(self, world_from_tool: Pose, opening: float) -> Obstacle | None:
        """What the fingers were to close on, if that is between them."""
        expected = self._expected
        thing = None if expected is None else self._scene.object(expected.name)
        if expected is None or thing is None or abs(opening - expected.width) > WIDTH_TOLERANCE:
            return None
        away = expected.tool_from_object.distance(world_from_tool.inverse() @ thing.pose)[0]
        return thing if away <= _BESIDE else None

    def _take(self, found: Obstacle, world_from_tool: Pose, stamp: float, known: list[str]) -> None:
        """The gripper holds this, as the graph may know already."""
        self._doubtful_since = None
        self.tool_from_object = self._corrected(world_from_tool.inverse() @ found.pose, found)
        self.held, self._grasped = found.name, found
        if found.name not in known:
            held_at = self.gripper_from_tool @ self.tool_from_object
            values = {"since": stamp, "source": "gripper", "held_at": held_at}
            self._memory.add_edge(self._config.gripper, found.name, "grasping", **values)

    def _corrected(self, tool_from_object: Pose, found: Obstacle) -> Pose:
        """The believed pose, corrected by what closed pads know of the form between them."""
        expected = self._expected
        if expected is not None and expected.name == found.name and form(found) != PLAIN:
            _, y, z = tool_from_object.t
            return Pose((expected.tool_from_object.t[0], y, z), tool_from_object.q)
        return _between_pads(tool_from_object)

    def _is_catching_up(self, now: float) -> bool:
        """Whether the belief may still be where the gripper was before this agent was restarted."""
        if self._doubtful_since is None:
            self._doubtful_since = now
        return now - self._doubtful_since < _CATCHING_UP

    def _lose(self) -> None:
        self.held = self.tool_from_object = self._doubtful_since = None
        for edge in self._memory.edges("grasping", src=self._config.gripper):
            self._memory.remove_edge(edge.src, edge.dst, "grasping")


def _between(things: list[Obstacle], world_from_tool: Pose, opening: float) -> Obstacle | None:
    """The one between pads that are `opening` m apart, the closest to the tool point; None if none fits."""
    tool_from_world = world_from_tool.inverse()
    found: list[tuple[float, Obstacle]] = []
    for thing in things:
        inside = Obstacle(thing.name, tool_from_world @ thing.pose, thing.size)
        fits = any(abs(edge - opening) <= WIDTH_TOLERANCE for edge in thing.size)
        beside = max(abs(offset) - half for offset, half in zip(inside.pose.t, (0.0, *inside.reach[1:]), strict=True))
        if fits and beside <= _BESIDE:
            found.append((math.dist(inside.pose.t, (0.0, 0.0, 0.0)), thing))
    return min(found, key=lambda pair: pair[0])[1] if found else None


def _between_pads(tool_from_object: Pose) -> Pose:
    """The believed pose, corrected by what closed pads know: the object is midway between them, its face along them."""
    _, y, z = tool_from_object.t
    turn = tool_from_object.rotation_matrix
    side = turn[:, int(np.argmax(np.abs(turn[0])))]
    askew = math.atan2(side[1], side[0])
    askew -= math.pi * round(askew / math.pi)
    if abs(askew) > _ASKEW:
        return Pose((0.0, y, z), tool_from_object.q)
    aligned = Pose.from_rotvec((0.0, 0.0, 0.0), (0.0, 0.0, -askew)) @ Pose((0.0, 0.0, 0.0), tool_from_object.q)
    return Pose((0.0, y, z), aligned.q)
