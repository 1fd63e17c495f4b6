"""Carries candidate plans out in forks of the world, each in its own, compares them and keeps the best."""

from __future__ import annotations

from typing import Annotated

import msgspec

from dsr.agent import Access, Agent
from dsr.errors import DsrError, WorldError, WorldNotFoundError
from dsr.graph.access import EVERYTHING
from dsr.graph.schema import WORLD_RECORD
from dsr.imagining import Outcome, Thinking, best, carried_out, parse_step
from dsr.memory import Memory
from dsr.network.keys import check_name
from dsr.timeline import WRITTEN_ATTRIBUTES, WRITTEN_EDGES, WRITTEN_NODES, Chronicle
from dsr.vocabulary.goals import parse_goal
from dsr.vocabulary.intentions import add_intention
from dsr.vocabulary.relations import SURFACES, THINGS, read_relations
from dsr.vocabulary.what_if import WhatIf
from dsr.worlds import ROOT

PREFIX = "plan_"
"""Prefix of a plan's name in the name of its world."""
ADOPTED = "adopted"
"""`status` of the root of the world whose plan was chosen; its `goal` is the plan's goal."""
NotNegative = Annotated[float, msgspec.Meta(ge=0)]


class CandidateGoal(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A plan to be considered."""

    name: str
    goal: str
    """The goal that the plan serves, as for `dsr mission`."""
    steps: tuple[str, ...]
    """E.g. `place cube_3 on cube_4`, see `dsr.imagining.parse_step`."""


class ImaginationConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The candidate plans, and when they are compared."""

    plans: tuple[CandidateGoal, ...] = ()
    delay: NotNegative = 1.0
    """s between everything that the plans are about being believed and the forks"""
    hold: NotNegative = 0.0
    """s for which the worlds of all plans stay after they were carried out, to be looked at"""


class Imagination(Agent):
    """Forks a world `plan_<name>` for each plan, carries it out there by physics, and compares the outcomes.

    The best one's world stays, its root marked as adopted; the others are deleted without trace. If none can be carried
    out, none stays, and its status says why.
    """

    name = "imagination"
    rate_hz = 10.0
    reads = Access(
        nodes=(*THINGS, *SURFACES),
        edges=("RT", "Virtual_RT", "on", "grasping"),
        attributes=("size", "shape", "present"),
    )
    writes = Access(
        nodes=(WORLD_RECORD, ROOT, *THINGS, *WRITTEN_NODES),
        edges=("Virtual_RT", "on", *WRITTEN_EDGES),
        attributes=("present", "status", "goal", *WRITTEN_ATTRIBUTES),
        worlds=(f"{PREFIX}{EVERYTHING}",),
    )
    Config = ImaginationConfig
    config: ImaginationConfig

    def setup(self) -> None:
        """Read the plans. Raises `ConfigError` for names and steps that are none, `GoalError` for goals."""
        self._steps = {check_name("plan", plan.name): [*map(parse_step, plan.steps)] for plan in self.config.plans}
        self._goals = {plan.name: parse_goal(plan.goal) for plan in self.config.plans}
        self._what_if = WhatIf(self.bus, self.keys, self.clock)
        self._thoughts: dict[str, Thinking[Outcome]] = {}
        self._worlds: dict[str, Memory] = {}
        self._since: float | None = None
        self._finished: float | None = None
        self._decided = not self._steps

    def tick(self, now: float) -> None:
        """Wait for the scene, then for answers, then decide."""
        if self._decided:
            return
        if not self._thoughts:
            if self._is_due(now):
                self._begin()
        elif self._is_thought_through():
            self._finished = now if self._finished is None else self._finished
            if now - self._finished >= self.config.hold:
                self._decide()

    def _is_due(self, now: float) -> bool:
        """Whether all that the plans are about has been believed for some time."""
        relations = read_relations(self.memory)
        about = {name for steps in self._steps.values() for step in steps for name in (step.target, step.destination)}
        if not relations.things | relations.tables >= about - {""}:
            self._since = None
            return False
        self._since = now if self._since is None else self._since
        return now - self._since >= self.config.delay

    def _is_thought_through(self) -> bool:
        """Go on with all thoughts; whether all are done."""
        done = [thought.poll() for thought in self._thoughts.values()]
        return all(done)

    def _begin(self) -> None:
        """Fork a world for each plan."""
        for name, steps in self._steps.items():
            world = f"{PREFIX}{name}"
            if any(info.name == world for info in self.memory.worlds()):  # of an earlier run of this agent
                self.memory.delete_world(world)
            self._worlds[name] = fork = self.memory.fork(world)
            self._thoughts[name] = Thinking(carried_out(self.memory, fork, steps), self._what_if)

    def _decide(self) -> None:
        """Keep the best plan's world and delete the others."""
        outcomes = {name: self._outcome(name) for name in self._thoughts}
        for name, outcome in outcomes.items():
            self.log.info("plan %s: %s", name, outcome)
        try:
            chosen = best(outcomes)
        except ValueError as error:
            chosen, self.degraded = "", str(error)
        for name in outcomes:
            if name != chosen:
                self._worlds[name].close()
                self._delete(f"{PREFIX}{name}")
        if chosen:
            self._adopt(chosen, outcomes)
        self._decided = True

    def _outcome(self, plan: str) -> Outcome:
        """What came of a plan; nothing can come of it if its world is gone."""
        thought, world = self._thoughts[plan], f"{PREFIX}{plan}"
        if self._worlds[plan].closed:
            return Outcome(0, f"world {world!r} was deleted", (), {})
        return thought.result or Outcome(0, thought.failed, (), {})

    def _delete(self, world: str) -> None:
        """Delete a world that may be gone already, unless others follow it."""
        try:
            self.memory.delete_world(world)
        except WorldNotFoundError:
            pass
        except WorldError as error:
            self.log.warning("%s", error)

    def _adopt(self, chosen: str, outcomes: dict[str, Outcome]) -> None:
        world = self._worlds[chosen]
        text = "; ".join(f"{name}: {outcome}" for name, outcome in outcomes.items())
        try:
            with world.batch():
                Chronicle(world).happened(ADOPTED, [ROOT], text=text)
                world.update_node(ROOT, status=ADOPTED, goal=str(self._goals[chosen]))
        except DsrError as error:  # somebody deleted it
            self.degraded = str(error)


class Adoption(Agent):
    """Writes an intention with the `goal` of each world `plan_<name>` that is marked as adopted, once."""

    name = "adoption"
    rate_hz = 5.0
    reads = Access(nodes=(ROOT, "intention"), attributes=("status", "goal"))
    writes = Access(nodes=("mind", "intention"), edges=("has",), attributes=("goal", "maintain", "priority", "status"))

    def setup(self) -> None:
        """Nothing was adopted yet."""
        self._taken: set[str] = set()

    def tick(self, now: float) -> None:
        """Look at the worlds of plans."""
        for info in self.memory.worlds():
            if info.name.startswith(PREFIX) and info.name not in self._taken:
                self._look(info.name)

    def _look(self, name: str) -> None:
        try:
            root = self.memory.world(name).get_node(ROOT)
        except DsrError:  # it is gone at this moment, or not complete yet
            return
        if root is None or root.get("status") != ADOPTED:
            return
        self._taken.add(name)
        goal = root.get("goal", "")
        if goal and all(node.get("goal") != goal for node in self.memory.nodes("intention")):
            self.log.info("%s: %s", add_intention(self.memory, goal), goal)
