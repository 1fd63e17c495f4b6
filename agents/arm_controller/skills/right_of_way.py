"""Gives way to other arms: claims a way before the arm sets out, waits, steps back, and stops before two arms meet."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from agents.arm_controller.config import ArmControllerConfig
from agents.arm_controller.joints import Joints
from agents.arm_controller.motion.execution import MotionExecution
from agents.arm_controller.motion.others import Announcer
from agents.arm_controller.motion.routes import BlockedError, JointGoal
from agents.arm_controller.motion.trajectory import Trajectory
from agents.arm_controller.scene import Obstacle
from agents.arm_controller.skills.steps import Attempt, InTheWayError, SkillError, Steps, T
from agents.arm_controller.skills.ways import Ways
from agents.arm_controller.surroundings import ArmSurroundings
from dsr.math3d.boxes import Array

STEPPED_BACK = 0.02
"""rad from its rest, within which an arm has stepped back"""
REPLAN = 1.0
"""s between two plans of an arm that waits for another: where many grasps are blocked, a plan is much work"""
REPLAN_ANYHOW = 3.0
"""s after which it plans anew although the other one has neither moved nor changed its way: things may have moved"""
CLAIM = 0.1
"""s from the announcement of a way until the arm sets out: as long as another arm needs to hear of it, five ticks"""
PATIENCE = 30.0
"""s that an arm waits for another: longer than any skill of that one takes"""
RESUME = 3.0
"""s that an arm stands still on its way because of another, until it plans anew"""

Go = Callable[[Trajectory, Attempt], Steps[None]]
"""Has the arm follow a way to its end."""


class RightOfWay:
    """Keeps one arm out of the ways of the others.

    Of arms that want the same room, the one that has wanted to go for longer goes first.

    Args:
        ways: plans.
        surroundings: what is around the arm.
        execution: moves the arm.
        announcer: tells the other arms.
        config: where the arm rests, and when it stands still.
        go: has the arm follow a way.
    """

    def __init__(
        self,
        ways: Ways,
        surroundings: ArmSurroundings,
        execution: MotionExecution,
        announcer: Announcer,
        config: ArmControllerConfig,
        go: Go,
    ) -> None:
        self._ways, self._around, self._execution, self._announcer = ways, surroundings, execution, announcer
        self._others, self._config, self._go = surroundings.others, config, go
        self._stopped = math.inf
        self._goes = False
        """Whether the arm is on its way, or has claimed one."""
        self._claims: tuple[object, ...] = ()
        self._came: Array | None = None
        """(m, n) rad, the last way that was gone to its end"""
        execution.announce = self._announce

    def begin(self) -> None:
        """Get ready for a skill."""
        self._stopped = math.inf

    def cleared(self, plan: Callable[[], Steps[T]], way: Callable[[T], Trajectory]) -> Steps[T]:
        """A way that no other arm is on, or has claimed before; waits for that, and claims it.

        Of arms that wait for each other, the one that has wanted to go for less long steps back.

        Args:
            plan: makes a plan from here by the present belief. Raises `BlockedError` or `InTheWayError`.
            way: the way of a plan.

        Raises:
            SkillError: if another arm does not give way.
        """
        until = self._joints.stamp + PATIENCE
        while True:
            if by := self._others.unreadable():
                if self._joints.stamp > until:
                    raise SkillError(self._others.why_unreadable(by))
                yield from self._wait_for(by)
                continue
            try:
                found = yield from plan()
            except (BlockedError, InTheWayError) as error:
                if not self._around.is_arm(error.by):
                    raise
                if self._joints.stamp > until:
                    raise SkillError(f"{error}, and does not go away") from error
                yield from self._wait_for(error.by)
                continue
            if not self._others.names() or (yield from self._claim(way(found))):
                return found

    def step_back(self) -> Steps[None]:
        """Go where the arm is in nobody's way, as far as the others let it: to its rest, or back the way it came."""
        rest = np.array(self._config.observe_joints)
        if not len(rest) or np.abs(rest - self._execution.here).max() < STEPPED_BACK:
            return
        attempt = Attempt(JointGoal(rest), self._joints.opening)
        try:
            trajectory = self._ways.simple(attempt)
        except BlockedError:
            if self._came is None or np.abs(self._came[-1] - self._execution.here).max() > STEPPED_BACK:
                return
            try:
                trajectory = self._ways.through(self._came[::-1])
            except BlockedError:
                return
        yield from self._go(trajectory, attempt)

    def set_out(self) -> None:
        """Note which ways the others have claimed while the arm sets out."""
        self._claims = self._others.claims()

    def arrive(self) -> None:
        """Note that the way was gone to its end."""
        self._came = self._execution.way
        self.withdraw()

    def withdraw(self) -> None:
        """Tell the others that the arm wants to go nowhere."""
        self._goes = False
        self._announcer.withdraw()

    def tick(self, joints: Joints) -> None:
        """Take back the way of an arm that has come to rest; call it at each sample."""
        if not self._goes and max(map(abs, joints.velocities)) <= self._config.still_speed:
            self._announcer.rest()

    def near_arm(self, joints: Joints) -> str:
        """Name of another arm into which this one moves; empty for none. Raises `TransformError` if it is lost."""
        if not self._others.names():
            return ""
        return self._others.is_near(self._around.figure, self._around.world_from_arm, joints)

    def stands_still(self) -> bool:
        """Stop if the arm moves into another one; go on when its way is free.

        Returns whether the arm stands still for another one. Raises `SkillError` if that lasts longer than a few
        seconds.
        """
        unreadable = self._others.unreadable()
        if self._stopped == math.inf:
            if not (near := unreadable or self.near_arm(self._joints) or self._overtaken()):
                return False
            self._execution.stop()
            self._stopped, self._execution.waits_for = self._joints.stamp, near
            self._goes = False
            self._announcer.withdraw()
            self._announcer.wait_for(near, self._joints.stamp)
        elif not self._execution.moves:
            by = unreadable or self._on_rest(self._others.obstacles(self._joints.stamp), on_line=True)
            if by is None:
                self._stopped, self._execution.waits_for = math.inf, ""
                self._execution.go_on()
            elif self._joints.stamp - self._stopped > RESUME:
                raise SkillError(f"{by} is in the way")
        return True

    def _overtaken(self) -> str:
        """Name of an arm that goes first and has announced a way across what is left of this one; empty for none.

        It may have done so at the same moment, and been heard late.
        """
        claims = self._others.claims()
        if claims == self._claims:
            return ""
        self._claims = claims
        return self._on_rest(self._others.obstacles_of_first(self._joints.stamp)) or ""

    def _on_rest(self, others: list[Obstacle], *, on_line: bool = False) -> str | None:
        """What is on the rest of the way; `on_line` takes all of it as a final line, with the least margins."""
        rows = self._execution.rest.positions
        load = self._around.load(self._joints.opening)
        return self._around.obstacles(others).blocking(rows, load, len(rows) if on_line else 0)

    def _wait_for(self, other: str) -> Steps[None]:
        """Stand still for a moment; step back if the other arm waits for this one, and goes first."""
        self._goes = False
        self._announcer.wait_for(other, self._joints.stamp)
        self._execution.waits_for = other
        if other in self._others.waits_for_us() and self._others.precedes(other):
            yield from self.step_back()
        began, before = self._joints.stamp, self._others.state(other)
        while self._joints.stamp < began + REPLAN or (
            self._others.state(other) == before and self._joints.stamp < began + REPLAN_ANYHOW
        ):
            yield "wait"
        self._execution.waits_for = ""

    def _claim(self, trajectory: Trajectory) -> Steps[bool]:
        """Announce a way, and see that nobody who goes first has announced one across it meanwhile."""
        load = self._around.load(self._joints.opening)
        self._goes = True
        self._announcer.announce(trajectory, self._joints.stamp, self._around.world_from_arm, load)
        until = self._joints.stamp + CLAIM
        while self._joints.stamp < until:
            yield "claim"
        ways = self._others.obstacles_of_first(self._joints.stamp)
        return self._around.obstacles(ways).blocking(trajectory.positions, load, 0) is None

    def _announce(self, trajectory: Trajectory) -> None:
        self._goes = True
        if self._others.names():
            load = self._around.load(self._joints.opening)
            self._announcer.announce(trajectory, self._joints.stamp, self._around.world_from_arm, load)

    @property
    def _joints(self) -> Joints:
        return self._execution.joints
