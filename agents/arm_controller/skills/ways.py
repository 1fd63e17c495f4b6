"""Plans the ways of a skill: joint positions for the tool, and the first of several ways that is free."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

import numpy as np

from agents.arm_controller.config import ArmControllerConfig
from agents.arm_controller.model.kinematics import JointChain, UnreachableError
from agents.arm_controller.motion.execution import MotionExecution
from agents.arm_controller.motion.routes import BlockedError, Finding, Router
from agents.arm_controller.motion.trajectory import MotionLimits, Trajectory, resampled
from agents.arm_controller.scene import Obstacle
from agents.arm_controller.skills.steps import Attempt, InTheWayError, SkillError, Steps
from agents.arm_controller.surroundings import ArmSurroundings
from dsr.math3d.boxes import Array
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose

CLEARANCE = 0.06
"""m between a carried object on its way and everything below"""
SEARCHED = 3
"""Attempts for which a way around everything is searched: what is unreachable by one is often so by all"""
RESTARTS = 3
"""Random postures from which grasps from the side are solved: the arm must often turn its wrist for them"""
OTHERS = 32
"""Random postures from which other joint positions for the same place are solved: some ms more than one"""
DIFFERENT = 0.5
"""rad of a joint by which joint positions for the same place differ at least: less is the same posture, moved"""
PIECES = 5
"""Pieces of a search in a tick: some ms each, so that the agent hears a halt within 0.1 s"""
SEARCH = 10.0
"""s of the arm's time until a search is given up: somebody waits for it, and skills take as long"""
FARTHEST = 10.0
"""m from the arm's base that no arm reaches"""


class Ways:
    """Ways of one arm from where it stands.

    Args:
        chain: from the arm's base to the tool point.
        surroundings: what is around the arm.
        execution: has the newest sample.
        config: limits, and preferred postures.
        rng: starting points of the inverse kinematics, and searches.
    """

    def __init__(
        self,
        chain: JointChain,
        surroundings: ArmSurroundings,
        execution: MotionExecution,
        config: ArmControllerConfig,
        rng: np.random.Generator,
    ) -> None:
        self._chain, self._around, self._execution = chain, surroundings, execution
        self._config, self._rng = config, rng
        self._speed = config.default_speed
        self._router: Router
        self.things: list[Obstacle] = []
        """What the last way was planned around."""

    def begin(self, speed: float) -> None:
        """Get ready at `speed` (0 to 1 of the joints' limits). Raises `TransformError` if the arm's place is lost."""
        self._speed, self._router = speed, Router(self._chain, self._around.world_from_arm)

    @property
    def limits(self) -> MotionLimits:
        """Of the present motion."""
        return MotionLimits(self._speed, self._config.acceleration, self._config.jerk)

    def tool(self, positions: Array) -> Pose:
        """world_from_tool at joint `positions` (n,) rad."""
        return self._router.tool(positions)

    def solve(self, poses: Sequence[Pose], *, thorough: bool = False) -> list[tuple[int, Array]]:
        """Joint positions for tool `poses` (world), with the index of each; the least motion first.

        Args:
            poses: of the tool.
            thorough: whether to begin at random, too, for those that are not reached from here.

        Raises:
            SkillError: if none can be reached.
        """
        arm_from_world = self._around.world_from_arm.inverse()
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

    def first(self, attempts: Sequence[Attempt], *, searched: bool = True) -> Steps[tuple[int, Trajectory]]:
        """The first of several attempts that has a free way, by its index, and that way.

        Simple ways are tried for all of them, one at each tick. Then, if one may be `searched`, ways around everything
        for the first few, by turns.

        Raises:
            InTheWayError: if all are blocked, with what blocks the first one.
        """
        blocked: BlockedError | None = None
        for index, attempt in enumerate(attempts):
            try:
                return index, self.simple(attempt)
            except BlockedError as error:
                blocked = blocked or error
            yield "plan"
        if blocked is not None and self._around.is_arm(blocked.by):
            raise InTheWayError(blocked.by)  # it will go away
        if searched and (found := (yield from self._first_found(attempts))) is not None:
            return found
        if blocked is None:
            raise SkillError("no way")
        raise InTheWayError(blocked.by)

    def _first_found(self, attempts: Sequence[Attempt]) -> Steps[tuple[int, Trajectory] | None]:
        """As `first`, by searches; None if none comes to an end in time."""
        until = self._now + SEARCH
        turns: deque[tuple[int, Finding]] = deque()
        for index, attempt in enumerate(attempts):
            if (found := _advanced(turns, index, self._search(attempt))) is not None:
                return found
            if len(turns) == SEARCHED:
                break
        while turns and self._now < until:
            for _ in range(PIECES):
                if turns and (found := _advanced(turns, *turns.popleft())) is not None:
                    return found
            yield "plan"
        return None

    def other_postures(self, poses: Sequence[Pose], known: Sequence[Array]) -> list[Array]:
        """Other joint positions (n,) rad than those `known`, for the same `poses` of the tool (world)."""
        arm_from_world = self._around.world_from_arm.inverse()
        starts = self._chain.starts(self._here, OTHERS, self._rng)[1:]
        tips = np.array([(arm_from_world @ poses[number % len(poses)]).matrix for number in range(OTHERS)])
        rows, reached = self._chain.track(tips, starts, self._posture)
        found = list(known)
        for row in rows[reached]:
            if all(np.abs(row - other).max() > DIFFERENT for other in found):
                found.append(row)
        others = found[len(known) :]
        return sorted(others, key=lambda row: self._router.effort(self._here, row))

    def simple(self, attempt: Attempt) -> Trajectory:
        """Straight there, or up, across and down. Raises `BlockedError`."""
        load, things = self._around.load(attempt.opening), self._look()
        tool = self.tool(self._here)
        lowest = (tool.t[2] - float(tool.apply(box.corners)[:, 2].min()) for box in load.held)
        below = max([self._around.figure.reach, *lowest])
        beside = self._around.passed_beside()
        travel = max((thing.top for thing in things if thing.name not in beside), default=0.0) + below + CLEARANCE
        obstacles = self._around.obstacles(things, attempt.target)
        return self._router.plan(self._here, attempt.goal, load, obstacles, travel, self.limits)

    def retreat(self, direction: Vector3, length: float) -> Trajectory:
        """The tool straight along a unit vector (world) by `length` m. Raises `BlockedError`."""
        load = self._around.load(self._execution.joints.opening)
        obstacles = self._around.obstacles(self._look())
        return self._router.retreat(self._here, length, direction, load, obstacles, self.limits)

    def through(self, way: Array) -> Trajectory:
        """From here through joint positions (m, n) rad, straight in between. Raises `BlockedError`."""
        rows = resampled(np.vstack([self._here, way]))
        load = self._around.load(self._execution.joints.opening)
        by = self._around.obstacles(self._look()).blocking(rows, load, len(rows))
        if by is not None:
            raise BlockedError(by)
        return self._router.through(rows, self.limits)

    def _look(self) -> list[Obstacle]:
        """What must not be touched, now."""
        self.things = self._around.things(self._now)
        return self.things

    def _search(self, attempt: Attempt) -> Finding:
        """A way around everything."""
        load = self._around.load(attempt.opening)
        obstacles = self._around.obstacles(self._look(), attempt.target)
        return self._router.search(self._here, attempt.goal, load, obstacles, self.limits, self._rng)

    def _searched(self, arm_from_tool: Pose) -> Array:
        try:
            found = self._chain.inverse(arm_from_tool, self._here, rng=self._rng, posture=self._posture)
        except UnreachableError as error:
            raise SkillError(f"unreachable: {error}") from error
        return np.array(found.positions)

    @property
    def _now(self) -> float:
        return self._execution.joints.stamp

    @property
    def _here(self) -> Array:
        return self._execution.here

    @property
    def _posture(self) -> Array:
        wanted = self._config.posture or self._config.observe_joints
        return np.array(wanted) if wanted else self._here


def _advanced(
    turns: deque[tuple[int, Finding]], index: int, finding: Finding
) -> tuple[int, Trajectory] | None:
    """Do a piece of the search for an attempt: what it found, or None; it has another turn unless it is in vain."""
    try:
        next(finding)
    except StopIteration as end:
        return index, end.value
    except BlockedError:
        return None
    turns.append((index, finding))
    return None
