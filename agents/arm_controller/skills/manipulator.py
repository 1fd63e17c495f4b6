"""Building blocks of skills: moving, gripping, looking at the belief; each wait is a step that a tick advances."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence
from typing import TypeVar

import numpy as np

from agents.arm_controller.config import ArmControllerConfig
from agents.arm_controller.figure import Figure
from agents.arm_controller.holding import GraspEdges
from agents.arm_controller.joints import Joints
from agents.arm_controller.kinematics import JointChain, UnreachableError
from agents.arm_controller.obstacles import ITSELF, Load, Obstacles
from agents.arm_controller.others import Announcer, OtherArms
from agents.arm_controller.room import Room
from agents.arm_controller.routes import BlockedError, JointGoal, Router
from agents.arm_controller.safety.following import Following
from agents.arm_controller.safety.separation import PeopleNearby
from agents.arm_controller.safety.zones import Zones
from agents.arm_controller.scene import ArmScene, Obstacle
from agents.arm_controller.shapes import LinkBox
from agents.arm_controller.trajectory import PERIOD, MotionLimits, Trajectory, resampled
from agents.drivers import ArmDriver
from dsr.errors import DsrError
from dsr.math3d.boxes import Array
from dsr.math3d.transforms import Pose

T = TypeVar("T")
Steps = Generator[str, None, T]
"""Yields the name of the step under way at each tick, and returns a `T` at the end."""

CLEARANCE = 0.06
"""m between a carried object on its way and everything below"""
PATIENCE = 0.5
"""s that a motion may take longer than planned"""
BRAKING = 2.0
"""s in which an arm comes to rest: arms brake within one from their greatest speed"""
GRIP_PATIENCE = 2.0
"""s that the fingers may take"""
STILL_OPENING = 0.0002
"""m per sample; less is no motion of the fingers"""
SOON = 0.2
"""s ahead within which the speed of the tool point counts: the reaction time, and a tick"""
MEANT = 0.98
"""Share of the allowed speed that a trajectory is made for: a trajectory at its limit is not stopped by rounding"""
FARTHEST = 10.0
"""m from the arm's base that no arm reaches"""
STEPPED_BACK = 0.02
"""rad from its rest, within which an arm has stepped back"""
REPLAN = 0.5
"""s between two plans of an arm that waits for another: a plan takes up to 0.1 s of a processor, and a motion 1 s"""
REPLAN_ANYHOW = 3.0
"""s after which it plans anew although the other one has neither moved nor changed its way: things may have moved"""
CLAIM = 0.06
"""s from the announcement of a way until the arm sets out: as long as another arm needs to hear of it, three ticks"""
ARM_PATIENCE = 30.0
"""s that an arm waits for another: longer than any skill of that one takes"""
RESUME = 3.0
"""s that an arm stands still on its way because of another, until it plans anew"""
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


class StuckError(SkillError):
    """The arm does not get where it was sent."""


class Manipulator:
    """One arm with its gripper and its believed surroundings; for one skill at a time.

    Args:
        chain: from the arm's base to the tool point.
        figure: its shape.
        scene: the belief.
        holding: what the gripper holds.
        driver: moves the arm.
        follow: has the driver pass through joint positions of the chain.
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
        follow: Callable[[Trajectory], None],
        config: ArmControllerConfig,
        rng: np.random.Generator,
    ) -> None:
        self.config = config
        self.figure = figure
        self.scene = scene
        self.holding = holding
        self.joints: Joints
        """The newest sample."""
        self.speed = config.default_speed
        """0 to 1 of the joints' limits"""
        self._chain = chain
        self._zones = Zones(config.workspace, config.forbidden, scene)
        self._people = PeopleNearby(scene.memory, figure, config.arm)
        self.others = OtherArms(scene.memory, config.arm)
        """The other arms of the graph."""
        self._announcer = Announcer(scene.memory, config.arm, figure)
        self._stopped = math.inf
        self.waits_for = ""
        """The human part, or the arm, that the arm stands still for; empty for none."""
        self._trajectory: Trajectory
        self._came: Array | None = None
        """(m, n) rad, the last way that was gone to its end"""
        self._driver = driver
        self._follow = follow
        self._rng = rng
        self._router: Router
        self._end = 0.0
        self._goal: Array
        self._following: Following

    def begin(self, joints: Joints, speed: float) -> None:
        """Get ready for a skill. Raises `TransformError` if it is unknown where the arm stands."""
        self.joints, self.speed, self.waits_for, self._stopped = joints, speed, "", math.inf
        self._router = Router(self._chain, self.scene.world_from(self.config.arm))

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
            raise SkillError(f"dropped {name}" if name else f"the gripper holds {self.holding.held}")

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

    def solve(self, poses: Sequence[Pose]) -> list[tuple[int, Array]]:
        """Joint positions for tool `poses` (world), with the index of each; the least motion first.

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
        found = [(index, row) for index, row in enumerate(rows) if reached[index]]
        if not found:
            found = [(0, self._searched(targets[0]))]
        return sorted(found, key=lambda pair: self._router.effort(self._here, pair[1]))

    def trajectory_to(self, goal: JointGoal, opening: float, target: str = "") -> Trajectory:
        """A free way from here to `goal`, around everything but what is held.

        Args:
            goal: joint positions at the end.
            opening: m between the fingers on the way.
            target: name of the thing that the gripper may be around at the end; empty for none.

        Raises:
            BlockedError: if every way that was tried is blocked.
        """
        held = self.held_box()
        things = self._things()
        lowest = (self.tool.t[2] - float(self.tool.apply(box.corners)[:, 2].min()) for box in held)
        below = max([self.figure.reach, *lowest])
        zones = {zone.name for zone in self._zones.forbidden()}  # they may be high, and are passed beside
        zones |= set(self.others.names())
        travel = max((thing.top for thing in things if thing.name not in zones), default=0.0) + below + CLEARANCE
        load = Load(opening, held)
        return self._router.plan(self._here, goal, load, self._obstacles(things, target), travel, self._limits)

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

        def plan() -> Trajectory:
            load = Load(self.joints.opening, self.held_box())
            obstacles = self._obstacles(self._things(), "")
            return self._router.rise(self._here, self.config.approach, load, obstacles, self._limits)

        trajectory = yield from self.cleared(plan, itself)
        yield from self.go(trajectory, "rise", held)

    def cleared(self, plan: Callable[[], T], way: Callable[[T], Trajectory]) -> Steps[T]:
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
                found = plan()
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
        first = [name for name in self.others.names() if self.others.precedes(name)]
        ways = [box for box in self.others.obstacles(self.joints.stamp) if box.name in first]
        return self._obstacles(ways, "").blocking(trajectory.positions, load, 0) is None

    def step_back(self) -> Steps[None]:
        """Go where the arm is in nobody's way, as far as the others let it: to its rest."""
        rest = self.config.observe_joints
        if not rest or np.abs(np.array(rest) - self._here).max() < STEPPED_BACK:
            return
        try:
            trajectory = self.trajectory_to(JointGoal(np.array(rest)), self.joints.opening)
        except BlockedError:
            back = self._way_back()
            if back is None:
                return
            trajectory = back
        yield from self.go(trajectory, "step back", self.holding.held)

    def _way_back(self) -> Trajectory | None:
        """The way on which the arm came here last, if it is free."""
        if self._came is None or np.abs(self._came[-1] - self._here).max() > STEPPED_BACK:
            return None
        rows = np.vstack([self._here, self._came[::-1]])
        load = Load(self.joints.opening, self.held_box())
        by = self._obstacles(self._things(), "").blocking(resampled(rows), load, len(rows))
        return self._router.retimed(rows, self._limits) if by is None else None

    def start(self, trajectory: Trajectory) -> None:
        """Begin to follow a trajectory: more slowly near people, and not yet if they are too near."""
        allowed = self._allowed_speed()
        self._goal = trajectory.positions[-1]
        self._trajectory = trajectory
        if allowed == 0.0:
            self._end = math.inf
            return
        fastest = self._router.fastest(trajectory.positions)
        if fastest > allowed:
            limits = self._limits._replace(speed=self._limits.speed * MEANT * allowed / fastest)
            self._trajectory = trajectory = self._router.retimed(trajectory.positions, limits)
        self._end = self.joints.stamp + trajectory.duration
        begin = self.joints.stamp
        self._announce(trajectory)
        self._following = Following(trajectory.positions, self._chain.names, begin, self.config.stale)
        self._follow(trajectory)

    def has_arrived(self) -> bool:
        """Whether the way is done.

        Raises:
            StuckError: if the arm stands still before its end.
            SkillError: if the arm is off its way.
        """
        if self._keeps_distance():
            return False
        if self._minds_arms():
            return False
        if off := self._following.off_way(self.joints):
            raise SkillError(off)
        if self.joints.stamp < self._end:
            if self._following.stands_still(self.joints):
                raise StuckError(f"the arm stands still {self._short():.3f} rad short of its goal")
            return False
        away = self._short()
        if away <= self.config.joint_tolerance:
            self._came = self._trajectory.positions
            self._announcer.withdraw()
            return True
        if max(map(abs, self.joints.velocities)) > self.config.still_speed:
            self._end = self.joints.stamp  # late, but on its way
        elif self.joints.stamp > self._end + PATIENCE:
            raise StuckError(f"the arm stands still {away:.3f} rad short of its goal")
        return False

    def _allowed_speed(self) -> float:
        """The greatest speed of the tool point by the people nearby, m/s; notes whom the arm must stand still for."""
        separation = self.config.separation
        if not separation.monitored:
            return math.inf
        distance, whom = self._people.nearest(self._here, self.joints.opening)
        allowed = separation.allowed(distance)
        self.waits_for = whom if allowed == 0.0 else ""
        return allowed

    def _keeps_distance(self) -> bool:
        """Stop if people are too near for the present speed; go on, as fast as may be, when they are not any more."""
        waited = self._end == math.inf
        allowed = self._allowed_speed()
        if not waited:
            ahead = self._ahead(SOON)
            if len(ahead) < 2 or self._router.fastest(ahead) <= allowed:
                return False
            self.hold_still()
            self._end = math.inf
        elif allowed > 0.0 and max(map(abs, self.joints.velocities)) <= self.config.still_speed:
            self.start(self._router.retimed(np.vstack([self._here, self._ahead(math.inf)]), self._limits))
        return True

    def _announce(self, trajectory: Trajectory) -> None:
        if self.others.names():
            world_from_arm, load = self.scene.world_from(self.config.arm), Load(self.joints.opening, self.held_box())
            self._announcer.announce(trajectory, self.joints.stamp, world_from_arm, load)

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
            if not (near := self.near_arm(self.joints)):
                return False
            self.hold_still()
            self._stopped, self.waits_for = self.joints.stamp, near
            self._announcer.wait_for(near, self.joints.stamp)
        elif max(map(abs, self.joints.velocities)) <= self.config.still_speed:
            rows = np.vstack([self._here, self._ahead(math.inf)])
            load = Load(self.joints.opening, self.held_box())
            by = self._obstacles(self.others.obstacles(self.joints.stamp), "").blocking(rows, load, len(rows))
            if by is None:
                self._stopped, self.waits_for = math.inf, ""
                self.start(self._router.retimed(rows, self._limits))
            elif self.joints.stamp - self._stopped > RESUME:
                raise SkillError(f"{by} is in the way")
        return True

    def _ahead(self, seconds: float) -> Array:
        """(m, n) rad, what lies before the arm on its way, for so long."""
        rows = self._trajectory.positions
        nearest = int(np.abs(rows - self._here).max(axis=1).argmin())
        return rows[nearest:] if math.isinf(seconds) else rows[nearest : nearest + math.ceil(seconds / PERIOD) + 1]

    def _short(self) -> float:
        """How far the joints are from the end of the way, rad."""
        return float(np.abs(self._here - self._goal).max())

    def away(self) -> float:
        """Distance of the tool point from its commanded place, m."""
        return self._router.tool(self._goal).distance(self.tool)[0]

    def go(self, trajectory: Trajectory, step: str, held: str | None) -> Steps[None]:
        """Follow a way to its end. Raises `SkillError` if the gripper does not hold `held` all the way."""
        self.start(trajectory)
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
        return np.array(self.joints.positions)

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


def first_free(attempts: Sequence[Callable[[], T]]) -> T:
    """The first of several ways that is not blocked. Raises `InTheWayError` with what blocks the first one."""
    blocked: BlockedError | None = None
    for plan in attempts:
        try:
            return plan()
        except BlockedError as error:
            blocked = blocked or error
    if blocked is None:
        raise SkillError("no way")
    raise InTheWayError(blocked.by)
