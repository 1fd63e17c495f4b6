"""Which nodes of hands and fingers count: however many somebody makes up, those in sight have room."""

from __future__ import annotations

from collections.abc import Iterator

from dsr.graph.elements import Node
from dsr.graph.shares import makers, shared_out
from dsr.memory import Memory
from dsr.vocabulary.perceived import MOST_HANDS, is_perceived, seconds_unseen
from simulation_handler.hands.state import FINGERS


def hand_nodes(memory: Memory, now: float) -> Iterator[tuple[Node, list[Node]]]:
    """Each hand with its fingers, by name: of too many hands as many of each agent, first those seen last by `now` (s).

    Of too many fingers first those of the agents that made the hand.
    """
    lately = sorted(memory.nodes("hand"), key=lambda node: (_unseen(node, now), node.name))
    fingers = {node.name: node for node in memory.nodes("finger")}
    for hand in sorted(shared_out(lately, MOST_HANDS), key=lambda node: node.name):
        parts = [fingers[edge.dst] for edge in memory.edges("has", src=hand.name) if edge.dst in fingers]
        own = makers(hand)
        parts.sort(key=lambda node: (own.isdisjoint(makers(node)), node.name))
        yield hand, parts[:FINGERS]


def _unseen(hand: Node, now: float) -> float:
    """For how long (s) a hand has not been in sight at `now` (s)."""
    return 0.0 if is_perceived(hand, now) else seconds_unseen(hand, now)
