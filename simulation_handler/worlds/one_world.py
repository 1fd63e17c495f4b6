"""The belief of a reasoner that has one world only, as islands of one world each."""

from __future__ import annotations

from simulation_handler.reasoner import Reasoner
from simulation_handler.worlds.model import Island, ObjectState, WeightedWorld, innermost_first, joined

BELIEVED = "believed"
"""Reason of the world that the simulation moves."""


def one_world_islands(reasoner: Reasoner) -> list[Island]:
    """Make islands of what holds, contains and supports one another, each with one certain world."""
    hands = {thing: hand for hand, thing in reasoner.grasps()}
    contents, supports = reasoner.contents(), reasoner.supports()
    below = {name: tuple(support for thing, support in supports if thing == name) for name in reasoner.names}
    states = {}
    for name in reasoner.names:
        pose = reasoner.pose(name)
        if pose is not None or reasoner.is_gone(name):
            states[name] = ObjectState(
                pose, hand=hands.get(name, ""), containers=innermost_first(name, contents), supports=below.get(name, ())
            )
    in_one_hand = [(name, other) for name in hands for other in hands if hands[name] == hands[other]]
    groups = joined([*contents, *supports, *in_one_hand], list(states))
    return [Island(names, (WeightedWorld(1.0, {name: states[name] for name in names}, BELIEVED),)) for names in groups]
