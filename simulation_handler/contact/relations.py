"""Which object rests on which, from contacts, with hysteresis."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import NamedTuple

from dsr.math3d.transforms import Pose
from simulation_handler.physics.simulator import Contact
from simulation_handler.scales import DIAGONAL

Relation = tuple[str, str]
"""A pair (object, support)"""
CONTACT = "contact"
"""Source of a relation that comes from contact in the simulation."""
BOUNDS = "bounds"
"""Source of a relation that comes from bounding boxes."""
STEEP = DIAGONAL
"""Vertical part of a contact normal from which one body carries the other."""


class SupportedPose(NamedTuple):
    """Where a body is, and what carries it there."""

    pose: Pose
    """world_from_body"""
    supports: tuple[str, ...] = ()
    """Names of what it rests on, but for the floor, sorted"""


def resting(contacts: Iterable[Contact]) -> set[Relation]:
    """Find which body rests on which, by steep contacts."""
    return {(contact.upper, contact.lower) for contact in contacts if contact.steepness >= STEEP}


class ContactRelations:
    """Relations, such as `on`, that begin when they have lasted and end when they have been gone for some time."""

    def __init__(self, delay: float) -> None:
        """`delay`: s that it must last, or be gone."""
        self._delay = delay
        self._since: dict[Relation, float] = {}
        self._last_seen: dict[Relation, float] = {}
        self._holding: set[Relation] = set()
        self._sources: dict[Relation, str] = {}

    def update(self, found: Iterable[Relation], now: float) -> None:
        """Take in the pairs that were found at time `now` (s)."""
        for relation in found:
            self._since.setdefault(relation, now)
            self._last_seen[relation] = now
        for relation, since in list(self._since.items()):
            gone = now - self._last_seen[relation]
            if gone > 0.0 and (relation not in self._holding or gone >= self._delay):
                self._drop(relation)
            elif now - since >= self._delay:
                self._holding.add(relation)

    def recall(self, relation: Relation, since: float, now: float, source: str = CONTACT) -> None:
        """Take over a relation that held before, as `source` said; it ends as others do if there is no contact."""
        self._since[relation], self._last_seen[relation] = since, now
        self._holding.add(relation)
        self._sources[relation] = source

    def establish(self, names: Collection[str], contacts: Iterable[Contact], now: float, source: str) -> None:
        """Let the relations of objects that were put elsewhere be those of the contacts at once.

        Those that go on keep their beginning; new ones are said to come from `source`.
        """
        touching = resting(contacts)
        about = {relation for relation in touching | self._since.keys() if not set(names).isdisjoint(relation)}
        for relation in about - touching:
            self.end(relation)
        for relation in sorted(about & touching - self._holding):
            self.recall(relation, now, now, source)

    def end(self, relation: Relation) -> None:
        """End a relation now; harmless if it does not hold."""
        if relation in self._since:
            self._drop(relation)

    def source(self, relation: Relation) -> str:
        """The source of a relation that holds."""
        return self._sources.get(relation, CONTACT)

    def forget(self, name: str) -> None:
        """End all relations of a body that is no more."""
        for relation in [relation for relation in self._since if name in relation]:
            self._drop(relation)

    def current(self) -> dict[Relation, float]:
        """Relations that hold, with the time of their first contact (s), sorted."""
        return {relation: self._since[relation] for relation in sorted(self._holding)}

    def _drop(self, relation: Relation) -> None:
        del self._since[relation], self._last_seen[relation]
        self._sources.pop(relation, None)
        self._holding.discard(relation)
