"""Has the arm follow a trajectory: more slowly near people, on again after a stop, never into what came in the way."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from agents.arm_controller.config import ArmControllerConfig
from agents.arm_controller.joints import Joints
from agents.arm_controller.model.figure import Figure
from agents.arm_controller.model.kinematics import JointChain
from agents.arm_controller.motion.routes import Router
from agents.arm_controller.motion.trajectory import PERIOD, MotionLimits, Trajectory
from agents.arm_controller.safety.following import Following
from agents.arm_controller.safety.separation import PeopleNearby
from agents.arm_controller.scene import ArmScene
from dsr.errors import DsrError
from dsr.math3d.boxes import Array
from dsr.math3d.transforms import Pose

PATIENCE = 0.5
"""s that a motion may take longer than planned"""
SOON = 0.2
"""s ahead within which the speed of the tool point counts: the reaction time, and a tick"""
MEANT = 0.98
"""Share of the allowed speed that a trajectory is made for: a trajectory at its limit is not stopped by rounding"""

Blocking = Callable[[Array, int], str | None]
"""Names what is in the way of joint positions (m, n), on the last so many of which the gripper works between things"""


class MotionError(DsrError):
    """A motion cannot go on."""


class StuckError(MotionError):
    """The arm does not get where it was sent."""


class OvertakenError(MotionError):
    """Something has come in the way."""


class MotionExecution:
    """Follows one trajectory after the other.

    Args:
        chain: from the arm's base to the tool point.
        figure: the arm's shape.
        scene: the belief.
        config: tolerances, and the numbers of the protective separation distance.
        follow: has the driver pass through joint positions of the chain.
        stop: has it come to rest.
    """

    def __init__(
        self,
        chain: JointChain,
        figure: Figure,
        scene: ArmScene,
        config: ArmControllerConfig,
        follow: Callable[[Trajectory], None],
        stop: Callable[[], None],
    ) -> None:
        self.joints: Joints
        """The newest sample."""
        self.waits_for = ""
        """The human part that the arm stands still for; empty for none."""
        self._config, self._names = config, chain.names
        self._router = Router(chain, Pose.identity())  # speeds do not depend on where the arm stands
        self._people = PeopleNearby(scene.memory, figure, config.arm)
        self._follow, self.stop = follow, stop
        """`stop` has the arm come to rest."""
        self.announce: Callable[[Trajectory], None] = lambda trajectory: None
        """Is told each trajectory before the arm sets out."""
        self._limits: MotionLimits
        self._blocking: Blocking
        self._trajectory: Trajectory
        self._end = 0.0
        self._following: Following

    @property
    def here(self) -> Array:
        """(n,) rad, as measured."""
        return np.array(self.joints.positions)

    @property
    def goal(self) -> Array:
        """(n,) rad, the end of the way."""
        return np.asarray(self._trajectory.positions[-1])

    @property
    def short(self) -> float:
        """How far the joints are from the end of the way, rad."""
        return float(np.abs(self.here - self.goal).max())

    def start(self, trajectory: Trajectory, limits: MotionLimits, blocking: Blocking) -> None:
        """Begin to follow a trajectory: more slowly near people, and not yet if they are too near.

        Args:
            trajectory: from where the arm is.
            limits: of the motion, without people.
            blocking: checks the rest of the way after a stop for a person.
        """
        self._trajectory, self._limits, self._blocking = trajectory, limits, blocking
        allowed = self._allowed_speed()
        if allowed == 0.0:
            self._wait()
            return
        fastest = self._router.fastest(trajectory.positions)
        if fastest > allowed:
            if self.moves:
                self._wait()
                return
            slower = limits._replace(speed=limits.speed * MEANT * allowed / fastest)
            self._trajectory = trajectory = self._router.retimed(trajectory, slower)
        self._end = self.joints.stamp + trajectory.duration
        self.announce(trajectory)
        self._following = Following(trajectory.positions, self._names, self.joints.stamp, self._config.stale)
        self._follow(trajectory)

    def has_arrived(self) -> bool:
        """Whether the way is done; ask `keeps_distance` before.

        Raises:
            StuckError: if the arm stands still before its end.
            MotionError: if the arm is off its way.
        """
        if off := self._following.off_way(self.joints):
            raise MotionError(off)
        if self.joints.stamp < self._end:
            if self._following.stands_still(self.joints):
                raise StuckError(f"the arm stands still {self.short:.3f} rad short of its goal")
            return False
        if self.short <= self._config.joint_tolerance:
            return True
        if self.moves:
            self._end = self.joints.stamp  # late, but on its way
        elif self.joints.stamp > self._end + PATIENCE:
            raise StuckError(f"the arm stands still {self.short:.3f} rad short of its goal")
        return False

    @property
    def moves(self) -> bool:
        """Whether a joint moved at the newest sample."""
        return max(map(abs, self.joints.velocities)) > self._config.still_speed

    def _wait(self) -> None:
        """Stand still until there is room."""
        if self.moves:
            self.stop()
        self._end = math.inf

    def _allowed_speed(self) -> float:
        """The greatest speed of the tool point by the people nearby, m/s; notes whom the arm must stand still for."""
        separation = self._config.separation
        if not separation.monitored:
            return math.inf
        distance, whom = self._people.nearest(self.here, self.joints.opening)
        allowed = separation.allowed(distance)
        self.waits_for = whom if allowed == 0.0 else ""
        return allowed

    def keeps_distance(self) -> bool:
        """Stop if people are too near for the present speed; go on, as fast as may be, when they are not any more.

        Returns whether the arm stands still for them. Raises `OvertakenError` as `go_on`.
        """
        waited = self._end == math.inf
        allowed = self._allowed_speed()
        if not waited:
            ahead = self._ahead(SOON)
            if len(ahead) < 2 or self._router.fastest(ahead) <= allowed:
                return False
            self.stop()
            self._end = math.inf
        elif allowed > 0.0 and not self.moves:
            self.go_on()
        return True

    @property
    def way(self) -> Array:
        """(m, n) rad, the present way."""
        return self._trajectory.positions

    @property
    def left(self) -> tuple[Array, int]:
        """(m, n) rad of the way that lie before the arm, and how many of them are on its final line."""
        rows = self.way[self._trajectory.nearest(self.here) :]
        return rows, min(self._trajectory.final, len(rows))

    @property
    def rest(self) -> Trajectory:
        """What lies before the arm on its way, from rest to rest."""
        return self._router.rest(self._trajectory, self.here, self._limits)

    def go_on(self) -> None:
        """Follow the rest of the way. Raises `OvertakenError` if something is believed to be in that way now."""
        rest = self.rest
        by = self._blocking(rest.positions, rest.final)
        if by is not None:
            raise OvertakenError(f"{by} is in the way")
        self.start(rest, self._limits, self._blocking)

    def _ahead(self, seconds: float) -> Array:
        """(m, n) rad, what lies before the arm on its way, for so long."""
        rows = self._trajectory.positions
        nearest = self._trajectory.nearest(self.here)
        return rows[nearest : nearest + math.ceil(seconds / PERIOD) + 1]
