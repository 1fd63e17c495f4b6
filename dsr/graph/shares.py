"""Who made an element, and of too many elements those that are used: as many of each agent as of the others."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Sequence
from typing import TypeVar

from dsr.graph.elements import Edge, Node
from dsr.network.keys import agent_of

E = TypeVar("E", bound=Node | Edge)
T = TypeVar("T")


def makers(element: Node | Edge) -> frozenset[str]:
    """Names of the agents that made an element: several if they did at once."""
    return frozenset(agent_of(rid) for rid, _ in element.created)


def shared_out(elements: Iterable[E], most: int) -> list[E]:
    """At most so many of these elements, in their order: who makes any number leaves room for what others make.

    Each agent has the same share, of which the first of its elements are taken. What it does not need is for others.
    """
    return shared_by(list(elements), most, makers)


def shared_by(wanted: Sequence[T], most: int, made_by: Callable[[T], Collection[str]]) -> list[T]:
    """As `shared_out`, of anything that agents with those names have made."""
    if len(wanted) <= most:
        return list(wanted)
    made: Counter[str] = Counter()
    ranks = []
    for one in wanted:
        names = made_by(one)
        ranks.append(min(made[name] for name in names))
        made.update(names)
    chosen = sorted(range(len(wanted)), key=ranks.__getitem__)[:most]
    return [wanted[place] for place in sorted(chosen)]
