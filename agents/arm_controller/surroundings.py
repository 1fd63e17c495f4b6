"""What one arm must not touch, as it is believed to be now, and what the arm carries."""

from __future__ import annotations

from collections.abc import Sequence

from agents.arm_controller.config import ArmControllerConfig
from agents.arm_controller.grasping.holding import GraspEdges
from agents.arm_controller.grasping.room import Room
from agents.arm_controller.model.figure import Figure
from agents.arm_controller.model.shapes import LinkBox
from agents.arm_controller.motion.obstacles import Load, Obstacles
from agents.arm_controller.motion.others import OtherArms
from agents.arm_controller.safety.zones import Zones
from agents.arm_controller.scene import ArmScene, Obstacle
from dsr.math3d.transforms import Pose


class ArmSurroundings:
    """Things, zones and other arms around one arm; read anew with each call.

    Args:
        figure: the arm's shape.
        scene: the belief.
        holding: what the gripper holds.
        config: the arm's name, and its zones.

    Raises:
        ConfigError: for a zone without an inside.
    """

    def __init__(self, figure: Figure, scene: ArmScene, holding: GraspEdges, config: ArmControllerConfig) -> None:
        self.figure = figure
        """The arm's shape."""
        self.others = OtherArms(scene.memory, config.arm)
        """The other arms of the graph."""
        self._scene, self._holding, self._arm = scene, holding, config.arm
        self._zones = Zones(config.workspace, config.forbidden, scene)

    @property
    def world_from_arm(self) -> Pose:
        """Where the arm stands. Raises `TransformError` if that is unknown."""
        return self._scene.world_from(self._arm)

    def held_boxes(self) -> tuple[LinkBox, ...]:
        """What moves with the tool, in its frame: the held object, and what goes along in that.

        An object that is believed nowhere any more, although the gripper holds it, is as large as when it was grasped.
        """
        held, tool_from_held = self._holding.held_object, self._holding.tool_from_object
        if held is None or tool_from_held is None:
            return ()
        tool_from_world = tool_from_held @ held.pose.inverse()
        return tuple(_box(tool_from_world @ thing.pose, thing) for thing in (held, *self._going_along(held)))

    def load(self, opening: float) -> Load:
        """What moves with the tool, with the fingers `opening` m apart."""
        return Load(opening, self.held_boxes())

    def things(self, now: float) -> list[Obstacle]:
        """All that must not be touched at time `now` (s), but for what the gripper holds and what is in that."""
        return [*self.things_and_zones(), *self.others.obstacles(now)]

    def things_and_zones(self) -> list[Obstacle]:
        """All that must not be touched, each once, but for other arms, what the gripper holds, and what is in that."""
        held = self._holding.held_object
        along = set() if held is None else {held.name, *(thing.name for thing in self._going_along(held))}
        bodies = self._scene.bodies(self.world_from_arm.t)
        return [*(thing for thing in bodies if thing.name not in along), *self._zones.forbidden()]

    def _going_along(self, held: Obstacle) -> list[Obstacle]:
        """What is in a hollow of the held object."""
        return [thing for thing in self._scene.objects() if thing.name != held.name and held.is_around(thing)]

    def passed_beside(self) -> set[str]:
        """The names of what no way goes above: zones and arms may be high."""
        return {zone.name for zone in self._zones.forbidden()} | set(self.others.names())

    def obstacles(self, things: Sequence[Obstacle], target: str = "", *, margins: bool = True) -> Obstacles:
        """A check of ways against these things, and the workspace; the gripper may be around `target` at the end.

        Without `margins`, the arm only must not be in the things.
        """
        place, workspace = self.world_from_arm.inverse(), self._zones.workspace
        return Obstacles(self.figure, things, place, target, workspace, margins=margins)

    def room(self, target: str, now: float) -> Room:
        """The free space around an object, for the gripper at time `now` (s)."""
        arms = self.others.names()
        return Room(self.figure, [thing for thing in self.things(now) if thing.name not in (target, *arms)])

    def is_arm(self, name: str) -> bool:
        """Whether that is the name of another arm."""
        return name in self.others.names()


def _box(tool_from_thing: Pose, thing: Obstacle) -> LinkBox:
    x, y, z = thing.size
    return LinkBox(tool_from_thing, (x / 2, y / 2, z / 2))
