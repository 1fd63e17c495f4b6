"""Which object is inside which, from where they are, with hysteresis."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping

from dsr.math3d.quaternions import Vector3
from dsr.perception.scales import SAME_PLACE
from simulation_handler.contact.relations import ContactRelations, Relation
from simulation_handler.shapes.geometry import Solid


class Containment:
    """Relations `in` that begin when an object's centre has been within a hollow one for some time.

    A container counts upside down too: what it covers is in it. (isIn of Sallami et al., on the container's own
    bounding box, so that one that is tilted holds what is in it.)
    """

    def __init__(self, delay: float) -> None:
        """`delay`: s that something must be inside, or outside."""
        self._relations = ContactRelations(delay)
        self.found: set[Relation] = set()
        """(object, container) as things are at the last step, whether that lasts or not"""
        self.left: set[Relation] = set()
        """(object, container) that have just got out, in the last step; the relation may still hold for a moment."""

    def update(self, solids: Iterable[Solid], now: float) -> None:
        """Take in where all objects are at time `now` (s)."""
        known = self._relations.current().keys()
        before, self.found = self.found, inside(list(solids), known)
        self.left = {relation for relation in before - self.found if relation in known}
        self._relations.update(self.found, now)

    def recall(self, relation: Relation, since: float, now: float) -> None:
        """Take over a relation that held before."""
        self._relations.recall(relation, since, now)

    def forget(self, name: str) -> None:
        """End all relations of an object that is no more."""
        self._relations.forget(name)
        self.found = {relation for relation in self.found if name not in relation}

    def current(self) -> dict[Relation, float]:
        """(object, container) and since when (s), sorted."""
        return self._relations.current()


def inside(solids: Collection[Solid], known: Collection[Relation] = ()) -> set[Relation]:
    """Find the pairs (object, container); pairs in `known` stay within the hysteresis."""
    return {
        (solid.name, hollow.name)
        for hollow in solids
        if hollow.is_hollow
        for solid in solids
        if solid.name != hollow.name
        if is_in(solid.position, solid.radius, hollow, SAME_PLACE if (solid.name, hollow.name) in known else 0.0)
    }


def is_in(place: Vector3, radius: float, hollow: Solid, margin: float = 0.0) -> bool:
    """Whether an object of that radius (m) at a place (m) is in a hollow body, or outside by at most `margin` m."""
    return radius < hollow.radius and hollow.reaches_around(place, margin)


def carried_by(leaders: Iterable[str], relations: Iterable[Relation]) -> set[str]:
    """Names of all that the leaders carry along, directly and indirectly, by relations (carried, carrier)."""
    with_each: dict[str, set[str]] = {}
    for upper, lower in relations:
        with_each.setdefault(lower, set()).add(upper)
    found: set[str] = set()
    level = set(leaders)
    while level := {upper for lower in level for upper in with_each.get(lower, ())} - found:
        found |= level
    return found - set(leaders)


def with_contents(
    moved: Mapping[str, Solid], solids: Mapping[str, Solid], stay: Collection[str] = ()
) -> dict[str, Solid]:
    """Where the contents of objects come to be that are put elsewhere, if they go along rigidly.

    Args:
        moved: where the containers are put.
        solids: everything where it was until now.
        stay: contents that do not go along.
    """
    there: dict[str, Solid] = {}
    before = [solid for solid in solids.values() if not solid.fixed]
    for name, container in sorted(inside(before)):
        if container in moved and name not in moved and name not in stay:
            shift = moved[container].pose @ solids[container].pose.inverse() @ solids[name].pose
            there[name] = solids[name].at(shift.t, shift.q)
    return there


def shifted_along(
    moved: Mapping[str, Solid], solids: Mapping[str, Solid], relations: Collection[Relation]
) -> dict[str, Solid]:
    """Where all that is on or in objects comes to be, directly and indirectly, that are pushed aside.

    Args:
        moved: the objects where they are pushed.
        solids: everything where it was until now.
        relations: (carried, carrier); only what is in `solids` goes along.
    """
    there: dict[str, Solid] = {}
    for base in sorted(moved):
        pairs = zip(moved[base].position, solids[base].position, strict=True)
        shift = [after - before for after, before in pairs]
        for name in sorted(carried_by([base], relations) & solids.keys() - moved.keys()):
            x, y, z = (a + b for a, b in zip(solids[name].position, shift, strict=True))
            there[name] = solids[name].moved((x, y, z))
    return there
