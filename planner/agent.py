"""The planner as an agent: chooses the intention to pursue, watches those that are maintained, tidies up."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from dsr.agent import Access, Agent
from dsr.believing.distribution import ATTRIBUTE as WHEREABOUTS
from dsr.clock import ROUNDING
from dsr.errors import GoalError
from dsr.timeline import WRITTEN_ATTRIBUTES, WRITTEN_EDGES, WRITTEN_NODES
from dsr.vocabulary.arms import MOST_ARMS, arms_beyond
from dsr.vocabulary.goals import Goal, parse_goal
from dsr.vocabulary.halting import HALT_ATTRIBUTES, HALT_NODE
from dsr.vocabulary.intentions import ACTIVE, FAILED, HALT, INVALID, MAINTAINED, REACHED, UNSOLVABLE, WANTED
from dsr.vocabulary.intrinsics import INTRINSICS
from dsr.vocabulary.relations import SURFACES, THINGS, Relations, read_relations
from dsr.vocabulary.what_if import WhatIf
from planner.actions import is_under_way, own_actions
from planner.arm import Script
from planner.config import PlannerConfig
from planner.execution import Execution, Surroundings
from planner.foresight import Foresight
from planner.intentions import Intention, read_intentions, tell
from planner.making import PlanMaker
from planner.monitor import doubtful, surprising
from planner.solver import PACKAGE


@dataclass
class _Watched:
    """What is remembered of an intention that rests: reached, maintained or given up."""

    status: str
    since: float
    """s"""
    relations: Relations
    """When it came to rest."""
    broken_since: float | None = None


class Planner(Agent):
    """Makes and carries out plans for intentions, the most urgent first, one at a time.

    Writes the status of intentions and the action nodes below them; the arm controller carries those out. What it
    believes to be so it reads from relations (`on`, `grasping`), never from what it has asked for.
    """

    name = "planner"
    shares_process = True
    goal_libraries = (PACKAGE,)
    reads = Access(
        nodes=("intention", "action", "gripper", "camera", "arm", HALT_NODE, *THINGS, *SURFACES),
        edges=("on", "in", "grasping", "has", "next", "sees", "RT", "Virtual_RT"),
        attributes=(
            *("goal", "maintain", "priority", "status", "explanation", "hopeless", "request"),
            *("arm", "controller", "gripper"),
            *("size", "present", "surprising", "mount"),
            *("detectable", "source", "replans", *INTRINSICS, *HALT_ATTRIBUTES, WHEREABOUTS),
        ),
    )
    writes = Access(
        nodes=("intention", "action", *WRITTEN_NODES),
        edges=("has", "next", *WRITTEN_EDGES),
        attributes=(
            *("status", "explanation", "replans", "order", "skill", "target", "destination", "target_pose"),
            *("request", "source", "arm", *WRITTEN_ATTRIBUTES),
        ),
        exclusive=("next",),
    )
    Config = PlannerConfig
    config: PlannerConfig

    def setup(self) -> None:
        """Prepare; intentions of an earlier run are taken over in the first ticks."""
        self._time = self.clock.now()
        self._maker = PlanMaker(self.clock, self.config, self.log)
        self._around = Surroundings(
            memory=self.memory,
            maker=self._maker,
            foresight=self._foresight(),
            config=self.config,
            log=self.log,
            now=lambda: self._time,
            kept=self._kept,
        )
        self._watched: dict[str, _Watched] = {}
        self._execution: Execution | None = None
        self._leaving = False
        self._script: Script | None = self._take_over()

    def tick(self, now: float) -> None:
        """Go on with the present intention, at time `now` (s)."""
        self._time = now
        known = read_intentions(self.memory)
        self._watch(known)
        if self._script is None:
            self._begin(known)
        elif self._execution is not None and not self._leaving:
            self._check_still_wanted(self._execution, known)
        if self._script is not None:
            self._go_on(self._script)
        self.degraded = self._problem()

    def teardown(self) -> None:
        """End the solver. The arm finishes its action; the next planner takes over."""
        maker = getattr(self, "_maker", None)
        if maker is not None:
            maker.close()

    def _problem(self) -> str:
        """What the intention that is pursued has to wait for, and what is passed over; empty if there is neither."""
        execution, beyond = self._execution, len(arms_beyond(self.memory))
        waits = f"{execution.intention.name}: {execution.blocked}" if execution and execution.blocked else ""
        passed_over = f"{beyond} arms are passed over: {MOST_ARMS} others are looked at" if beyond else ""
        return "; ".join(filter(None, (waits, passed_over)))

    def _go_on(self, script: Script) -> None:
        try:
            next(script)
        except StopIteration:
            self._script, self._leaving = None, False
            self._remember(self._execution)
            self._execution = None
        except Exception:
            self._maker.close()
            self._execution, self._leaving = None, False
            self._script = self._take_over()
            raise

    def _remember(self, execution: Execution | None) -> None:
        if execution is not None and execution.result:
            watched = _Watched(execution.result, self._time, read_relations(self.memory))
            self._watched[execution.intention.name] = watched

    def _foresight(self) -> Foresight:
        what_if = WhatIf(self.bus, self.keys, self.clock, max(self.config.what_if_patience, 1.0 / self.rate_hz))
        return Foresight(what_if, self.config, lambda: self._time, self.log)

    # ---- choosing

    def _begin(self, known: list[Intention]) -> None:
        chosen = next((intention for intention in known if intention.status in ACTIVE), None)
        if chosen is not None:
            self._execution = Execution(chosen, self._around)
            self._script = self._execution.script()

    def _check_still_wanted(self, execution: Execution, known: list[Intention]) -> None:
        """Leave the intention that is under way if it was removed or changed, or a more urgent one has come."""
        mine = execution.intention
        present = next((intention for intention in known if intention.name == mine.name), None)
        if present is None:
            self.log.info("%s was cancelled", mine.name)
            self._leave(execution.wind_down())
        elif (present.goal, present.maintain) != (mine.goal, mine.maintain):
            self._leave(execution.step_aside())
        elif (best := next(i for i in known if i.status in ACTIVE or i.name == mine.name)).priority > present.priority:
            self.log.info("%s steps aside for %s", mine.name, best.name)
            self._leave(execution.step_aside())

    def _leave(self, script: Script) -> None:
        if self._script is not None:
            self._script.close()
        self._maker.close()
        self._script, self._leaving = script, True

    # ---- those that rest

    def _watch(self, known: list[Intention]) -> None:
        """Notice which maintained goals no longer hold, which hopeless ones may be tried again, which are over."""
        resting = {intention.name: intention for intention in known if intention.status not in ACTIVE}
        for name in self._watched.keys() - resting.keys():
            del self._watched[name]
        if not resting:
            return
        relations = read_relations(self.memory)
        for name, intention in resting.items():
            watched = self._watched.get(name)
            if watched is None or watched.status != intention.status:
                watched = self._watched[name] = _Watched(intention.status, self._time, relations)
            if intention.status == MAINTAINED:
                self._watch_maintained(intention, watched, relations)
            elif intention.status == REACHED and self._time - watched.since > self.config.return_within:
                self._remove(intention)
            elif _is_worth_another_try(intention, watched.relations, relations):
                tell(self.memory, name, WANTED, "things have changed: trying again")

    def _watch_maintained(self, intention: Intention, watched: _Watched, relations: Relations) -> None:
        goal = _goal(intention)
        missing = () if goal is None else goal.missing(relations)
        if not missing:
            watched.broken_since = None
            return
        if watched.broken_since is None:
            watched.broken_since = self._time
        limit = self.config.explained if surprising(self.memory) else self.config.settle
        if self._time - watched.broken_since >= limit - ROUNDING and not doubtful(self.memory):
            why = f"no longer true: {' & '.join(map(str, missing))}"
            self.log.warning("%s: %s", intention.name, why)
            tell(self.memory, intention.name, WANTED, why, replans=intention.replans + 1)

    def _remove(self, intention: Intention) -> None:
        Execution(intention, self._around).clean_up()
        for edge in self.memory.edges("has", src=intention.name):
            self.memory.remove_node(edge.dst)
        self.memory.remove_node(intention.name)

    def _kept(self, intention: Intention) -> Iterator[tuple[str, Goal]]:
        """Maintained goals at least as urgent as `intention`, which its plan must respect."""
        for other in read_intentions(self.memory):
            goal = _goal(other)
            if other.status == MAINTAINED and other.priority >= intention.priority and goal is not None:
                yield other.name, goal

    # ---- after a restart

    def _take_over(self) -> Script:
        """Halt what an earlier run of the planner has left running, and take its plans away."""
        resting = {intention.name for intention in read_intentions(self.memory) if intention.status not in ACTIVE}
        began = self._time
        for node in own_actions(self.memory):
            if is_under_way(node):
                self.log.warning("halting %s, left by an earlier run", node.name)
                self.memory.update_node(node.name, request=HALT)
        while any(map(is_under_way, own_actions(self.memory))) and self._time - began < self.config.return_within:
            yield
        for node in own_actions(self.memory):
            if not any(edge.src in resting for edge in self.memory.edges("has", dst=node.name)):
                self.memory.remove_node(node.name)


def _is_worth_another_try(intention: Intention, before: Relations, now: Relations) -> bool:
    """Whether what made an intention hopeless has changed: there was no plan, or something was nowhere or unknown."""
    if intention.status == UNSOLVABLE:
        return now != before
    goal = _goal(intention)
    if intention.status not in (FAILED, INVALID) or goal is None:
        return False
    wanted = set(goal.things)
    return wanted <= now.things | now.tables and not wanted <= before.things | before.tables


def _goal(intention: Intention) -> Goal | None:
    try:
        return parse_goal(intention.goal)
    except GoalError:
        return None
