"""Finds a path for the arm among all that is believed to be there: straight; up, across and down; or around."""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from agents.arm_controller.model.kinematics import JointChain
from agents.arm_controller.motion.obstacles import ITSELF, Load, Obstacles
from agents.arm_controller.motion.search import Draw, search, shortened
from agents.arm_controller.motion.trajectory import PERIOD, SPACING, MotionLimits, Trajectory, resampled, rounded, timed
from dsr.errors import DsrError
from dsr.math3d.boxes import Array
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose

_LINE_STEP = 0.02  # m between two solved poses on a straight line
_LEAST_LINE = 0.002  # m; less is no line
_LONGEST_LINE = 2.0  # m; more is out of any arm's reach
_LONGEST_JUMP = 0.5  # rad between two solved poses: more is another branch of the inverse kinematics
_ROUNDING = 8  # points on either side over which corners are cut
_SHARPER = (_ROUNDING, 3, 0)  # those that are tried in turn, because a corner that is cut may lead into something
_STRAIGHT = 0.05  # m at the end of a line that no rounding touches
_WAY_OUT = 0.1  # m within which an arm that begins too close to something must be free
SPARE = 0.001
"""m of room beyond the margin on a searched way: cutting its corners moves it, and it is checked once more then"""
_DRAWN = 32  # postures that are solved at once: some ms more than one
_MOST_TILT = 0.6  # rad by which what is held may lean on a searched way: less than spills a cup that is half full

Finding = Generator[None, None, Trajectory]
"""Yields after each piece of work of some ms; returns the way."""


UP: Vector3 = (0.0, 0.0, 1.0)
"""World"""


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
    """m, length of the straight way at its end"""
    retreat: Vector3 = UP
    """Unit vector (world) against that way: up if it comes down"""


@dataclass(frozen=True)
class _Path:
    """A polyline in joint space."""

    points: Array
    """(k, n) rad"""
    final: Array
    """(j, n) rad, its part at the end that is a straight line of the tool"""
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
        self._up = world_from_arm.rotation_matrix[2]  # (3,) the world's vertical axis in the arm's frame
        self._world_from_arm = world_from_arm
        self._velocity = chain.velocity

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

    def retimed(self, trajectory: Trajectory, limits: MotionLimits) -> Trajectory:
        """The same way, from rest to rest within other limits."""
        found = timed(resampled(trajectory.positions), self._velocity, limits)
        begin = trajectory.positions[-trajectory.final]
        return replace(found, final=len(found.positions) - found.nearest(begin))

    def through(self, rows: Array, limits: MotionLimits) -> Trajectory:
        """The way through joint positions (m, n), from rest to rest; on all of it the gripper works between things."""
        trajectory = timed(resampled(rows), self._velocity, limits)
        return replace(trajectory, final=len(trajectory.positions))

    def rest(self, trajectory: Trajectory, here: Array, limits: MotionLimits) -> Trajectory:
        """What lies before joint positions `here` (n,) rad, from rest to rest."""
        rows = trajectory.positions[trajectory.nearest(here) :]
        left = replace(trajectory, positions=np.vstack([here, rows]), final=min(trajectory.final, len(rows)))
        return self.retimed(left, limits)

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
        blocked: BlockedError | None = None
        for path in self._paths(start, goal, travel):
            try:
                return self._checked(path, load, obstacles, limits, _SHARPER[:1])
            except BlockedError as error:
                blocked = error
        raise blocked or BlockedError(ITSELF)

    def search(
        self,
        start: Array,
        goal: JointGoal,
        load: Load,
        obstacles: Obstacles,
        limits: MotionLimits,
        rng: np.random.Generator,
    ) -> Finding:
        """Search a way around what blocks the simple ones. What is held leans by 0.6 rad at most on the way.

        The search goes on until a way is found, or nobody goes on with it.

        Args:
            start: as of `plan`, like all that follow but the last one.
            goal: where to.
            load: what moves along.
            obstacles: what must not be touched.
            limits: of speed, acceleration and jerk.
            rng: of the search.

        Raises:
            BlockedError: if an end of the way is not free, or the way that is found is not with its corners cut.
        """
        down = self._line(goal.positions, goal.approach, goal.retreat)[::-1]
        if not len(down):
            raise BlockedError(ITSELF)
        self._checked(_Path(down, down, goal.approach), load, obstacles, limits)  # else the search would be in vain
        out = self._way_out(start, load, obstacles)
        level = self._levels(out[-1:])[0] if load.held else None
        ends = np.array([out[-1], down[0]])
        spare = SPARE if obstacles.free(ends, load, SPARE).all() else 0.0

        def free(rows: Array) -> NDArray[np.bool_]:
            good = obstacles.free(rows, load, spare)
            return good if level is None else good & (self._levels(rows) @ level > math.cos(_MOST_TILT))

        if not free(down[:1]).all():
            raise BlockedError(self._on_straight(start, down[0], load, obstacles))
        draw = self._uniform(ends, rng) if level is None else self._upright(ends, rng)
        found = yield from search(out[-1], down[0], free, draw)
        way = yield from shortened(found, free, rng)
        return self._checked(_Path(np.vstack([out[:-1], way, down[1:]]), down, goal.approach), load, obstacles, limits)

    def along(self, way: Array, load: Load, obstacles: Obstacles, limits: MotionLimits) -> Trajectory:
        """Follow a polyline (k, n) rad, straight in between. Raises `BlockedError` if it is not free."""
        return self._checked(_Path(way, way[-1:], 0.0), load, obstacles, limits)

    def _checked(
        self,
        path: _Path,
        load: Load,
        obstacles: Obstacles,
        limits: MotionLimits,
        reaches: tuple[int, ...] = _SHARPER,
    ) -> Trajectory:
        """The path with its corners cut as far as that is free. Raises `BlockedError` if it is not free at all."""
        blocked = ITSELF
        for reach in reaches:
            rows, final = _smooth(path, reach)
            by = obstacles.blocking(rows, load, final)
            if by is None:
                trajectory = timed(rows, self._velocity, limits)
                return replace(trajectory, final=len(trajectory.positions) - trajectory.nearest(rows[-final]))
            blocked = by
            if len(path.points) == 2:
                break
        raise BlockedError(blocked)

    def _way_out(self, start: Array, load: Load, obstacles: Obstacles) -> Array:
        """(k, n) rad, from `start` to where the arm is free: straight up, or back from what the fingers point to.

        `start` alone if it is free, or cannot get free.
        """
        x, y, z = (-self.tool(start).rotation_matrix[:, 2]).tolist()
        for direction in (UP, (x, y, z)) if not obstacles.free(start[None], load).all() else ():
            line = self._line(start, _WAY_OUT, direction, cut=True)
            good = obstacles.free(line, load)
            if good.any():
                return line[: int(np.argmax(good)) + 1]
        return start[None]

    def _levels(self, rows: Array) -> Array:
        """(m, 3) the world's vertical axis in the tool's frame."""
        return np.asarray(np.einsum("mij,i->mj", self._chain.frames(rows)[:, -1, :3, :3], self._up))

    def _bounds(self, ends: Array) -> tuple[Array, Array]:
        """(n,) least and greatest positions on a way; those of continuous joints are half a turn about its middle."""
        middle, turning = ends.mean(axis=0), self._chain.turning
        return (
            np.where(turning, middle - math.pi, self._chain.lower),
            np.where(turning, middle + math.pi, self._chain.upper),
        )

    def _uniform(self, ends: Array, rng: np.random.Generator) -> Draw:
        """Any joint positions, for a way between two (2, n)."""
        lower, upper = self._bounds(ends)
        return lambda: rng.uniform(lower, upper)

    def _upright(self, ends: Array, rng: np.random.Generator) -> Draw:
        """Joint positions at which the tool leans as at the first of two (2, n), turned about the vertical at random.

        The tool is anywhere around the base, no farther away and no higher or lower than both by half of the reach.
        """
        from scipy.spatial.transform import Rotation  # takes half a second, which most processes need not wait for

        tips = self._chain.frames(ends)[:, -1]
        away, height = tips[:, :2, 3] @ tips[:, :2, 3].T, tips[:, 2, 3]
        farthest = 1.5 * math.sqrt(float(away.diagonal().max()))
        found: list[Array] = []
        anywhere = self._uniform(ends, rng)

        def draw() -> Array:
            if not found:
                targets = np.broadcast_to(tips[0], (_DRAWN, 4, 4)).copy()
                turns = Rotation.from_rotvec(rng.uniform(-math.pi, math.pi, _DRAWN)[:, None] * self._up).as_matrix()
                targets[:, :3, :3] = turns @ targets[:, :3, :3]
                targets[:, :3, 3] = rng.uniform(-farthest, farthest, (_DRAWN, 3))
                targets[:, 2, 3] = rng.uniform(height.min() - farthest / 4, height.max() + farthest / 4, _DRAWN)
                shares = rng.uniform(0.0, 1.0, _DRAWN)[:, None]
                rows, reached = self._chain.track(targets, ends[0] + shares * (ends[1] - ends[0]), ends.mean(axis=0))
                found.extend(rows[reached])
            return found.pop() if found else anywhere()

        return draw

    def _on_straight(self, start: Array, goal: Array, load: Load, obstacles: Obstacles) -> str:
        """What is in the way straight through joint space."""
        return obstacles.blocking(resampled(np.array([start, goal])), load, 1) or ITSELF

    def retreat(
        self,
        start: Array,
        length: float,
        direction: Vector3,
        load: Load,
        obstacles: Obstacles,
        limits: MotionLimits,
    ) -> Trajectory:
        """Straight along a unit vector (world) by `length` m, or as far as the arm gets; else as `plan`."""
        line = self._line(start, length, direction, cut=True)
        rows = resampled(line)
        by = obstacles.blocking(rows, load, len(rows))
        if by is not None:
            raise BlockedError(by)
        return self.through(line, limits)

    def _paths(self, start: Array, goal: JointGoal, travel: float) -> Iterator[_Path]:
        """Ways to try, in this order."""
        down = self._line(goal.positions, goal.approach, goal.retreat)[::-1]
        if len(down):
            yield _Path(np.vstack([start[None], down]), down, goal.approach)
        here = self.tool(start).t[2]
        for height in (travel, travel + 0.1):
            rise = self._line(start, max(height - here, 0.0))
            fall = self._fall(down, goal, height)
            if len(rise) and fall is not None:
                yield _Path(np.vstack([rise, fall.points]), fall.final, fall.length)

    def _fall(self, down: Array, goal: JointGoal, height: float) -> _Path | None:
        """Straight down from `height` m to where the way `down` to the goal begins, and that way; None if it cannot."""
        if goal.retreat == UP:
            length = max(height - self.tool(goal.positions).t[2], goal.approach)
            fall = self._line(goal.positions, length)[::-1]
            return _Path(fall, fall if goal.approach > 0.0 else down, length) if len(fall) else None
        over = self._line(down[0], max(height - self.tool(down[0]).t[2], 0.0))[::-1] if len(down) else down
        return _Path(np.vstack([over[:-1], down]), down, goal.approach) if len(over) else None

    def _line(self, start: Array, length: float, direction: Vector3 = UP, *, cut: bool = False) -> Array:
        """(k, n) rad, from `start` by `length` m along a unit vector (world), up if none is given.

        None if the arm cannot, or only a part if `cut`.
        """
        if length < _LEAST_LINE:
            return start[None]
        if length > _LONGEST_LINE:
            return start[None][:0]
        steps = np.linspace(0.0, length, max(2, int(np.ceil(length / _LINE_STEP)) + 1))
        tips = np.broadcast_to(self._chain.forward(start).matrix, (len(steps), 4, 4)).copy()
        tips[:, :3, 3] += steps[:, None] * (self._world_from_arm.rotation_matrix.T @ direction)
        rows, reached = self._chain.track(tips, np.broadcast_to(start, (len(steps), len(start))), start)
        smooth = np.abs(np.diff(rows, axis=0)).max(axis=1) < _LONGEST_JUMP
        good = int(np.argmin(np.append(reached[1:] & smooth, False))) + 1
        if good < len(rows) and not cut:
            return rows[:0]
        return np.vstack([start[None], rows[1:good]])


def _smooth(path: _Path, reach: int) -> tuple[Array, int]:
    """Evenly spaced points (m, n) with corners cut over `reach` points, and how many are on the way down at the end."""
    final = _points(path.final)
    straight = int(final * min(1.0, _STRAIGHT / path.length)) if path.length > 0.0 else 0
    return rounded(resampled(path.points), reach, 0, straight), final + 1


def _points(path: Array) -> int:
    """How many points the path has when it is resampled."""
    return int(np.abs(np.diff(path, axis=0)).max(axis=1, initial=0.0).sum() / SPACING)
