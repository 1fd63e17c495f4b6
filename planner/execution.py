"""Pursues one intention: settle, plan, act, watch, verify; and again from wherever the world then is.

It is written as a generator: what reads as a sequence with waiting takes one step at each tick, so nothing blocks.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Generator, Iterable, Mapping
from dataclasses import dataclass, field

from dsr.clock import ROUNDING
from dsr.errors import GoalError
from dsr.memory import Memory
from dsr.vocabulary.contradictions import by_meaning
from dsr.vocabulary.goals import Goal, parse_goal
from dsr.vocabulary.halting import order_about
from dsr.vocabulary.intentions import (
    DONE,
    FAILED,
    INVALID,
    MAINTAINED,
    NO_SOLVER,
    PLANNING,
    REACHED,
    UNSOLVABLE,
    WAITING,
    WANTED,
)
from dsr.vocabulary.relations import SURFACES, THINGS, Relation, Relations
from planner.actions import can_have_actions
from planner.arm import Arm, Script
from planner.arms import Place
from planner.assurance import Assurance
from planner.config import PlannerConfig
from planner.contradictions import by_state, searched
from planner.errors import (
    Failure,
    GivingUp,
    GoalNotPossible,
    Interruption,
    NoPlace,
    Outdated,
    PlanDeviation,
    PlanningError,
    Setback,
    SolverFailed,
    SolverMissing,
    Unsolvable,
)
from planner.foresight import Foresight
from planner.grounding import OBSERVE, Skill, stacked
from planner.intentions import Intention, tell
from planner.looking import Search
from planner.making import PlanMaker
from planner.monitor import RelationMonitor, believed_places, differences, doubtful, have_moved, surprising
from planner.plan import PlanStep
from planner.state import read_state
from planner.waiting import Waiting

_AS_PROBABLE_AS_NOT = 0.5  # 1, probability from which trying is better than giving up


@dataclass
class Surroundings:
    """The services that an execution uses of its agent."""

    memory: Memory
    maker: PlanMaker
    foresight: Foresight
    config: PlannerConfig
    log: logging.Logger
    now: Callable[[], float]
    """The clock: time in s."""
    kept: Callable[[Intention], Iterable[tuple[str, Goal]]] = field(default=lambda _: ())
    """Maintained goals that must not be given up for this intention, with their names."""


@dataclass
class Execution:
    """One intention on its way."""

    intention: Intention
    around: Surroundings
    result: str = ""
    """Outcome of the execution, once its script has ended."""

    def __post_init__(self) -> None:
        self._memory, self._config, self._now = self.around.memory, self.around.config, self.around.now
        around = self.around
        self._arm = Arm(around.memory, self.intention.name, around.config, around.log, around.now, self._tell)
        self._actions = self._arm.actions
        looking = Search(around.memory, self._arm, around.config, around.now)
        self._assurance = Assurance(around.memory, self._arm, looking, around.config, self._things_kept, around.log)
        self._waiting = Waiting(around.memory, around.config, around.now, self._tell, looking)
        self._replans = self.intention.replans
        self._disturbed = self._replans > 0  # somebody has changed the scene, and may not have finished
        self._failures = 0
        self._plans = 0
        self._in_vain = 0
        self._avoid: list[Place] = []
        self._missed: set[str] = set()  # arms that were waited for in vain
        self._told = ""
        self._last = self._relations()
        self._last_since = self._now()

    # ---- the whole

    def script(self) -> Script:
        """Pursue the goal until it is reached or given up."""
        try:
            yield from self._pursue()
        except GivingUp as end:
            yield from self._arm.halt()
            if not self._arm.at_rest:
                yield from self._arm.rest()
            self._actions.drop(ended_too=False)
            self._end(end.status, str(end))

    def wind_down(self) -> Script:
        """Stop wherever it is: halt the arm, let it rest, and take the plan away then."""
        yield from self._arm.halt()
        if self._arm.there:
            yield from self._arm.rest()
        self._actions.drop(ended_too=True)

    def step_aside(self) -> Script:
        """Stop for a more urgent intention; this one stays wanted."""
        yield from self._arm.halt()
        self._actions.drop(ended_too=True)
        self._tell(WANTED, "a more urgent intention comes first")

    def clean_up(self) -> None:
        """Take the plan's nodes away."""
        self._actions.drop(ended_too=True)

    @property
    def blocked(self) -> str:
        """Explanation of the wait for things that are nowhere, or for agents that do not run; empty while there is
        none.
        """
        return self._told if self._waiting.is_blocked else ""

    def _pursue(self) -> Script:
        goal = self._read_goal()
        yield from self._waiting.until_there(goal)
        if self._arm.is_hidden(goal.things):
            yield from self._arm.rest()
        while True:
            self._check_allowed()
            yield from self._await_return()
            yield from self._settle()
            yield from self._waiting.until_there(goal)
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

    def _check_allowed(self) -> None:
        """Raise `GivingUp` while emergency stops forbid all motion: nothing begins by itself when it is released."""
        orders = [order_about(self._memory, arm.name) for arm in self._arm.arms.all()]
        if all(order is not None and order.halted for order in orders) and orders[0] is not None:
            raise GivingUp(FAILED, orders[0].reason)

    def _check_worth(self, goal: Goal) -> None:
        """After a plan that was carried out to its end: raise `GivingUp` if that has been in vain too often."""
        missing = goal.missing(self._relations())
        self._in_vain += bool(missing)
        if self._in_vain >= self._config.most_failures:
            wrong = " & ".join(map(str, missing))
            raise GivingUp(FAILED, f"{self._in_vain} plans were carried out, and still not: {wrong}")

    def _reached(self) -> None:
        status = MAINTAINED if self.intention.maintain else REACHED
        self._end(status, "")

    # ---- what is wanted, and whether it can be

    def _read_goal(self) -> Goal:
        if not can_have_actions(self.intention.name):
            raise GivingUp(INVALID, "its name is too long, or none: actions could not be named after it")
        try:
            goal = parse_goal(self.intention.goal)
        except GoalError as error:
            raise GivingUp(INVALID, str(error)) from error
        for name in goal.things:
            node = self._memory.get_node(name)
            if node is not None and node.type not in (*THINGS, *SURFACES):
                raise GivingUp(INVALID, f"{name!r} is a {node.type}, nothing that can be moved")
        for relation in goal.relations:
            for name in relation.arguments[:1]:
                node = self._memory.get_node(name)
                if node is not None and node.type in SURFACES:
                    raise GivingUp(INVALID, f"{relation}: {name!r} is a {node.type}, and stays where it is")
        if conflict := by_meaning(goal):
            raise GivingUp(UNSOLVABLE, str(conflict))
        return goal

    # ---- planning

    def _await_return(self) -> Script:
        """Wait a while for the controllers of arms that have gone: they may only be started again."""
        began, config = self._now(), self._config
        while True:
            arms = self._arm.arms
            gone = {arm.name: arm.trouble for arm in arms.all() if arm.trouble and not arms.runs(arm)}
            self._missed &= gone.keys()
            if gone.keys() <= self._missed:
                return
            if self._now() - began > config.return_within:
                self._missed |= gone.keys()
                return
            self._tell(WAITING, f"{', '.join(gone.values())}; goes on without after {config.return_within:g} s")
            yield

    def _settle(self) -> Script:
        """Wait for relations that stay the same and for surprises to be explained, both not for ever.

        After somebody has changed the scene, wait until nothing has moved in it for a while: more may follow.
        """
        config, began, places = self._config, self._now(), believed_places(self._memory)
        while True:
            now, surprises = self._now(), surprising(self._memory)
            if (newer := self._relations()) != self._last:
                self._last, self._last_since = newer, now
            if self._disturbed and have_moved(places, newer_places := believed_places(self._memory), config.still):
                places, self._last_since = newer_places, now
            doubted = doubtful(self._memory)
            explained = not surprises or now - began >= config.settle + config.explained
            if not self._waiting.missing_agents():
                still_for = config.calm if self._disturbed else config.settle
                if explained and not doubted and now - self._last_since >= still_for - ROUNDING:
                    self._disturbed = False
                    return
                if doubted:
                    self._tell(WAITING, f"{', '.join(doubted)} may have moved")
                elif surprises:
                    self._tell(WAITING, f"surprising: {', '.join(surprises)}")
                elif self._disturbed:
                    self._tell(WAITING, f"until nothing has moved for {still_for:g} s")
            else:
                self._waiting.tell_missing()
            yield

    def _plan(self, goal: Goal) -> Generator[None, None, tuple[tuple[PlanStep, ...], list[Skill]]]:
        """A plan from what is believed now, in the graph. Raises `GivingUp`."""
        self._replans += self._plans > 0
        self._plans += 1
        self._tell(PLANNING)
        state = read_state(self._memory, self._config)
        kept = [(name, other) for name, other in self.around.kept(self.intention) if other.holds(state.relations)]
        together = Goal(tuple(dict.fromkeys(r for g in (goal, *(g for _, g in kept)) for r in g.relations)))
        others = {relation: name for name, other in kept for relation in other.relations}
        others = {relation: name for relation, name in others.items() if relation not in goal.relations}
        if conflict := by_meaning(together) or by_state(together, state, self._config):
            raise GivingUp(UNSOLVABLE, f"{conflict}{_asked_by(others, conflict.relations)}")
        try:
            return (yield from self.around.maker.make(state, together, self._avoid))
        except Unsolvable as error:
            self._tell(PLANNING, "there is no plan; finding out what conflicts")
            part, surely = yield from self.around.maker.smallest_conflict(state, together)
            raise GivingUp(UNSOLVABLE, f"{searched(part, surely)}{_asked_by(others, part)}") from error
        except GoalNotPossible as error:
            raise GivingUp(UNSOLVABLE, str(error)) from error
        except SolverMissing as error:
            raise GivingUp(NO_SOLVER, str(error)) from error
        except (NoPlace, SolverFailed, PlanningError) as error:
            raise GivingUp(FAILED, str(error)) from error

    # ---- acting

    def _act(self, goal: Goal, steps: tuple[PlanStep, ...], skills: list[Skill]) -> Script:
        """Carry out a plan. Raises `Setback` when it cannot be finished."""
        self._actions.drop(ended_too=True)
        names = self._actions.write(self._with_rest(skills))
        self.around.log.info("plan for %s: %s", goal, "; ".join(map(str, steps)))
        before = self._relations()
        at = 0
        while at < len(steps):
            step, name = steps[at], names[at]
            told = f"action {at + 1} of {len(names)}: {skills[at]}"
            try:
                if (yield from self._assurance.make_sure(step, steps[at + 1] if at + 1 < len(steps) else None)):
                    self._check_unchanged(before)
                self._arm.send_others_away(skills[at].arm)
                yield from self._do(step, skills[at], name, before, told)
            except (PlanDeviation, Interruption) as setback:
                done = yield from self._resumable(step, before, setback)
                if done is None or self._arm.arms.named(skills[at].arm) not in self._arm.arms.usable():
                    raise
                self.around.log.info("%s; it is as it was, going on", setback)
                at += done
                names[at:] = self._replaced(skills[at:])
            else:
                at += 1
                self._failures = 0 if step.name != "pick" else self._failures
            before = self._relations()
        told = f"action {len(names)} of {len(names)}: {OBSERVE}"
        progress = yield from self._arm.run(names[-1], told, lambda: None)
        yield from self._arm.all_rest(done=progress.status == DONE)

    def _things_kept(self) -> set[str]:
        """Names of what goals that must not be given up want where it is."""
        return {name for _, goal in self.around.kept(self.intention) for name in goal.things}

    def _check_unchanged(self, before: Relations) -> None:
        """Raise `PlanDeviation` if a look has shown that relations are not those that the plan was made for."""
        if changes := differences(before, self._relations()):
            raise PlanDeviation(f"a look has shown: {', '.join(changes)}")

    def _with_rest(self, skills: list[Skill]) -> list[Skill]:
        """The skills, and then the rest of the arm that does the last one."""
        return [*skills, Skill("observe", arm=skills[-1].arm if skills else "")]

    def _replaced(self, skills: list[Skill]) -> list[str]:
        """Fresh nodes for what is left of a plan: an action that was halted is not begun again."""
        self._actions.drop(ended_too=False)
        return self._actions.write(self._with_rest(skills))

    def _do(self, step: PlanStep, skill: Skill, name: str, before: Relations, told: str) -> Script:
        """Let the arm do a step, and see that it has its effect. Raises `Setback`."""
        if not step.possible(before):
            raise Outdated(f"{step} is not possible any more")
        if skill.name == "place":
            skill = yield from self._aimed(skill, name)
        monitor = RelationMonitor(before, step, self._config)

        def watch() -> None:
            if doubted := doubtful(self._memory):
                raise Interruption(f"{', '.join(doubted)} may have moved")
            if monitor.deviates(self._relations(), surprising(self._memory), self._now()):
                kind = Failure if monitor.about_step else PlanDeviation
                raise kind(f"during {skill}: {monitor.change}")

        progress = yield from self._arm.run(name, told, watch, lambda: monitor.change)
        if progress.status != DONE:
            self._check_allowed()
            if skill.target_pose is not None:
                self._avoid.append((skill.target_pose.t[0], skill.target_pose.t[1]))
            problem = f"{skill}: {progress.explanation or progress.status}"
            if progress.hopeless and not surprising(self._memory):
                raise GivingUp(FAILED, problem)
            raise Failure(problem)
        expected, began = step.after(before).facts, self._now()
        while self._relations().facts != expected:
            watch()
            if self._now() - began > self._config.believed + self._config.explained:
                wrong = ", ".join(differences(step.after(before), self._relations()))
                raise Failure(f"{skill} is done, but it is not believed: {wrong}")
            yield

    def _aimed(self, skill: Skill, name: str) -> Generator[None, None, Skill]:
        """The skill with a place that is still free and where nothing would topple. Raises `Failure` without one.

        A place on the table must be as safe as an action has to be, since there are others. Something is put on a thing
        if that is more probable to hold than not: there is no other one.
        """
        most_doubt = 1.0 - (self._config.sure if skill.target_pose is not None else _AS_PROBABLE_AS_NOT)
        for _ in range(self._config.most_failures):
            state = read_state(self._memory, self._config)
            skill = self.around.maker.still_good(skill, state, self._avoid)
            pose = skill.target_pose or stacked(skill.target, skill.destination, state)
            trouble = "" if pose is None else (yield from self.around.foresight.trouble(skill.target, pose, most_doubt))
            if not trouble:
                if skill.target_pose is not None:
                    self._actions.aim(name, skill)
                return skill
            self.around.log.warning("not %s there: %s", skill, trouble)
            if skill.target_pose is None:
                break
            self._avoid.append((skill.target_pose.t[0], skill.target_pose.t[1]))
        raise Failure(f"{skill} is not wise: {trouble}")

    # ---- setbacks

    def _resumable(self, step: PlanStep, before: Relations, setback: Setback) -> Generator[None, None, int | None]:
        """Halt, look, and let the relations settle: 0 if they are as before the step, 1 as after it, else None."""
        self._disturbed = isinstance(setback, PlanDeviation)
        self._tell(WAITING, str(setback))
        yield from self._arm.halt()
        if self._arm.may_hide_something():
            yield from self._arm.rest()
        yield from self._settle()
        relations = self._relations()
        for steps_done, wanted in enumerate((before, step.after(before))):
            if relations.facts == wanted.facts and relations.things == wanted.things:
                return steps_done
        return None

    def _recover(self, setback: Setback) -> Script:
        """Come to rest after a setback, and count it. Raises `GivingUp` after too many failures."""
        self._tell(WAITING, str(setback))
        self.around.log.warning("%s: %s", self.intention.name, setback)
        yield from self._arm.halt()
        self._actions.drop(ended_too=False)  # what was planned is the plan no more
        if isinstance(setback, Failure):
            yield from self._arm.rest()
            self._failures += 1
            if self._failures >= self._config.most_failures:
                raise GivingUp(FAILED, str(setback))
        self._tell(PLANNING, str(setback))

    # ---- the end

    def _confirmed(self, goal: Goal) -> Generator[None, None, bool]:
        """Whether the goal holds without a break."""
        began = self._now()
        while self._now() - began < self._config.believed - ROUNDING:
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
        return self._arm.arms.relations()

    def _tell(self, status: str, explanation: str = "") -> None:
        self._told = explanation
        tell(self._memory, self.intention.name, status, explanation, replans=self._replans)


def _asked_by(others: Mapping[Relation, str], part: Iterable[Relation]) -> str:
    """Which intentions want the relations in `part` that this one does not."""
    names = sorted({others[relation] for relation in part if relation in others})
    return f"; what {', '.join(names)} asked for must stay true" if names else ""
