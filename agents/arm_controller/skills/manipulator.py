"""Building blocks of skills: moving, gripping, looking at the belief; each wait is a step that a tick advances."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from agents.arm_controller.config import ArmControllerConfig
from agents.arm_controller.grasping.holding import GraspEdges
from agents.arm_controller.grasping.pressing import GentleFingers
from agents.arm_controller.joints import Joints
from agents.arm_controller.model.figure import Figure
from agents.arm_controller.model.kinematics import JointChain
from agents.arm_controller.motion.execution import MotionExecution, OvertakenError, StuckError
from agents.arm_controller.motion.others import Announcer
from agents.arm_controller.motion.routes import UP, BlockedError, JointGoal
from agents.arm_controller.motion.trajectory import Trajectory
from agents.arm_controller.safety.intruders import Intruders
from agents.arm_controller.scene import ArmScene, Obstacle
from agents.arm_controller.skills.right_of_way import RightOfWay
from agents.arm_controller.skills.steps import Attempt, DroppedError, SkillError, Steps, at_once
from agents.arm_controller.skills.ways import Ways
from agents.arm_controller.surroundings import ArmSurroundings
from dsr.math3d.boxes import Array
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose

BRAKING = 2.0
"""s in which an arm comes to rest: arms brake within one from their greatest speed"""
GRIP_PATIENCE = 2.0
"""s that the fingers may take"""
STILL_OPENING = 0.0002
"""m per sample; less is no motion of the fingers"""
LITTLE = 0.01
"""m that an object is lifted before it is pulled out below something: enough to be free of what it stood on"""
_FROM_ABOVE = 0.9  # least vertical part of the gripper's axis from above; objects may lean in it by 0.26 rad
_OPENED = 0.003  # m short of an opening that will do


class Manipulator:
    """One arm with its gripper and its believed surroundings; for one skill at a time.

    Args:
        chain: from the arm's base to the tool point.
        figure: its shape.
        scene: the belief.
        holding: what the gripper holds.
        fingers: moves them.
        execution: moves the arm along trajectories.
        config: speeds and heights.
        rng: starting points of the inverse kinematics.
    """

    def __init__(
        self,
        chain: JointChain,
        figure: Figure,
        scene: ArmScene,
        holding: GraspEdges,
        fingers: GentleFingers,
        execution: MotionExecution,
        config: ArmControllerConfig,
        rng: np.random.Generator,
    ) -> None:
        self.config = config
        self.figure = figure
        self.scene = scene
        self.holding = holding
        self.note = ""
        """What an action that goes on has to tell; empty for nothing."""
        self.execution = execution
        """Moves the arm along trajectories."""
        self.around = ArmSurroundings(figure, scene, holding, config)
        """What must not be touched."""
        self.ways = Ways(chain, self.around, execution, config, rng)
        """Plans."""
        announcer = Announcer(scene.memory, config.arm, figure)
        self.right_of_way = RightOfWay(self.ways, self.around, execution, announcer, config, self._go_back)
        """Gives way to other arms."""
        self.fingers = fingers
        """Opens and closes the gripper."""
        self._intruders, self._intruder = Intruders(), ""
        self._meets: Callable[[Sequence[Obstacle], Array, int, bool], str | None]

    def begin(self, joints: Joints, speed: float) -> None:
        """Get ready for a skill, at `speed` (0 to 1 of the joints' limits).

        Raises `TransformError` if it is unknown where the arm stands.
        """
        self.joints, self.note, self.execution.waits_for = joints, "", ""
        self.right_of_way.begin()
        self.ways.begin(speed)

    @property
    def joints(self) -> Joints:
        """The newest sample."""
        return self.execution.joints

    @joints.setter
    def joints(self, joints: Joints) -> None:
        self.execution.joints = joints

    # ---- belief

    def believed(self, name: str) -> Obstacle:
        """The object as it is believed to be now. Raises `SkillError` if it is not."""
        thing = self.scene.object(name)
        if thing is None:
            raise SkillError(f"{name} is not believed to be anywhere")
        return thing

    def check_held(self, name: str | None) -> None:
        """Hold still and raise `SkillError` if the gripper does not hold this (None: nothing) any more."""
        if self.holding.held != name:
            self.hold_still()
            if name:
                raise DroppedError(f"dropped {name}")
            raise SkillError(f"the gripper holds {self.holding.held}")

    @property
    def tool_from_held(self) -> Pose | None:
        """Pose of the held object in the tool's frame, between the pads; None if nothing is held."""
        return self.holding.tool_from_object

    # ---- motion

    @property
    def tool(self) -> Pose:
        """world_from_tool, as measured."""
        return self.ways.tool(self.execution.here)

    def rise(self, held: str | None) -> Steps[None]:
        """Move the tool straight up, with `held` in the gripper."""
        yield from self.retreat(UP, held)

    def lift(self, held: str, way: float) -> Steps[None]:
        """Lift the object `held`: straight up, or where that is blocked a little, and then `way` m out again."""
        try:
            yield from self.rise(held)
        except BlockedError:
            if self.out == UP:
                raise
            yield from self.retreat(UP, held, LITTLE)
            yield from self.retreat(self.out, held, way)

    @property
    def out(self) -> Vector3:
        """Unit vector (world) out of where the gripper works: up if it came from above, else against its fingers."""
        x, y, z = (-self.tool.rotation_matrix[:, 2]).tolist()
        return UP if z > _FROM_ABOVE else (x, y, z)

    def retreat(self, direction: Vector3, held: str | None, length: float | None = None) -> Steps[None]:
        """Move the tool straight along a unit vector (world), with `held` in the gripper; by `approach` m if None."""
        way = self.config.approach if length is None else length

        plan = partial(self.ways.retreat, direction, way)
        trajectory = yield from self.right_of_way.cleared(lambda: at_once(plan), itself)
        attempt = Attempt(JointGoal(trajectory.positions[-1]), self.joints.opening)
        yield from self.go(trajectory, attempt, "rise", held)

    def start(self, trajectory: Trajectory, attempt: Attempt) -> None:
        """Begin to follow the way of an attempt: more slowly near people, and not yet if they are too near.

        The arm stays where it is if something has come into the way since it was planned; `has_arrived` tells then.
        """

        def meets(things: Sequence[Obstacle], rows: Array, final: int, margins: bool = True) -> str | None:
            if not things:
                return None
            obstacles = self.around.obstacles(things, attempt.target, margins=margins)
            return obstacles.blocking(rows, self.around.load(attempt.opening), final)

        self._meets = meets
        self._intruders.expect(self.ways.things)
        self._intruder = self._come_in_the_way(trajectory.positions, trajectory.final)
        if not self._intruder:
            blocking = lambda rows, final: meets(self.around.things(self.joints.stamp), rows, final)  # noqa: E731
            self.execution.start(trajectory, self.ways.limits, blocking)
            self.right_of_way.set_out()

    def _come_in_the_way(self, rows: Array, final: int) -> str:
        """Name of a thing or zone that has come into the way (m, n) since it was planned; empty for none."""
        moved, doubtful = self._intruders.among(self.around.things_and_zones())
        return self._meets(moved, rows, final, True) or self._meets(doubtful, rows, final, False) or ""

    def has_arrived(self) -> bool:
        """Whether the way is done.

        Raises:
            OvertakenError: if something has come into the way; the arm is stopped then.
            MotionError: as `MotionExecution.has_arrived`.
            SkillError: if another arm does not leave the way.
        """
        if by := self._intruder or self._come_in_the_way(*self.execution.left):
            self.hold_still()
            raise OvertakenError(f"{by} is in the way")
        if self.execution.keeps_distance() or self.right_of_way.stands_still():
            return False
        arrived = self.execution.has_arrived()
        if arrived:
            self.right_of_way.arrive()
        return arrived

    def away(self) -> float:
        """Distance of the tool point from its commanded place, m."""
        return self.ways.tool(self.execution.goal).distance(self.tool)[0]

    def go(self, trajectory: Trajectory, attempt: Attempt, step: str, held: str | None) -> Steps[None]:
        """Follow a way to its end. Raises `SkillError` if the gripper does not hold `held` all the way."""
        self.start(trajectory, attempt)
        while not self.has_arrived():
            yield step
            self.check_held(held)

    def hold_still(self) -> None:
        """Stop at once; the grip stays. The arm takes a moment to brake."""
        self.execution.stop()
        self.right_of_way.withdraw()

    def settle(self) -> Steps[None]:
        """Wait until the arm stands still. Raises `StuckError` if it does not."""
        until = self.joints.stamp + BRAKING
        while self.execution.moves:
            if self.joints.stamp > until:
                raise StuckError(f"the arm does not come to rest within {BRAKING:g} s")
            yield "settle"

    # ---- gripper

    def open(self, opening: float) -> Steps[None]:
        """Open to at least `opening` m."""
        self.fingers.move(opening, self.joints)
        until = self.joints.stamp + GRIP_PATIENCE
        while abs(self.joints.opening - opening) > _OPENED:
            if self.joints.stamp > until:
                raise SkillError(f"the gripper stands still at {self.joints.opening * 1e3:.0f} mm")
            yield "open"

    def close(self) -> Steps[bool]:
        """Close until the fingers stand still, or press hard enough; returns whether both pads touch something.

        Raises `SkillError` where nobody could tell how hard they press.
        """
        if problem := self.fingers.problem(self.joints):
            raise SkillError(problem)
        self.fingers.move(0.0, self.joints)
        still, last, until = 0, self.joints.opening, self.joints.stamp + GRIP_PATIENCE
        while (still < 4 or not self.fingers.is_settled(self.joints)) and self.joints.stamp < until:
            yield "close"
            still = still + 1 if abs(self.joints.opening - last) < STILL_OPENING else 0
            last = self.joints.opening
        return self.joints.contact

    def _go_back(self, trajectory: Trajectory, attempt: Attempt) -> Steps[None]:
        """Follow a way for another arm."""
        yield from self.go(trajectory, attempt, "step back", self.holding.held)


def itself(trajectory: Trajectory) -> Trajectory:
    """The way of a plan that is a way."""
    return trajectory
