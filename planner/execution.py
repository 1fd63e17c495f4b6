"""Pursues one intention: settle, plan, act, watch, verify; and again from wherever the world then is.

It is written as a generator: what reads as a sequence with waiting takes one step at each tick, so nothing blocks.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass, field

from dsr.errors import GoalError, suggest
from dsr.goals import Goal, parse_goal
from dsr.keys import agent_of
from dsr.memory import Memory
from dsr.relations import SURFACES, THINGS, Relations, read_relations
from planner import intentions
from planner.actions import (
    DONE,
    ENDED,
    FAILED,
    HALT,
    HALTED,
    PLANNED,
    RUN,
    Actions,
    Progress,
    is_under_way,
    other_action,
)
from planner.config import PlannerConfig
from planner.errors import GoalNotPossible, NoPlace, PlanningError, SolverFailed, SolverMissing, Unsolvable
from planner.grounding import OBSERVE, Place, Skill
from planner.intentions import EXECUTING, INVALID, NO_SOLVER, PLANNING, UNSOLVABLE, WAITING, Intention
from planner.making import PlanMaker
from planner.monitor import Monitor, differences, surprising
from planner.plan import Step
from planner.state import read_state

_ONE_LOOK = 0.5
"""s in which the arm sees a request"""
Script = Generator[None, None, None]
"""Does a part of its work each time it is resumed."""


class Setback(Exception):  # noqa: N818 - nothing is wrong with the program
    """Execution cannot go on as planned."""


class Deviation(Setback):
    """The relations changed, and nobody planned it."""


class Outdated(Setback):
    """The next step is not possible in what is believed now."""


class Failure(Setback):
    """An action failed, or did not have its effect."""


class Interruption(Setback):
    """The arm controller is gone; the world may be as it was."""


class GivingUp(Exception):  # noqa: N818
    """The goal cannot be reached: the status to write, and why."""

    def __init__(self, status: str, explanation: str) -> None:
        super().__init__(explanation)
        self.status = status


@dataclass
class Surroundings:
    """What an execution needs from its agent."""

    memory: Memory
    maker: PlanMaker
    config: PlannerConfig
    log: logging.Logger
    now: Callable[[], float]
    """s"""
    kept: Callable[[Intention], Iterable[tuple[str, Goal]]] = field(default=lambda _: ())
    """Maintained goals that must not be given up for this intention, with their names."""


@dataclass
class Execution:
    """One intention on its way."""

    intention: Intention
    around: Surroundings
    result: str = ""
    """What became of it, once its script has ended."""

    def __post_init__(self) -> None:
        self._memory, self._config, self._now = self.around.memory, self.around.config, self.around.now
        self._actions = Actions(self._memory, self.intention.name)
        self._replans = self.intention.replans
        self._failures = 0
        self._plans = 0
        self._in_vain = 0
        self._avoid: list[Place] = []
        self._running = ""
        self._at_rest = True
        self._last = self._relations()
        self._last_since = self._now()

    # ---- the whole

    def script(self) -> Script:
        """Pursue the goal until it is reached or given up."""
        try:
            yield from self._pursue()
        except GivingUp as end:
            yield from self._halt()
            if not self._at_rest:
                yield from self._observe()
            self._actions.drop(ended_too=False)
            self._end(end.status, str(end))

    def wind_down(self) -> Script:
        """Stop wherever it is: halt the arm, take the plan away, let the arm rest."""
        yield from self._halt()
        self._actions.drop(ended_too=True)
        if self._arm_there():
            yield from self._observe()
        self._actions.drop(ended_too=True)

    def step_aside(self) -> Script:
        """Stop for a more urgent intention; this one stays wanted."""
        yield from self._halt()
        self._actions.drop(ended_too=True)
        self._tell(intentions.WANTED, "a more urgent intention comes first")

    def clean_up(self) -> None:
        """Take the plan's nodes away."""
        self._actions.drop(ended_too=True)

    def _pursue(self) -> Script:
        goal = self._read_goal()
        yield from self._until_there(goal)
        if self._is_hidden(goal.things):
            yield from self._observe()
        while True:
            yield from self._settle()
            yield from self._until_there(goal)
            if goal.holds(self._relations()):
                if (yield from self._confirmed(goal)):
                    self._reached()
                    return
                continue
            try:
                steps, skills = yield from self._plan(goal)
                yield from self._act(goal, steps, skills)
            except Setback as setback:
                yield from self._recover(setback)
            else:
                yield from self._settle()
                self._check_worth(goal)

    def _check_worth(self, goal: Goal) -> None:
        """After a plan that was carried out to its end: raise `GivingUp` if that has been in vain too often."""
        missing = goal.missing(self._relations())
        self._in_vain += bool(missing)
        if self._in_vain >= self._config.most_plans_in_vain:
            wrong = " & ".join(map(str, missing))
            raise GivingUp(intentions.FAILED, f"{self._in_vain} plans were carried out, and still not: {wrong}")

    def _reached(self) -> None:
        status = intentions.MAINTAINED if self.intention.maintain else intentions.REACHED
        self._end(status, "")

    # ---- what is wanted, and whether it can be

    def _read_goal(self) -> Goal:
        try:
            goal = parse_goal(self.intention.goal)
        except GoalError as error:
            raise GivingUp(INVALID, str(error)) from error
        for name in goal.things:
            node = self._memory.get_node(name)
            if node is not None and node.type not in (*THINGS, *SURFACES):
                raise GivingUp(INVALID, f"{name!r} is a {node.type}, nothing that can be moved")
        return goal

    def _until_there(self, goal: Goal) -> Script:
        """Wait until all things of the goal are believed to be somewhere. Raises `GivingUp` after a while."""
        began = self._now()
        while lacking := self._lacking(goal):
            hint = "" if lacking in self._memory else f"; {suggest(lacking, self._relations().things)}"
            explanation = f"{lacking!r} is not believed to be anywhere{hint}"
            if self._now() - began > self._config.patience:
                raise GivingUp(intentions.FAILED, explanation)
            self._tell(WAITING, explanation)
            yield

    def _lacking(self, goal: Goal) -> str:
        relations = self._relations()
        known = relations.things | relations.tables
        return next((name for name in goal.things if name not in known), "")

    def _is_hidden(self, things: Iterable[str]) -> bool:
        """Whether no camera should see one of `things` although nothing is on it: the arm may be in front of it."""
        relations = self._relations()
        covered = {support for _, support in relations.on} | relations.held
        views = {name: self._memory.edges("sees", dst=name) for name in things if name not in covered}
        return any(edges and not any(edge.get("visible") for edge in edges) for edges in views.values())

    # ---- planning

    def _settle(self) -> Script:
        """Wait for relations that stay the same and for surprises to be explained, both not for ever."""
        config, began = self._config, self._now()
        while True:
            now, surprises = self._now(), surprising(self._memory)
            if (newer := self._relations()) != self._last:
                self._last, self._last_since = newer, now
            explained = not surprises or now - began >= config.settle + config.explain
            if self._arm_there():
                if explained and now - self._last_since >= config.settle - 1e-6:
                    return
                if surprises:
                    self._tell(WAITING, f"surprising: {', '.join(surprises)}")
            else:
                self._tell_arm_gone()
            yield

    def _plan(self, goal: Goal) -> Generator[None, None, tuple[tuple[Step, ...], list[Skill]]]:
        """A plan from what is believed now, in the graph. Raises `GivingUp`."""
        self._replans += self._plans > 0
        self._plans += 1
        self._tell(PLANNING)
        state = read_state(self._memory, self._config)
        kept = [(name, other) for name, other in self.around.kept(self.intention) if other.holds(state.relations)]
        together = Goal(tuple(dict.fromkeys(r for g in (goal, *(g for _, g in kept)) for r in g.relations)))
        try:
            return (yield from self.around.maker.make(state, together, self._avoid))
        except Unsolvable as error:
            others = f"; {', '.join(name for name, _ in kept)} must stay as it is" if kept else ""
            raise GivingUp(UNSOLVABLE, f"{error}{others}") from error
        except GoalNotPossible as error:
            raise GivingUp(UNSOLVABLE, str(error)) from error
        except SolverMissing as error:
            raise GivingUp(NO_SOLVER, str(error)) from error
        except (NoPlace, SolverFailed, PlanningError) as error:
            raise GivingUp(intentions.FAILED, str(error)) from error

    # ---- acting

    def _act(self, goal: Goal, steps: tuple[Step, ...], skills: list[Skill]) -> Script:
        """Carry out a plan. Raises `Setback` when it cannot be finished."""
        self._actions.drop(ended_too=True)
        names = self._actions.write([*skills, OBSERVE])
        self.around.log.info("plan for %s: %s", goal, "; ".join(map(str, steps)))
        before = self._relations()
        at = 0
        while at < len(steps):
            step, name = steps[at], names[at]
            told = f"action {at + 1} of {len(names)}: {skills[at]}"
            try:
                yield from self._do(step, skills[at], name, before, told)
            except (Deviation, Interruption) as setback:
                done = yield from self._resumable(step, before, setback)
                if done is None:
                    raise
                self.around.log.info("%s; it is as it was, going on", setback)
                at += done
                names[at:] = self._replaced(skills[at:])
            else:
                at += 1
                self._failures = 0 if step.name != "pick" else self._failures
            before = self._relations()
        yield from self._run_action(names[-1], f"action {len(names)} of {len(names)}: {OBSERVE}", lambda: None)
        self._at_rest = True

    def _replaced(self, skills: list[Skill]) -> list[str]:
        """Fresh nodes for what is left of a plan: an action that was halted is not begun again."""
        self._actions.drop(ended_too=False)
        return self._actions.write([*skills, OBSERVE])

    def _do(self, step: Step, skill: Skill, name: str, before: Relations, told: str) -> Script:
        """Let the arm do a step, and see that it has its effect. Raises `Setback`."""
        if not step.possible(before):
            raise Outdated(f"{step} is not possible any more")
        if skill.target_pose is not None:
            fresh = self.around.maker.still_good(skill, read_state(self._memory, self._config), self._avoid)
            if fresh is not skill:
                self._actions.aim(name, fresh)
        monitor = Monitor(before, step, self._config)

        def watch() -> None:
            if monitor.deviates(self._relations(), surprising(self._memory), self._now()):
                kind = Failure if monitor.about_step else Deviation
                raise kind(f"during {skill}: {monitor.change}")

        progress = yield from self._run_action(name, told, watch, lambda: monitor.change)
        if progress.status != DONE:
            if skill.target_pose is not None:
                self._avoid.append((skill.target_pose.t[0], skill.target_pose.t[1]))
            raise Failure(f"{skill}: {progress.explanation or progress.status}")
        expected, began = step.after(before).facts, self._now()
        while self._relations().facts != expected:
            watch()
            if self._now() - began > self._config.verify:
                wrong = ", ".join(differences(step.after(before), self._relations()))
                raise Failure(f"{skill} is done, but it is not believed: {wrong}")
            yield

    def _run_action(
        self, name: str, told: str, watch: Callable[[], None], trouble: Callable[[], str] = str
    ) -> Generator[None, None, Progress]:
        """Ask the arm to run an action; what became of it. Raises what `watch` raises, and `Interruption`."""
        while (busy := other_action(self._memory, name)) is not None:
            self._tell(WAITING, f"the arm is busy with {busy}")
            watch()
            yield
        self._actions.ask(name, RUN)
        self._running, self._at_rest, began = name, False, self._now()
        while (progress := self._actions.progress(name)).status not in ENDED:
            elapsed = self._now() - began
            if not self._arm_there():
                raise Interruption("the arm controller is gone")
            if elapsed > self._config.action_limit:
                raise Failure(f"{name} takes longer than {self._config.action_limit:g} s")
            if progress.status == PLANNED and elapsed > self._config.begin:
                self._tell(WAITING, f"the arm does not begin {name}")
            elif change := trouble():
                self._tell(WAITING, change)
            else:
                self._tell(EXECUTING, told)
            watch()
            yield
        self._running = ""
        return progress

    # ---- setbacks

    def _resumable(self, step: Step, before: Relations, setback: Setback) -> Generator[None, None, int | None]:
        """Halt, look, and let the relations settle: 0 if they are as before the step, 1 as after it, else None."""
        self._tell(WAITING, str(setback))
        yield from self._halt()
        if self._must_look():
            yield from self._observe()
        yield from self._settle()
        relations = self._relations()
        for steps_done, wanted in enumerate((before, step.after(before))):
            if relations.facts == wanted.facts and relations.things == wanted.things:
                return steps_done
        return None

    def _must_look(self) -> bool:
        """Whether the arm may hide something where it is; it does unless all is known to be in view."""
        things = self._relations().things
        known = any(self._memory.edges("sees", dst=thing) for thing in things)
        return not known or self._is_hidden(things)

    def _recover(self, setback: Setback) -> Script:
        """Come to rest after a setback, and count it. Raises `GivingUp` after too many failures."""
        self._tell(WAITING, str(setback))
        self.around.log.warning("%s: %s", self.intention.name, setback)
        yield from self._halt()
        if isinstance(setback, Failure):
            yield from self._observe()
            self._failures += 1
            if self._failures >= self._config.most_failures:
                raise GivingUp(intentions.FAILED, str(setback))
        self._tell(PLANNING, str(setback))

    def _halt(self) -> Script:
        """Let the arm hold still, if it is doing something for us."""
        if not self._running:
            return
        self._actions.ask(self._running, HALT)
        began = self._now()
        while self._actions.progress(self._running).status not in ENDED:
            if not self._arm_there():
                self._tell_arm_gone()
                if self._running in self._memory and self.intention.name not in self._memory:
                    break
                began = self._now()
            elif not is_under_way(self._memory.node(self._running)) and self._now() - began > _ONE_LOOK:
                break  # it was never begun, and will not be
            elif self._now() - began > self._config.halt_limit:
                self.around.log.error("the arm does not halt %s", self._running)
                break
            yield
        self._running = ""

    def _observe(self) -> Script:
        """Let the arm rest where it hides nothing. If it cannot, so be it."""
        while not self._arm_there():
            self._tell_arm_gone()
            yield
        [name] = self._actions.write([OBSERVE])
        try:
            progress = yield from self._run_action(name, "looking", lambda: None)
        except Setback as setback:
            progress = Progress(FAILED, str(setback))
            yield from self._halt()
        self._at_rest = True
        if progress.status in (FAILED, HALTED):
            self.around.log.warning("the arm could not go to its rest: %s", progress.explanation)

    # ---- the end

    def _confirmed(self, goal: Goal) -> Generator[None, None, bool]:
        """Whether the goal holds without a break."""
        began = self._now()
        while self._now() - began < self._config.confirm - 1e-6:
            yield
            if not goal.holds(self._relations()):
                return False
        return True

    def _end(self, status: str, explanation: str) -> None:
        self.result = status
        self._tell(status, explanation)
        self.around.log.info("%s: %s%s", self.intention.name, status, f" ({explanation})" if explanation else "")

    # ---- small things

    def _relations(self) -> Relations:
        return read_relations(self._memory)

    def _arm_there(self) -> bool:
        return any(agent_of(rid) == self._config.arm_agent for rid in self._memory.peers)

    def _tell_arm_gone(self) -> None:
        self._tell(WAITING, f"agent {self._config.arm_agent!r} does not run")

    def _tell(self, status: str, explanation: str = "") -> None:
        intentions.tell(self._memory, self.intention.name, status, explanation, replans=self._replans)
