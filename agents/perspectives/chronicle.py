"""The timeline of a person's world: the things that the person saw from when to when, and the person's beliefs."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from dsr.graph.elements import Node
from dsr.memory import Memory
from dsr.timeline import PRESENT, Chronicle

SEES = "sees"
_Fact = tuple[str, tuple[str, ...]]
"""(kind, participants)"""


class PersonalTimeline:
    """Writes situations: `sees` (person, thing), `on` and `in` as the person knows them, and `present` (thing).

    `present` lasts from when a thing is first seen until its place is seen to be empty, and again once it is found.
    Each `sees` ends with the place where the thing was last seen. It follows from what the world holds, so a restarted
    agent goes on.

    Args:
        person: name of the node of whose world it is.
        world: that world.
        known: all that the person has seen.
    """

    def __init__(self, person: str, world: Memory, known: Callable[[], list[Node]]) -> None:
        self._person = person
        self._world = world
        self._known = known
        self._chronicle = Chronicle(world)
        self._open: dict[_Fact, str] | None = None

    def update(self, now: float) -> None:
        """Write what has begun and ended by `now` (s)."""
        facts = self._facts()
        if self._open is None:
            left = self._chronicle.left_open((SEES, PRESENT, "on", "in"))
            self._open = {(entry.kind, entry.participants): entry.name for entry in left}
        for fact in sorted(self._open.keys() - facts.keys()):
            self._chronicle.end(self._open.pop(fact), now, outcome=self._outcome(*fact))
        for fact in sorted(facts.keys() - self._open.keys()):
            kind, participants = fact
            self._open[fact] = self._chronicle.begin(kind, participants, now, text=facts[fact])
        self._chronicle.claim()
        self._chronicle.forget()

    def _facts(self) -> Mapping[_Fact, str]:
        """What is so, with a text."""
        facts: dict[_Fact, str] = {}
        for node in self._known():
            if node.get("present") is True:
                facts[PRESENT, (node.name,)] = f"{self._person} knows of {node.name}"
            if node.get("perceived") is True:
                facts[SEES, (self._person, node.name)] = f"{self._person} sees {node.name}"
            for edge in self._world.edges(src=node.name):
                if edge.type in ("on", "in"):
                    facts[edge.type, (edge.src, edge.dst)] = f"{edge.src} {edge.type} {edge.dst}"
        return facts

    def _outcome(self, kind: str, participants: tuple[str, ...]) -> str:
        node = self._world.get_node(participants[-1])
        if kind == PRESENT:
            return "not there any more" if node is not None else ""
        seen_at = None if node is None or kind != SEES else node.get("seen_at")
        if seen_at is None:
            return ""
        x, y, z = seen_at.t
        return f"last seen at ({x:.3f}, {y:.3f}, {z:.3f})"
