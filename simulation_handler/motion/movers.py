"""Whether an object that is seen on its way is followed there: something is known to move it, or the way itself counts.

What rests goes on resting, and what slides stops at once: it moves only as long as something moves it. Where that is
known, its motion is no surprise. Where nothing is known to move it, somebody did whom nobody saw, who may have moved
more than what is seen: that is to be explained.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping

from simulation_handler.hands.state import HAND_REACH, Hand
from simulation_handler.shapes.geometry import Solid
from simulation_handler.state.objects import BelievedObject


def coasts(item: BelievedObject, solid: Solid) -> bool:
    """Whether an object, seen in the pose of a solid, goes on by itself after a push: it rolls or falls."""
    lies = solid.kind == "cylinder" and not solid.is_round
    return item.falls or solid.kind == "sphere" or lies


def may_push(other: BelievedObject, solid: Solid) -> bool:
    """Whether another object was seen so near to a solid that it may push or carry it."""
    pose = other.path.last
    return math.dist(pose.t, solid.position) <= other.solid(pose.t, pose.q).radius + solid.radius


class Movers:
    """Knows what may move objects.

    Args:
        objects: all that are believed, by name.
        hands: all that are known, by name.
    """

    def __init__(self, objects: Mapping[str, BelievedObject], hands: Mapping[str, Hand]) -> None:
        self._objects = objects
        self._hands = hands

    def explain_way(self, item: BelievedObject, solid: Solid, driven: Collection[str]) -> bool:
        """Whether the way on which an object is seen needs no explanation, or none but the way would tell enough.

        Args:
            item: the object.
            solid: its body, where it is believed to be.
            driven: names of objects that are on their way already.

        Where a hollow object ends does not tell where its contents end, but its way does: it is followed, always.
        """
        there = solid.at(item.path.last.t, item.path.last.q)
        return (
            bool(item.hand)
            or there.is_hollow
            or coasts(item, there)
            or self.has_hand_near(item)
            or any(may_push(self._objects[name], there) for name in driven if name != item.name)
        )

    def has_hand_near(self, item: BelievedObject) -> bool:
        """Whether a hand is within reach of where an object was seen last; one out of sight may be anywhere."""
        place = item.path.last.t
        return any(
            not hand.perceived
            or any(
                math.dist(path.last.t, place) <= HAND_REACH + 0.5 * max(item.size)
                for path in (hand.path, *hand.tips.values())
            )
            for hand in self._hands.values()
        )
