"""The things that the experimenter can move, and those in the experimenter's hands now."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from agents.plant.arm import SimulatedArm
from agents.plant.camera import SimulatedCamera
from agents.plant.hands import Hands
from agents.plant.persons import Persons
from agents.plant.world import GRAVITY, STEP, World
from dsr.math3d import quaternions
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose
from dsr.vocabulary.arms import gripper_of


class RigidGrip:
    """An object in the experimenter's hand, and those that come along rigidly with it; its contents need not."""

    def __init__(self, world: World, leader: str, supported: Iterable[str]) -> None:
        self._world = world
        self.pose = world.pose(leader)
        """world_from_leader"""
        self._next = self.pose
        leader_from_world = self.pose.inverse()
        self._offsets = {leader: Pose.identity()}
        self._offsets |= {carried: leader_from_world @ world.pose(carried) for carried in supported}

    @property
    def names(self) -> tuple[str, ...]:
        """The leader, then the objects that it carries."""
        return tuple(self._offsets)

    def move_to(self, pose: Pose) -> None:
        """Let the leader be at `pose` (world) after the next step of physics."""
        self._next = pose

    def drop(self, name: str) -> None:
        """Let a carried object go its own way."""
        self._offsets.pop(name, None)

    def act(self) -> None:
        """Set poses and velocities for the next step of physics, against gravity."""
        for name, offset in self._offsets.items():
            here, there = self.pose @ offset, self._next @ offset
            turn = quaternions.product(there.q, quaternions.conjugate(here.q))
            x, y, z = _per_step(here.t, there.t)
            spin = _per_step((0.0, 0.0, 0.0), quaternions.to_rotvec(turn))
            self._world.drive(name, here, (x, y, z + GRAVITY * STEP), spin)
        self.pose = self._next

    def rest(self) -> None:
        """Put all objects where they are now, at rest."""
        for name, offset in self._offsets.items():
            self._world.put(name, self.pose @ offset)


class Stage:
    """The true world with its arms and cameras, as the experimenter's moves see it.

    Args:
        world: the objects.
        arms: by name; they lose what the experimenter takes.
        cameras: by name.
        default_camera: the one meant when a move names none.
        hands: the experimenter's hands that can be seen.
        persons: who may be in the scene.
    """

    def __init__(
        self,
        world: World,
        arms: Mapping[str, SimulatedArm],
        cameras: Mapping[str, SimulatedCamera],
        default_camera: str,
        hands: Hands,
        persons: Persons,
    ) -> None:
        self.world = world
        self.arms = arms
        self.hands = hands
        self.persons = persons
        self._cameras = cameras
        self._default_camera = default_camera
        self._grips: dict[str, RigidGrip] = {}
        self.arm_error: Vector3 = (0.0, 0.0, 0.0)
        """m, world: where the first arm's sensors say the tool is, minus where it is"""

    def camera(self, name: str | None) -> SimulatedCamera:
        """The camera called `name`, or the scenario's."""
        return self._cameras[name or self._default_camera]

    def take(self, name: str, *, contents: bool) -> RigidGrip:
        """Take an object into the hand, with everything on it if `contents`; what lies in it is left to physics."""
        held = self._grips.get(name)
        if held is not None and contents and len(held.names) > 1:
            return held
        self.free(name)
        grip = RigidGrip(self.world, name, self.world.supported(name, enclosed=False) if contents else ())
        for taken in grip.names:
            self.free(taken)
        self._grips[name] = grip
        return grip

    def holds(self, name: str) -> bool:
        """Whether `take` took an object, or a hand holds it in any way."""
        return name in self._grips or any(hand.held == name for hand in self.hands.present)

    def release(self, name: str) -> None:
        """Let go of what `take` took, at rest; harmless when it is not held."""
        grip = self._grips.pop(name, None)
        if grip is not None:
            grip.rest()

    def free(self, name: str) -> None:
        """Take an object out of whatever holds it: the experimenter's hand or the gripper."""
        self._grips.pop(name, None)
        for grip in self._grips.values():
            grip.drop(name)
        for arm in self.arms.values():
            if arm.held == name:
                arm.let_go()

    def is_gripped(self, name: str) -> bool:
        """Whether an arm's gripper holds the object."""
        return any(arm.held == name for arm in self.arms.values())

    def is_held(self, name: str) -> bool:
        """Whether the experimenter or a gripper holds the object."""
        return self.is_gripped(name) or any(name in grip.names for grip in self._grips.values())

    def grasped(self) -> dict[str, str]:
        """Names of the held objects, each with its holder.

        A gripper's node, `human_hand_0`, or `unknown` for the experimenter; not what only comes along.
        """
        held = {arm.held: gripper_of(name) for name, arm in self.arms.items() if arm.held is not None}
        dragged = {name: hand for name, hand in self.hands.holding("touch").items() if name in self._grips}
        return held | dict.fromkeys(self._grips, "unknown") | dict(self.hands.holding("pinch")) | dragged

    def act(self) -> None:
        """Move what is held, for the next step of physics."""
        self.world.hold({name for grip in self._grips.values() for name in grip.names})
        for grip in self._grips.values():
            grip.act()
        for hand in self.hands.present:
            if hand.held in self._grips:
                hand.follow(self._grips[hand.held].pose)
            elif hand.held is not None and hand.style == "pinch":  # somebody took it
                hand.let_go()


def _per_step(start: Vector3, end: Vector3) -> Vector3:
    """The rate, per second, that covers the way in one step of physics."""
    return (end[0] - start[0]) / STEP, (end[1] - start[1]) / STEP, (end[2] - start[2]) / STEP
