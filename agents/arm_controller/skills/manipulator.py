"""Building blocks of skills: moving, gripping, looking at the belief; each wait is a step that a tick advances."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from agents.arm_controller.config import ArmControllerConfig
from agents.arm_controller.execution import MotionExecution, StuckError
from agents.arm_controller.figure import Figure
from agents.arm_controller.holding import GraspEdges
from agents.arm_controller.joints import Joints
from agents.arm_controller.kinematics import JointChain, UnreachableError
from agents.arm_controller.obstacles import ITSELF, Load, Obstacles
from agents.arm_controller.others import Announcer, OtherArms
from agents.arm_controller.room import Room
from agents.arm_controller.routes import UP, BlockedError, Finding, JointGoal, Router
from agents.arm_controller.safety.zones import Zones
from agents.arm_controller.scene import ArmScene, Obstacle
from agents.arm_controller.shapes import LinkBox
from agents.arm_controller.trajectory import MotionLimits, Trajectory, resampled
from agents.drivers import ArmDriver
from dsr.errors import DsrError
from dsr.math3d.boxes import Array
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose

T = TypeVar("T")
Steps = Generator[str, None, T]
"""Yields the name of the step under way at each tick, and returns a `T` at the end."""

CLEARANCE = 0.06
"""m between a carried object on its way and everything below"""
BRAKING = 2.0
"""s in which an arm comes to rest: arms brake within one from their greatest speed"""
GRIP_PATIENCE = 2.0
"""s that the fingers may take"""
STILL_OPENING = 0.0002
"""m per sample; less is no motion of the fingers"""
SEARCHED = 3
"""Attempts for which a way around everything is searched: what is unreachable by one is often so by all"""
RESTARTS = 3
"""Random postures from which grasps from the side are solved: the arm must often turn its wrist for them"""
PIECES = 5
"""Pieces of a search in a tick: some ms each, so that the agent hears a halt within 0.1 s"""
FARTHEST = 10.0
"""m from the arm's base that no arm reaches"""
STEPPED_BACK = 0.02
"""rad from its rest, within which an arm has stepped back"""
REPLAN = 1.0
"""s between two plans of an arm that waits for another: where many grasps are blocked, a plan is much work"""
REPLAN_ANYHOW = 3.0
"""s after which it plans anew although the other one has neither moved nor changed its way: things may have moved"""
CLAIM = 0.1
"""s from the announcement of a way until the arm sets out: as long as another arm needs to hear of it, five ticks"""
ARM_PATIENCE = 30.0
"""s that an arm waits for another: longer than any skill of that one takes"""
RESUME = 3.0
"""s that an arm stands still on its way because of another, until it plans anew"""
LITTLE = 0.01
"""m that an object is lifted before it is pulled out below something: enough to be free of what it stood on"""
_FROM_ABOVE = 0.9  # least vertical part of the gripper's axis from above; objects may lean in it by 0.26 rad
_OPENED = 0.003  # m short of an opening that will do


class SkillError(DsrError):
    """A skill cannot go on."""


class ImpossibleError(SkillError):
    """A skill cannot be done as long as the belief about things stays as it is."""


class InTheWayError(SkillError):
    """No way is free.

    Args:
        by: name of what is in the way.
    """

    def __init__(self, by: str) -> None:
        super().__init__(f"{by} is in the way")
        self.by = by


class DroppedError(SkillError):
    """The gripper does not hold any more what it held."""


@dataclass(frozen=True)
class Attempt:
    """A place to go to, one of several that would do."""

    goal: JointGoal
    """Joint positions at the end."""
    opening: float
    """m between the fingers on the way"""
    target: str = ""
    """Name of the thing that the gripper may be around at the end; empty for none."""


class Manipulator:
    """One arm with its gripper and its believed surroundings; for one skill at a time.

    Args:
        chain: from the arm's base to the tool point.
        figure: its shape.
        scene: the belief.
        holding: what the gripper holds.
        driver: moves the arm.
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
        driver: ArmDriver,
        execution: MotionExecution,
        config: ArmControllerConfig,
        rng: np.random.Generator,
    ) -> None:
        self.config = config
        self.figure = figure
        self.scene = scene
        self.holding = holding
        self.speed = config.default_speed
        """0 to 1 of the joints' limits"""
        self._chain = chain
        self._zones = Zones(config.workspace, config.forbidden, scene)
        self.note = ""
        """What an action that goes on has to tell; empty for nothing."""
        self.execution = execution
        """Moves the arm along trajectories."""
        execution.announce = self._announce
        self.others = OtherArms(scene.memory, config.arm)
        """The other arms of the graph."""
        self._announcer = Announcer(scene.memory, config.arm, figure)
        self._stopped = math.inf
        self._claims: tuple[object, ...] = ()
        self._came: Array | None = None
        """(m, n) rad, the last way that was gone to its end"""
        self._driver = driver
        self._rng = rng
        self._router: Router

    def begin(self, joints: Joints, speed: float) -> None:
        """Get ready for a skill. Raises `TransformError` if it is unknown where the arm stands."""
        self.joints, self.speed, self.note, self._stopped = joints, speed, "", math.inf
        self.waits_for = ""
        self._router = Router(self._chain, self.scene.world_from(self.config.arm))

    @property
    def joints(self) -> Joints:
        """The newest sample."""
        return self.execution.joints

    @joints.setter
    def joints(self, joints: Joints) -> None:
        self.execution.joints = joints

    @property
    def waits_for(self) -> str:
        """The human part, or the arm, that the arm stands still for; empty for none."""
        return self.execution.waits_for

    @waits_for.setter
    def waits_for(self, whom: str) -> None:
        self.execution.waits_for = whom

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

    def held_box(self) -> tuple[LinkBox, ...]:
        """The held object in the tool's frame, if there is one with a known size."""
        name, pose = self.holding.held, self.tool_from_held
        thing = None if name is None else self.scene.object(name)
        if thing is None or pose is None:
            return ()
        x, y, z = thing.size
        return (LinkBox(pose, (x / 2, y / 2, z / 2)),)

    # ---- motion

    @property
    def tool(self) -> Pose:
        """world_from_tool, as measured."""
        return self._router.tool(self._here)

    def solve(self, poses: Sequence[Pose], *, thorough: bool = False) -> list[tuple[int, Array]]:
        """Joint positions for tool `poses` (world), with the index of each; the least motion first.

        Args:
            poses: of the tool.
            thorough: whether to begin at random, too, for those that are not reached from here.

        Raises:
            SkillError: if none can be reached.
        """
        arm_from_world = self.scene.world_from(self.config.arm).inverse()
        targets = [arm_from_world @ pose for pose in poses]
        if (away := max(math.hypot(*target.t) for target in targets)) > FARTHEST:
            raise SkillError(f"unreachable: {away:.3g} m away")
        tips = np.array([pose.matrix for pose in targets])
        starts = np.broadcast_to(self._here, (len(tips), len(self._here)))
        rows, reached = self._chain.track(tips, starts, self._posture)
        for _ in range(RESTARTS if thorough else 0):
            missing = np.flatnonzero(~reached)
            if not len(missing):
                break
            starts = self._chain.starts(self._here, len(missing), self._rng)[1:]
            rows[missing], reached[missing] = self._chain.track(tips[missing], starts, self._posture)
        found = [(index, row) for index, row in enumerate(rows) if reached[index]]
        if not found:
            found = [(0, self._searched(targets[0]))]
        return sorted(found, key=lambda pair: self._router.effort(self._here, pair[1]))

    def first_way(self, attempts: Sequence[Attempt], *, searched: bool = True) -> Steps[tuple[int, Trajectory]]:
        """The first of several attempts that has a free way, by its index, and that way.

        Simple ways are tried for all of them, one at each tick. Then, if one may be `searched`, a way around everything
        for the first few.

        Raises:
            InTheWayError: if all are blocked, with what blocks the first one.
        """
        blocked: BlockedError | None = None
        for index, attempt in enumerate(attempts):
            try:
                return index, self._simple(attempt)
            except BlockedError as error:
                blocked = blocked or error
            yield "plan"
        if blocked is not None and self.is_arm(blocked.by):
            raise InTheWayError(blocked.by)  # it will go away
        tries = 0
        for index, attempt in enumerate(attempts if searched else ()):
            finding = self._search(attempt)
            try:
                next(finding)
            except BlockedError:
                continue  # its end is not free
            except StopIteration as end:
                return index, end.value
            try:
                return index, (yield from self._in_pieces(finding))
            except BlockedError:
                tries += 1
            if tries == SEARCHED:
                break
        if blocked is None:
            raise SkillError("no way")
        raise InTheWayError(blocked.by)

    def _simple(self, attempt: Attempt) -> Trajectory:
        """Straight there, or up, across and down. Raises `BlockedError`."""
        held = self.held_box()
        things = self._things()
        lowest = (self.tool.t[2] - float(self.tool.apply(box.corners)[:, 2].min()) for box in held)
        below = max([self.figure.reach, *lowest])
        zones = {zone.name for zone in self._zones.forbidden()}  # they may be high, and are passed beside
        zones |= set(self.others.names())
        travel = max((thing.top for thing in things if thing.name not in zones), default=0.0) + below + CLEARANCE
        load, obstacles = Load(attempt.opening, held), self._obstacles(things, attempt.target)
        return self._router.plan(self._here, attempt.goal, load, obstacles, travel, self._limits)

    def _search(self, attempt: Attempt) -> Finding:
        """A way around everything."""
        load, obstacles = Load(attempt.opening, self.held_box()), self._obstacles(self._things(), attempt.target)
        return self._router.search(self._here, attempt.goal, load, obstacles, self._limits, self._rng)

    def _in_pieces(self, finding: Finding) -> Steps[Trajectory]:
        """The way that is found, by some pieces of the search at each tick. Raises `BlockedError`."""
        while True:
            for _ in range(PIECES):
                try:
                    next(finding)
                except StopIteration as end:
                    found: Trajectory = end.value
                    return found
            yield "plan"

    def forbids(self, joints: Joints, goal: Sequence[float]) -> str:
        """What keeps a straight way in joint space from its end, of zones and workspace; empty if nothing does.

        Raises `TransformError` if it is unknown where the arm stands.
        """
        rows = resampled(np.array([joints.positions, goal]))
        arm_from_world = self.scene.world_from(self.config.arm).inverse()
        forbidden = [*self._zones.forbidden(), *self.others.obstacles(joints.stamp)]
        zones = Obstacles(self.figure, forbidden, arm_from_world, "", self._zones.workspace)
        by = zones.blocking(rows, Load(joints.opening), len(rows))
        return "" if by in (None, ITSELF) else f"{by} is in the way"

    def room(self, target: str) -> Room:
        """The free space around an object, for the gripper."""
        arms = self.others.names()
        return Room(self.figure, [thing for thing in self._things() if thing.name not in (target, *arms)])

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

        def plan() -> Trajectory:
            load = Load(self.joints.opening, self.held_box())
            obstacles = self._obstacles(self._things(), "")
            return self._router.retreat(self._here, way, direction, load, obstacles, self._limits)

        trajectory = yield from self.cleared(lambda: at_once(plan), itself)
        attempt = Attempt(JointGoal(trajectory.positions[-1]), self.joints.opening)
        yield from self.go(trajectory, attempt, "rise", held)

    def cleared(self, plan: Callable[[], Steps[T]], way: Callable[[T], Trajectory]) -> Steps[T]:
        """A way that no other arm is on, or has claimed before; waits for that, and claims it.

        Of arms that wait for each other, the one that has wanted to go for less long steps back.

        Args:
            plan: makes a plan from here by the present belief. Raises `BlockedError` or `InTheWayError`.
            way: the way of a plan.

        Raises:
            SkillError: if another arm does not give way.
        """
        until = self.joints.stamp + ARM_PATIENCE
        while True:
            try:
                found = yield from plan()
            except (BlockedError, InTheWayError) as error:
                if error.by not in self.others.names():
                    raise
                if self.joints.stamp > until:
                    raise SkillError(f"{error}, and does not go away") from error
                yield from self._wait_for(error.by)
                continue
            if not self.others.names() or (yield from self._claim(way(found))):
                return found

    def _wait_for(self, other: str) -> Steps[None]:
        """Stand still for a moment; step back if the other arm waits for this one, and goes first."""
        self._announcer.wait_for(other, self.joints.stamp)
        self.waits_for = other
        if other in self.others.waits_for_us() and self.others.precedes(other):
            yield from self.step_back()
        began, before = self.joints.stamp, self.others.state(other)
        while self.joints.stamp < began + REPLAN or (
            self.others.state(other) == before and self.joints.stamp < began + REPLAN_ANYHOW
        ):
            yield "wait"
        self.waits_for = ""

    def _claim(self, trajectory: Trajectory) -> Steps[bool]:
        """Announce a way, and see that nobody who goes first has announced one across it meanwhile."""
        load = Load(self.joints.opening, self.held_box())
        self._announcer.announce(trajectory, self.joints.stamp, self.scene.world_from(self.config.arm), load)
        until = self.joints.stamp + CLAIM
        while self.joints.stamp < until:
            yield "claim"
        ways = self.others.obstacles_of_first(self.joints.stamp)
        return self._obstacles(ways, "").blocking(trajectory.positions, load, 0) is None

    def step_back(self) -> Steps[None]:
        """Go where the arm is in nobody's way, as far as the others let it: to its rest."""
        rest = self.config.observe_joints
        if not rest or np.abs(np.array(rest) - self._here).max() < STEPPED_BACK:
            return
        attempt = Attempt(JointGoal(np.array(rest)), self.joints.opening)
        try:
            trajectory = self._simple(attempt)
        except BlockedError:
            back = self._way_back()
            if back is None:
                return
            trajectory = back
        yield from self.go(trajectory, attempt, "step back", self.holding.held)

    def _way_back(self) -> Trajectory | None:
        """The way on which the arm came here last, if it is free."""
        if self._came is None or np.abs(self._came[-1] - self._here).max() > STEPPED_BACK:
            return None
        rows = np.vstack([self._here, self._came[::-1]])
        load = Load(self.joints.opening, self.held_box())
        by = self._obstacles(self._things(), "").blocking(resampled(rows), load, len(rows))
        return self._router.through(rows, self._limits) if by is None else None

    def start(self, trajectory: Trajectory, attempt: Attempt) -> None:
        """Begin to follow the way of an attempt: more slowly near people, and not yet if they are too near."""

        def blocking(rows: Array, final: int) -> str | None:
            obstacles = self._obstacles(self._things(), attempt.target)
            return obstacles.blocking(rows, Load(attempt.opening, self.held_box()), final)

        self.execution.start(trajectory, self._limits, blocking)
        self._claims = self.others.claims()

    def has_arrived(self) -> bool:
        """Whether the way is done. Raises `MotionError` as `MotionExecution.has_arrived`, `SkillError` for an arm."""
        if self.execution.keeps_distance() or self._minds_arms():
            return False
        arrived = self.execution.has_arrived()
        if arrived:
            self._came = self.execution.way
            self._announcer.withdraw()
        return arrived

    def _announce(self, trajectory: Trajectory) -> None:
        if self.others.names():
            world_from_arm, load = self.scene.world_from(self.config.arm), Load(self.joints.opening, self.held_box())
            self._announcer.announce(trajectory, self.joints.stamp, world_from_arm, load)

    def is_arm(self, name: str) -> bool:
        """Whether that is the name of another arm."""
        return name in self.others.names()

    def near_arm(self, joints: Joints) -> str:
        """Name of another arm into which this one moves; empty for none. Raises `TransformError` if it is lost."""
        if not self.others.names():
            return ""
        return self.others.is_near(self.figure, self.scene.world_from(self.config.arm), joints)

    def _minds_arms(self) -> bool:
        """Stop if the arm moves into another one; go on when its way is free.

        Raises `SkillError` if it is not within a few seconds.
        """
        if self._stopped == math.inf:
            if not (near := self.near_arm(self.joints) or self._overtaken()):
                return False
            self.hold_still()
            self._stopped, self.waits_for = self.joints.stamp, near
            self._announcer.wait_for(near, self.joints.stamp)
        elif max(map(abs, self.joints.velocities)) <= self.config.still_speed:
            rows = self.execution.rest.positions
            load = Load(self.joints.opening, self.held_box())
            by = self._obstacles(self.others.obstacles(self.joints.stamp), "").blocking(rows, load, len(rows))
            if by is None:
                self._stopped, self.waits_for = math.inf, ""
                self.execution.go_on()
            elif self.joints.stamp - self._stopped > RESUME:
                raise SkillError(f"{by} is in the way")
        return True

    def _overtaken(self) -> str:
        """Name of an arm that goes first and has announced a way across what is left of this one; empty for none.

        It may have done so at the same moment, and been heard late.
        """
        claims = self.others.claims()
        if claims == self._claims:
            return ""
        self._claims = claims
        rows, load = self.execution.rest.positions, Load(self.joints.opening, self.held_box())
        ways = self.others.obstacles_of_first(self.joints.stamp)
        return self._obstacles(ways, "").blocking(rows, load, 0) or ""

    def away(self) -> float:
        """Distance of the tool point from its commanded place, m."""
        return self._router.tool(self.execution.goal).distance(self.tool)[0]

    def go(self, trajectory: Trajectory, attempt: Attempt, step: str, held: str | None) -> Steps[None]:
        """Follow a way to its end. Raises `SkillError` if the gripper does not hold `held` all the way."""
        self.start(trajectory, attempt)
        while not self.has_arrived():
            yield step
            self.check_held(held)

    def hold_still(self) -> None:
        """Stop at once; the grip stays. The arm takes a moment to brake."""
        self._driver.stop()
        self._announcer.withdraw()

    def finish(self) -> None:
        """Note the end of a skill: the arm wants to go nowhere."""
        self._announcer.withdraw()

    def settle(self) -> Steps[None]:
        """Wait until the arm stands still. Raises `StuckError` if it does not."""
        until = self.joints.stamp + BRAKING
        while max(map(abs, self.joints.velocities)) > self.config.still_speed:
            if self.joints.stamp > until:
                raise StuckError(f"the arm does not come to rest within {BRAKING:g} s")
            yield "settle"

    # ---- gripper

    def open(self, opening: float) -> Steps[None]:
        """Open to at least `opening` m."""
        self._driver.move_gripper(opening)
        until = self.joints.stamp + GRIP_PATIENCE
        while abs(self.joints.opening - opening) > _OPENED:
            if self.joints.stamp > until:
                raise SkillError(f"the gripper stands still at {self.joints.opening * 1e3:.0f} mm")
            yield "open"

    def close(self) -> Steps[bool]:
        """Close until the fingers stand still; returns whether both pads touch something."""
        self._driver.move_gripper(0.0)
        still, last, until = 0, self.joints.opening, self.joints.stamp + GRIP_PATIENCE
        while still < 4 and self.joints.stamp < until:
            yield "close"
            still = still + 1 if abs(self.joints.opening - last) < STILL_OPENING else 0
            last = self.joints.opening
        return self.joints.contact

    # ---- inside

    @property
    def _here(self) -> Array:
        return self.execution.here

    @property
    def _posture(self) -> Array:
        wanted = self.config.posture or self.config.observe_joints
        return np.array(wanted) if wanted else self._here

    @property
    def _limits(self) -> MotionLimits:
        return MotionLimits(self.speed, self.config.acceleration, self.config.jerk)

    def _things(self) -> list[Obstacle]:
        objects = [thing for thing in self.scene.objects() if thing.name != self.holding.held]
        base = self.scene.world_from(self.config.arm).t
        arms = self.others.obstacles(self.joints.stamp)
        return [*objects, *self.scene.tables(), *self.scene.models(base), *self._zones.forbidden(), *arms]

    def _obstacles(self, things: Sequence[Obstacle], target: str) -> Obstacles:
        arm_from_world = self.scene.world_from(self.config.arm).inverse()
        return Obstacles(self.figure, things, arm_from_world, target, self._zones.workspace)

    def _searched(self, arm_from_tool: Pose) -> Array:
        try:
            found = self._chain.inverse(arm_from_tool, self._here, rng=self._rng, posture=self._posture)
        except UnreachableError as error:
            raise SkillError(f"unreachable: {error}") from error
        return np.array(found.positions)


def itself(trajectory: Trajectory) -> Trajectory:
    """The way of a plan that is a way."""
    return trajectory


def at_once(plan: Callable[[], T]) -> Steps[T]:
    """A plan that is made within one tick, as steps."""
    yield from ()
    return plan()
