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

    def held_box(self) -> tuple[LinkBox, ...]:
        """The held object in the tool's frame, if there is one with a known size."""
        name, pose = self._holding.held, self._holding.tool_from_object
        thing = None if name is None else self._scene.object(name)
        if thing is None or pose is None:
            return ()
        x, y, z = thing.size
        return (LinkBox(pose, (x / 2, y / 2, z / 2)),)

    def load(self, opening: float) -> Load:
        """What moves with the tool, with the fingers `opening` m apart."""
        return Load(opening, self.held_box())

    def things(self, now: float) -> list[Obstacle]:
        """All that must not be touched at time `now` (s), but for what the gripper holds and what is in that."""
        return [*self.things_and_zones(), *self.others.obstacles(now)]

    def things_and_zones(self) -> list[Obstacle]:
        """All that must not be touched, but for other arms, what the gripper holds, and what goes along in that."""
        objects = self._scene.objects()
        held = next((thing for thing in objects if thing.name == self._holding.held), None)
        objects = [thing for thing in objects if held is None or not (thing is held or held.is_around(thing))]
        models = self._scene.models(self.world_from_arm.t)
        return [*objects, *self._scene.tables(), *models, *self._zones.forbidden()]

    def passed_beside(self) -> set[str]:
        """The names of what no way goes above: zones and arms may be high."""
        return {zone.name for zone in self._zones.forbidden()} | set(self.others.names())

    def obstacles(self, things: Sequence[Obstacle], target: str = "") -> Obstacles:
        """A check of ways against these things, and the workspace; the gripper may be around `target` at the end."""
        return Obstacles(self.figure, things, self.world_from_arm.inverse(), target, self._zones.workspace)

    def room(self, target: str, now: float) -> Room:
        """The free space around an object, for the gripper at time `now` (s)."""
        arms = self.others.names()
        return Room(self.figure, [thing for thing in self.things(now) if thing.name not in (target, *arms)])

    def is_arm(self, name: str) -> bool:
        """Whether that is the name of another arm."""
        return name in self.others.names()
