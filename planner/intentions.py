"""Intentions as the graph has them, and their status as the planner writes it."""

from __future__ import annotations

import contextlib
import sys
from dataclasses import dataclass

from dsr.errors import GraphError
from dsr.graph.elements import Node
from dsr.graph.shares import makers, shared_by
from dsr.memory import Memory
from dsr.vocabulary.intentions import ACTIVE, MOST_INTENTIONS, PREFIX, WANTED

_AFTER_ALL = sys.maxsize  # count, as which a name without a number counts
_MOST_REPLANS = sys.maxsize // 2  # count, with room for more of them; what a node tells may be any number
_MOST_DIGITS = len(str(_AFTER_ALL))  # count of digits from which the number in a name is not read as one


@dataclass(frozen=True)
class Intention:
    """A goal that somebody wants, as read from its node."""

    name: str
    goal: str
    maintain: bool
    priority: int
    status: str
    replans: int

    @property
    def urgency(self) -> tuple[int, int, str]:
        """Sorts the most urgent first: by priority, then the lowest number."""
        return -self.priority, number_of(self.name), self.name


def number_of(name: str) -> int:
    """N of `intention_N`; those of other names come after all numbers."""
    number = read_number(name, PREFIX)
    return _AFTER_ALL if number is None else number


def read_number(name: str, prefix: str) -> int | None:
    """The number behind the prefix of a name; None if there is none, or one that nobody counts to."""
    digits = name.removeprefix(prefix)
    return int(digits) if digits.isascii() and digits.isdigit() and len(digits) < _MOST_DIGITS else None


def read_intentions(memory: Memory) -> list[Intention]:
    """Read all intentions, the most urgent first; of too many, the most urgent of each agent that are not over."""
    found = [(_read(node), node) for node in memory.nodes("intention")]
    found.sort(key=lambda pair: (pair[0].status not in ACTIVE, pair[0].urgency))
    chosen = shared_by(found, MOST_INTENTIONS, lambda pair: makers(pair[1]))
    return sorted((intention for intention, _ in chosen), key=lambda intention: intention.urgency)


def _read(node: Node) -> Intention:
    return Intention(
        name=node.name,
        goal=node.get("goal", ""),
        maintain=node.get("maintain", False),
        priority=node.get("priority", 0),
        status=node.get("status", WANTED),
        replans=min(max(0, node.get("replans", 0)), _MOST_REPLANS),
    )


def tell(memory: Memory, name: str, status: str, explanation: str = "", **attributes: int) -> None:
    """Write a changed status or explanation of an intention; nothing if its node is gone."""
    node = memory.get_node(name)
    values = {"status": status, "explanation": explanation, **attributes}
    if node is not None and any(node.get(key) != value for key, value in values.items()):
        with contextlib.suppress(GraphError):  # removed just now
            memory.update_node(name, **values)
