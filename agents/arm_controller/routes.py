"""Finds a path for the arm among all that is believed to be there: straight, or up, across and down again."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from agents.arm_controller.kinematics import JointChain
from agents.arm_controller.obstacles import ITSELF, Load, Obstacles
from agents.arm_controller.trajectory import PERIOD, SPACING, MotionLimits, Trajectory, resampled, rounded, timed
from dsr.errors import DsrError
from dsr.math3d.boxes import Array
from dsr.math3d.transforms import Pose

_LINE_STEP = 0.02  # m between two solved poses on a straight line
_LEAST_LINE = 0.002  # m; less is no line
_LONGEST_LINE = 2.0  # m; more is out of any arm's reach
_LONGEST_JUMP = 0.5  # rad between two solved poses: more is another branch of the inverse kinematics
_ROUNDING = 8  # points on either side over which corners are cut
_STRAIGHT = 0.05  # m at the end of a line that no rounding touches


class BlockedError(DsrError):
    """There is no free way.

    Args:
        by: name of what is in the way.
    """

    def __init__(self, by: str) -> None:
        super().__init__(f"{by} is in the way")
        self.by = by


@dataclass(frozen=True)
class JointGoal:
    """The end of a route."""

    positions: Array
    """Joint positions (n,) at the end of the route, rad."""
    approach: float = 0.0
    """m, length of the straight way down at its end"""


@dataclass(frozen=True)
class _Path:
    """A polyline in joint space."""

    points: Array
    """(k, n) rad"""
    final: Array
    """(j, n) rad, its part at the end that is a straight way down"""
    length: float
    """m of that part"""


class Router:
    """Plans motions of one arm.

    Args:
        chain: from the arm's base to the tool point.
        world_from_arm: where the arm stands.
    """

    def __init__(self, chain: JointChain, world_from_arm: Pose) -> None:
        self._chain = chain
        self._up = world_from_arm.rotation_matrix[2]
        self._world_from_arm = world_from_arm
        self._velocity = np.array([joint.velocity for joint in chain.joints])

    def tool(self, positions: Array) -> Pose:
        """world_from_tool at joint `positions` (n,) rad."""
        return self._world_from_arm @ self._chain.forward(positions)

    def effort(self, start: Array, goal: Array) -> float:
        """Seconds that the slowest joint needs from one to the other at its full speed."""
        return float((np.abs(goal - start) / self._velocity).max())

    def fastest(self, rows: Array) -> float:
        """Greatest speed of the tool point, m/s, when it passes through a row of joint positions (m, n) each period."""
        tips = self._chain.frames(rows)[:, -1, :3, 3]
        return float(np.linalg.norm(np.diff(tips, axis=0), axis=1).max(initial=0.0)) / PERIOD

    def retimed(self, rows: Array, limits: MotionLimits) -> Trajectory:
        """The way through joint positions (m, n), from rest to rest within other limits."""
        return timed(resampled(rows), self._velocity, limits)

    def plan(
        self,
        start: Array,
        goal: JointGoal,
        load: Load,
        obstacles: Obstacles,
        travel: float,
        limits: MotionLimits,
    ) -> Trajectory:
        """A way from joint positions `start` (n,) rad to `goal`.

        Args:
            start: where the arm rests.
            goal: where to.
            load: what moves along.
            obstacles: what must not be touched.
            travel: m above the world's zero, height of the tool point at which everything is passed over.
            limits: of speed, acceleration and jerk.

        Raises:
            BlockedError: if each way that was tried is blocked, with what blocks the last one.
        """
        blocked = ITSELF
        for path in self._paths(start, goal, travel):
            rows, final = _smooth(path)
            by = obstacles.blocking(rows, load, final)
            if by is None:
                return timed(rows, self._velocity, limits)
            blocked = by
        raise BlockedError(blocked)

    def rise(
        self, start: Array, height: float, load: Load, obstacles: Obstacles, limits: MotionLimits
    ) -> Trajectory:
        """Straight up by `height` m, or as far as the arm gets; arguments and errors as of `plan`."""
        line = self._line(start, height, cut=True)
        rows = resampled(line)
        by = obstacles.blocking(rows, load, len(rows))
        if by is not None:
            raise BlockedError(by)
        return timed(rows, self._velocity, limits)

    def _paths(self, start: Array, goal: JointGoal, travel: float) -> Iterator[_Path]:
        """Ways to try, in this order."""
        down = self._line(goal.positions, goal.approach)[::-1]
        if len(down):
            yield _Path(np.vstack([start[None], down]), down, goal.approach)
        here, there = (self.tool(positions).t[2] for positions in (start, goal.positions))
        for height in (travel, travel + 0.1):
            rise = self._line(start, max(height - here, 0.0))
            length = max(height - there, goal.approach)
            fall = self._line(goal.positions, length)[::-1]
            if len(rise) and len(fall):
                yield _Path(np.vstack([rise, fall]), fall if goal.approach > 0.0 else down, length)

    def _line(self, start: Array, length: float, *, cut: bool = False) -> Array:
        """(k, n) rad, from `start` straight up by `length` m; none if the arm cannot, or only a part if `cut`."""
        if length < _LEAST_LINE:
            return start[None]
        if length > _LONGEST_LINE:
            return start[None][:0]
        steps = np.linspace(0.0, length, max(2, int(np.ceil(length / _LINE_STEP)) + 1))
        tips = np.broadcast_to(self._chain.forward(start).matrix, (len(steps), 4, 4)).copy()
        tips[:, :3, 3] += steps[:, None] * self._up
        rows, reached = self._chain.track(tips, np.broadcast_to(start, (len(steps), len(start))), start)
        smooth = np.abs(np.diff(rows, axis=0)).max(axis=1) < _LONGEST_JUMP
        good = int(np.argmin(np.append(reached[1:] & smooth, False))) + 1
        if good < len(rows) and not cut:
            return rows[:0]
        return np.vstack([start[None], rows[1:good]])


def _smooth(path: _Path) -> tuple[Array, int]:
    """Evenly spaced points (m, n) with rounded corners, and how many of them are on the way down at the end."""
    final = _points(path.final)
    straight = int(final * min(1.0, _STRAIGHT / path.length)) if path.length > 0.0 else 0
    return rounded(resampled(path.points), _ROUNDING, 0, straight), final + 1


def _points(path: Array) -> int:
    """How many points the path has when it is resampled."""
    return int(np.abs(np.diff(path, axis=0)).max(axis=1, initial=0.0).sum() / SPACING)
