"""The arms as the planner works with them: run one action, halt it, rest; nothing of it blocks."""

from __future__ import annotations

import logging
from collections.abc import Callable, Generator, Iterable
from typing import Protocol

from dsr.graph.elements import Edge
from dsr.memory import Memory
from dsr.vocabulary.arms import arm_of_action
from dsr.vocabulary.intentions import ENDED, EXECUTING, FAILED, HALT, HALTED, PLANNED, RUN, WAITING
from dsr.vocabulary.relations import read_relations
from planner.actions import Actions, Progress, is_under_way, other_action
from planner.arms import Arms, PlannedArm
from planner.config import PlannerConfig
from planner.errors import Failure, Interruption, Setback
from planner.grounding import Skill

Script = Generator[None, None, None]
"""Does a part of its work each time it is resumed."""
_ONE_LOOK = 0.5
"""s in which the arm sees a request"""


class Tell(Protocol):
    """Writes status and explanation of the intention."""

    def __call__(self, status: str, explanation: str = "") -> None:
        """Write them."""


class Arm:
    """Asks arm controllers for one action after the other, on behalf of one intention.

    With several arms only one at a time moves things. Another one may be on the way to its rest meanwhile.

    Args:
        memory: the graph.
        intention: name of its node.
        config: names and times.
        log: for what the arm does not do.
        now: gives the time, s.
        tell: says in the graph what is waited for.
    """

    def __init__(
        self,
        memory: Memory,
        intention: str,
        config: PlannerConfig,
        log: logging.Logger,
        now: Callable[[], float],
        tell: Tell,
    ) -> None:
        self._memory, self._intention, self._config = memory, intention, config
        self._log, self._now, self._tell = log, now, tell
        self.actions = Actions(memory, intention)
        self.running = ""
        """The action that was asked for and has not ended."""
        self.arms = Arms(memory, config)
        self._away: set[str] = set()
        """Arms that have done something since they were at rest"""
        self._leaving: dict[str, str] = {}
        """Actions by which arms go to their rest while another one works, by arm"""
        self._apart = ""
        """The action under way that is no part of the plan"""

    @property
    def at_rest(self) -> bool:
        """Whether no arm has done anything since it was at rest."""
        return not self._away

    @property
    def there(self) -> bool:
        """Whether the controller of some arm runs."""
        return self.arms.is_any_there

    def tell_gone(self) -> None:
        """Say that it does not run."""
        self._tell(WAITING, f"agent {self.arms.all()[0].agent!r} does not run")

    def send_others_away(self, arm: str) -> None:
        """Let all arms but this go to their rest, and do not wait for that; the only arm has an empty name."""
        usable = {one.name for one in self.arms.usable()}
        for other in sorted(self._away & usable - {arm}) if arm else ():
            name = self.actions.write_apart(Skill("observe", arm=other))
            self.actions.ask(name, RUN)
            self._leaving[other] = name
            self._away.discard(other)

    def run(
        self, name: str, told: str, watch: Callable[[], None], trouble: Callable[[], str] = str
    ) -> Generator[None, None, Progress]:
        """Ask the arm to run an action, and return its outcome. Raises the errors of `watch`, and `Interruption`."""
        arm = self._arm_of(name)
        while (busy := other_action(self._memory, name, arm.name)) is not None:
            self._tell(WAITING, f"the arm is busy with {busy}")
            watch()
            yield
        self.actions.ask(name, RUN)
        self.running, began = name, self._now()
        self._away.add(arm.name)
        while (progress := self.actions.progress(name)).status not in ENDED:
            elapsed = self._now() - began
            if not self.arms.runs(arm):
                raise Interruption("the arm controller is gone")
            if elapsed > self._config.action_limit:
                raise Failure(f"{name} takes longer than {self._config.action_limit:g} s")
            if progress.status == PLANNED and elapsed > self._config.return_within:
                self._tell(WAITING, f"the arm does not begin {name}")
            elif change := trouble():
                self._tell(WAITING, change)
            else:
                self._tell(EXECUTING, told)
            watch()
            yield
        self.running = ""
        return progress

    def run_apart(self, skill: Skill, told: str) -> Generator[None, None, Progress]:
        """Ask the arm for a skill that is no part of the plan; returns the outcome. Raises `Setback`, once halted.

        Whoever closes it on the way calls `halt`: that takes the action away, too.
        """
        self._apart = self.actions.write_apart(skill)
        self.send_others_away(skill.arm)
        try:
            progress = yield from self.run(self._apart, told, lambda: None)
        except Setback:
            yield from self.halt()
            raise
        self._drop_apart()
        return progress

    def _drop_apart(self) -> None:
        """Take an action away that is no part of the plan."""
        if self._apart:
            self._memory.remove_node(self._apart)
            self._apart = ""

    def halt(self) -> Script:
        """Let the arm hold still, if it is doing something for us."""
        if self.running:
            yield from self._hold_still()
        self._drop_apart()

    def _hold_still(self) -> Script:
        self.actions.ask(self.running, HALT)
        began, arm = self._now(), self._arm_of(self.running)
        while self.actions.progress(self.running).status not in ENDED:
            if not self.arms.runs(arm):
                if self.there:
                    break  # it has died; another one goes on
                self.tell_gone()
                if self._intention not in self._memory:
                    break  # nobody waits for it
                began = self._now()
            elif not self._is_under_way() and self._now() - began > _ONE_LOOK:
                break  # it was never begun, and will not be
            elif self._now() - began > self._config.return_within:
                self._log.error("the arm does not halt %s", self.running)
                break
            yield
        self.running = ""

    def rest(self, told: str = "looking") -> Script:
        """Let the arms rest where they hide nothing, and tell meanwhile why. If one cannot, so be it."""
        while not self.there:
            self.tell_gone()
            yield
        several = len(self.arms.all()) > 1
        usable = self.arms.usable()
        for arm in [arm for arm in usable if several and arm.name in self._away] or usable:
            [name] = self.actions.write([Skill("observe", arm=arm.name if several else "")])
            try:
                progress = yield from self.run(name, told, lambda: None)
            except Setback as setback:
                progress = Progress(FAILED, str(setback))
                yield from self.halt()
            if progress.status in (FAILED, HALTED):
                self._log.warning("the arm could not go to its rest: %s", progress.explanation)
        yield from self.all_left()
        self._away.clear()

    def all_rest(self, *, done: bool) -> Script:
        """After the last arm was asked to rest: see that all do; `done` says whether that one does."""
        if not done:
            yield from self.rest()
        yield from self.all_left()
        self._away.clear()

    def all_left(self) -> Script:
        """Wait until arms that were sent away have come to their rest, as far as they do."""
        for arm, name in self._leaving.items():
            while self.actions.progress(name).status not in ENDED and self.arms.runs(self.arms.named(arm)):
                yield
            self._memory.remove_node(name)
        self._leaving.clear()

    def is_hidden(self, things: Iterable[str]) -> bool:
        """Whether no camera can recognise one of `things` although nothing is on it: the arm may be in front of it."""
        relations = read_relations(self._memory)
        covered = {support for _, support in relations.on} | relations.held
        views = [self._views(name) for name in things if name not in covered]
        return any(edges and not any(map(_likely_finds, edges)) for edges in views)

    def may_hide_something(self) -> bool:
        """Whether the arm may hide something where it is; it does unless all is known to be in view."""
        things = read_relations(self._memory).things
        known = any(self._views(thing) for thing in things)
        return not known or self.is_hidden(things)

    def _views(self, thing: str) -> list[Edge]:
        """What the cameras should see of a thing."""
        cameras = {node.name for node in self._memory.nodes("camera")}
        return [edge for edge in self._memory.edges("sees", dst=thing) if edge.src in cameras]

    def _arm_of(self, action: str) -> PlannedArm:
        """The arm that is to carry out an action."""
        node = self._memory.get_node(action)
        return self.arms.named("" if node is None else arm_of_action(self._memory, node))

    def _is_under_way(self) -> bool:
        node = self._memory.get_node(self.running)
        return node is not None and is_under_way(node)


def _likely_finds(sees: Edge) -> bool:
    """Whether a camera rather recognises a thing than not."""
    detectable: float = sees.get("detectable", 0.0)
    return detectable >= 1.0 - detectable
