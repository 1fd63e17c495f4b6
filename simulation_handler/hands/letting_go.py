"""Keeps when hands last had hold of objects, whether objects have fallen since, and how each hold ended."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from dsr.vocabulary.handling import Handling
from simulation_handler.contact.relations import Relation
from simulation_handler.hands.state import Hand
from simulation_handler.state.objects import BelievedObject

FALLEN = 0.015
"""m that an object must have come down, farther than its hand, to have fallen: five times the noise of percepts"""


class LetGo(NamedTuple):
    """How a hand came to hold an object no more."""

    state: Handling
    """What they had to do with one another in the end"""
    since: float
    """s, when the hand last had hold of the object, as far as is known"""


class _Hold(NamedTuple):
    """A hand that has hold of an object."""

    time: float
    """s"""
    height: float
    """World z of the object, m"""
    palm_height: float
    """World z of the palm, m"""


class LettingGo:
    """Remembers holds and their ends, by (hand, object)."""

    def __init__(self) -> None:
        self._holds: dict[Relation, _Hold] = {}
        self._ended: dict[Relation, LetGo] = {}

    @property
    def ended(self) -> Mapping[Relation, LetGo]:
        """How the last hold of each object ended, until a hand holds it again."""
        return self._ended

    def keep(self, relation: Relation, hand: Hand, item: BelievedObject, now: float) -> None:
        """A hand has hold of an object at time `now` (s)."""
        self._holds[relation] = _Hold(min(now, item.path.newest), item.path.last.t[2], hand.path.last.t[2])

    def has_fallen(self, relation: Relation, hand: Hand, item: BelievedObject) -> bool:
        """Whether an object is seen to have come down since the hand last had hold of it, by more than the hand."""
        hold = self._holds.get(relation)
        if hold is None or item.path.newest <= hold.time:
            return False
        by_hand = max(0.0, hold.palm_height - hand.path.last.t[2]) if hand.perceived else 0.0
        return hold.height - item.path.last.t[2] - by_hand > FALLEN

    def begin(self, relation: Relation) -> None:
        """A hand holds an object again."""
        self._ended = {known: end for known, end in self._ended.items() if known[1] != relation[1]}

    def end(self, relation: Relation, state: Handling, now: float) -> None:
        """A hand does not hold an object any more at time `now` (s)."""
        self.begin(relation)
        hold = self._holds.pop(relation, None)
        self._ended[relation] = LetGo(state, now if hold is None else hold.time)

    def forget(self, name: str) -> None:
        """Forget an object or a hand that is no more."""
        self._holds = {relation: hold for relation, hold in self._holds.items() if name not in relation}
        self._ended = {relation: end for relation, end in self._ended.items() if name not in relation}
