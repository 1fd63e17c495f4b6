"""Finds objects that a hand should show and does not: they were left where both were out of sight together."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass

from dsr.believing.absence import missed, most_missed
from dsr.math3d.transforms import Pose
from dsr.perception.scales import FRAME
from dsr.vocabulary.nats import RARE, SURPRISING
from simulation_handler.contact.relations import Relation
from simulation_handler.explaining.situation import VisibilityQuery
from simulation_handler.perception.visibility import ExpectedVisibility
from simulation_handler.scales import GONE_FROM
from simulation_handler.state.bodies import Bodies
from simulation_handler.state.objects import BelievedObject

_NOTHING = ExpectedVisibility(0.0, "")


@dataclass
class _Unseen:
    """What is known of an object in a hand that is not seen."""

    place: Pose | None = None
    """World_from_object when the hand, too, was seen no more; or where it surely was then"""
    absent_since: float | None = None
    """s, since when the hand is in sight and the object should be"""
    was_hidden: bool = False
    """The hand, too, was out of sight meanwhile."""
    hides: bool = False
    """The hand hides the object as it holds it: it is not seen since the hand took hold, whatever a model says."""


class LeftBehind:
    """Keeps the time for which hands have been back without the objects that they held."""

    def __init__(self, bodies: Bodies) -> None:
        self._bodies = bodies
        self._unseen: dict[Relation, _Unseen] = {}

    def keep(self, relations: Collection[Relation]) -> None:
        """Forget all but these (hand, object), which are held and not seen."""
        self._unseen = {relation: self._unseen.get(relation, _Unseen()) for relation in relations}

    def hide(self, relation: Relation) -> None:
        """Neither the hand nor the object is seen."""
        unseen = self._unseen[relation]
        unseen.absent_since, unseen.was_hidden = None, True
        if unseen.place is None:
            unseen.place = self._bodies.objects[relation[1]].path.last

    def is_absent(
        self, relation: Relation, there: Pose, sure: Pose, visibility: VisibilityQuery | None, now: float
    ) -> bool | None:
        """Whether the object, which the hand in sight would have `there`, should have been seen, too, for too long.

        None while it need not be seen: it goes with the hand then. If the hand was always in sight, the object surely
        was at `sure` before; what is not seen there either is in the hand, held in another way than it seems. A hand
        that hides some of it may, rarely, hide all of it and not seem to. Where it was seen last it would be missed as
        much without the hand: a hand that is still there hides it.
        """
        unseen, item = self._unseen[relation], self._bodies.objects[relation[1]]
        if unseen.hides and not unseen.was_hidden:
            return None
        seen, needed, is_due = self._expected(item, there, visibility), SURPRISING, True
        if not unseen.was_hidden and seen.hidden_by == relation[0]:
            needed += RARE
            is_due = most_missed(self._expected(item, sure, visibility).recognised) < SURPRISING
        if not is_due or most_missed(seen.recognised) < needed:
            unseen.absent_since = None
            return None
        if unseen.absent_since is None:
            unseen.absent_since, unseen.place = now, unseen.place or sure
        if missed((now - unseen.absent_since) / FRAME, seen.recognised) < needed:
            return False
        last_seen = item.path.at(item.track.last_stamp)
        unseen.hides = not unseen.was_hidden and math.dist(there.t, last_seen.t) <= GONE_FROM
        return None if unseen.hides else True

    def part(self, relation: Relation, sure: Pose, now: float) -> None:
        """The hand has gone where it cannot have taken the object, which surely was at `sure` before."""
        unseen = self._unseen[relation]
        unseen.absent_since, unseen.place = now, unseen.place or sure

    def place(self, relation: Relation, visibility: VisibilityQuery | None) -> Pose | None:
        """Where an object was left that should be seen where it is believed to be, and is not; None if there is none.

        A hand that was out of sight with an object may return and be seen to be open: it may have let go at any time.
        The object is not where it would be in plain sight.
        """
        unseen = self._unseen.get(relation)
        if unseen is None or unseen.place is None:
            return None
        if unseen.absent_since is None:
            item = self._bodies.objects[relation[1]]
            expected = self._expected(item, item.path.last, visibility)
            if not unseen.was_hidden or most_missed(expected.recognised) < SURPRISING:
                return None
        return unseen.place

    def _expected(self, item: BelievedObject, there: Pose, visibility: VisibilityQuery | None) -> ExpectedVisibility:
        """How much should be seen of an object that is there, by the camera that sees most."""
        if visibility is None:
            return _NOTHING
        bodies = self._bodies
        among = [bodies.solid(name) for name in bodies.objects if name in bodies.sim]
        (by_camera,) = visibility([item.solid(there.t, there.q)], among)
        return max(by_camera.values(), key=lambda one: one.share, default=_NOTHING)
