"""The arm as the planner works with it: run one action, halt it, rest; nothing of it blocks."""

from __future__ import annotations

import logging
from collections.abc import Callable, Generator, Iterable
from typing import Protocol

from dsr.graph.elements import Edge
from dsr.memory import Memory
from dsr.network.keys import agent_of
from dsr.vocabulary.intentions import ENDED, EXECUTING, FAILED, HALT, HALTED, PLANNED, RUN, WAITING
from dsr.vocabulary.relations import read_relations
from planner.actions import Actions, Progress, is_under_way, other_action
from planner.config import PlannerConfig
from planner.errors import Failure, Interruption, Setback
from planner.grounding import OBSERVE

Script = Generator[None, None, None]
"""Does a part of its work each time it is resumed."""
_LIKELY_FOUND = 0.5
"""Share of what a camera recognises a thing by (edge `sees`, `detectable`) from which it is likely found."""
_ONE_LOOK = 0.5
"""s in which the arm sees a request"""


class Tell(Protocol):
    """Writes status and explanation of the intention."""

    def __call__(self, status: str, explanation: str = "") -> None:
        """Write them."""


class Arm:
    """Asks the arm controller for one action after the other, on behalf of one intention.

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
        self.at_rest = True
        """Whether it has done nothing since it was at rest."""

    @property
    def there(self) -> bool:
        """Whether the arm controller runs."""
        return any(agent_of(rid) == self._config.arm_agent for rid in self._memory.peers)

    def tell_gone(self) -> None:
        """Say that it does not run."""
        self._tell(WAITING, f"agent {self._config.arm_agent!r} does not run")

    def run(
        self, name: str, told: str, watch: Callable[[], None], trouble: Callable[[], str] = str
    ) -> Generator[None, None, Progress]:
        """Ask the arm to run an action, and return its outcome. Raises the errors of `watch`, and `Interruption`."""
        while (busy := other_action(self._memory, name)) is not None:
            self._tell(WAITING, f"the arm is busy with {busy}")
            watch()
            yield
        self.actions.ask(name, RUN)
        self.running, self.at_rest, began = name, False, self._now()
        while (progress := self.actions.progress(name)).status not in ENDED:
            elapsed = self._now() - began
            if not self.there:
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
        self.running = ""
        return progress

    def halt(self) -> Script:
        """Let the arm hold still, if it is doing something for us."""
        if not self.running:
            return
        self.actions.ask(self.running, HALT)
        began = self._now()
        while self.actions.progress(self.running).status not in ENDED:
            if not self.there:
                self.tell_gone()
                if self._intention not in self._memory:
                    break  # nobody waits for it
                began = self._now()
            elif not self._is_under_way() and self._now() - began > _ONE_LOOK:
                break  # it was never begun, and will not be
            elif self._now() - began > self._config.halt_limit:
                self._log.error("the arm does not halt %s", self.running)
                break
            yield
        self.running = ""

    def rest(self, told: str = "looking") -> Script:
        """Let the arm rest where it hides nothing, and tell meanwhile why. If it cannot, so be it."""
        while not self.there:
            self.tell_gone()
            yield
        [name] = self.actions.write([OBSERVE])
        try:
            progress = yield from self.run(name, told, lambda: None)
        except Setback as setback:
            progress = Progress(FAILED, str(setback))
            yield from self.halt()
        self.at_rest = True
        if progress.status in (FAILED, HALTED):
            self._log.warning("the arm could not go to its rest: %s", progress.explanation)

    def is_hidden(self, things: Iterable[str]) -> bool:
        """Whether no camera can recognise one of `things` although nothing is on it: the arm may be in front of it."""
        relations = read_relations(self._memory)
        covered = {support for _, support in relations.on} | relations.held
        views = [self._views(name) for name in things if name not in covered]
        return any(edges and all(edge.get("detectable", 0.0) < _LIKELY_FOUND for edge in edges) for edges in views)

    def may_hide_something(self) -> bool:
        """Whether the arm may hide something where it is; it does unless all is known to be in view."""
        things = read_relations(self._memory).things
        known = any(self._views(thing) for thing in things)
        return not known or self.is_hidden(things)

    def _views(self, thing: str) -> list[Edge]:
        """What the cameras should see of a thing."""
        cameras = {node.name for node in self._memory.nodes("camera")}
        return [edge for edge in self._memory.edges("sees", dst=thing) if edge.src in cameras]

    def _is_under_way(self) -> bool:
        node = self._memory.get_node(self.running)
        return node is not None and is_under_way(node)
