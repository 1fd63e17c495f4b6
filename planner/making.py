"""From a world state and a goal to a plan with its skills: the stages before execution, one after the other."""

from __future__ import annotations

import logging
from collections.abc import Collection, Generator
from dataclasses import replace

from dsr.clock import Clock
from dsr.math3d.transforms import Pose
from dsr.vocabulary.goals import Goal
from dsr.vocabulary.relations import Relation
from planner.arms import Place
from planner.config import PlannerConfig
from planner.errors import NoPlace, SolverFailed, Unsolvable
from planner.grounding import Skill, ground, is_free, place_on_table
from planner.pddl import DOMAIN, names_of, problem
from planner.plan import PlanStep, leads_to, read_plan
from planner.solver import Solver, SolverAnswer
from planner.state import WorldState


class PlanMaker:
    """Makes plans, one at a time."""

    def __init__(self, clock: Clock, config: PlannerConfig, log: logging.Logger) -> None:
        self._clock, self._config, self._log = clock, config, log
        self._solver: Solver | None = None

    def make(
        self, state: WorldState, goal: Goal, avoid: Collection[Place]
    ) -> Generator[None, None, tuple[tuple[PlanStep, ...], list[Skill]]]:
        """The steps to `goal` with a skill for each; waits at each yield. Raises `PlanningError`."""
        solution = yield from self._solve(problem(state, goal))
        steps = read_plan(solution.plan, names_of(state), state.table or "")
        if not goal.holds(leads_to(steps, state.relations)):
            raise SolverFailed(f"the plan of the solver does not lead to {goal}")
        return steps, ground(steps, state, self._config, avoid)

    def smallest_conflict(
        self, state: WorldState, goal: Goal
    ) -> Generator[None, None, tuple[tuple[Relation, ...], bool]]:
        """Find a part of a goal to which no plan leads, if none leads to the goal, and whether it is a smallest such
        part.

        Relations are left out, one after the other, where the solver proves that the others are still too many. It is
        not known to be a smallest part if the time was up, or the solver gave no answer.
        """
        part, surely = goal.relations, True
        began = self._clock.monotonic()
        for relation in goal.relations:
            others = tuple(other for other in part if other != relation)
            if not others:
                break
            if self._clock.monotonic() - began > self._config.solver_limit:
                return part, False
            try:
                yield from self._solve(problem(state, Goal(others)))
            except Unsolvable:
                part = others
            except SolverFailed:
                surely = False
        return part, surely

    def still_good(self, skill: Skill, state: WorldState, avoid: Collection[Place]) -> Skill:
        """The same skill, or one with another place on the table if somebody has taken this one."""
        pose: Pose | None = skill.target_pose
        if pose is None or is_free(pose, skill.target, state, self._config, avoid, skill.arm):
            return skill
        try:
            return replace(skill, target_pose=place_on_table(skill.target, state, self._config, avoid, skill.arm))
        except NoPlace:
            return skill

    def close(self) -> None:
        """End the solver, if it is at work."""
        if self._solver is not None:
            self._solver.close()
            self._solver = None

    def _solve(self, text: str) -> Generator[None, None, SolverAnswer]:
        config = self._config
        self._solver = Solver(DOMAIN, text, self._clock, limit=config.solver_limit, delay=config.solver_delay)
        try:
            while (solution := self._solver.poll()) is None:
                yield
        finally:
            self.close()
        self._log.debug("the solver, after %.2f s:\n%s", solution.seconds, solution.output)
        return solution
