"""How many bodies are simulated and compared, and parts hide others: who may make nodes could make any number."""

from __future__ import annotations

from collections.abc import Iterable

from dsr.graph.elements import Node
from dsr.graph.shares import shared_out
from dsr.memory import Memory
from dsr.vocabulary.relations import nodes_by_name

MOST_BODIES = 128
"""Things, and as many static bodies, that are simulated: the largest scenes have a hundred things. Where many are in
one place, each is held against each."""
MOST_PARTS = 1024
"""Parts of robots and hands that hide what is behind them: those of three arms with as many links as are read of one"""


def bodies_by_name(memory: Memory, types: str | Iterable[str]) -> list[Node]:
    """The nodes of these types that are simulated, by name: of more than `MOST_BODIES` as many of each agent's."""
    return shared_out(nodes_by_name(memory, types), MOST_BODIES)


def bodies_beyond(memory: Memory, types: str | Iterable[str]) -> int:
    """How many nodes of these types are passed over, since there are too many."""
    return max(0, len(memory.nodes(types)) - MOST_BODIES)
