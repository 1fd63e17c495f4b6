"""Finds objects that a hand should show and does not: they were left where both were out of sight together."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from dsr.math3d.transforms import Pose
from simulation_handler.contact.relations import Relation
from simulation_handler.explaining.situation import VisibilityQuery
from simulation_handler.hands.state import HALF
from simulation_handler.state.bodies import Bodies
from simulation_handler.state.objects import BelievedObject

_ABSENT, _ABSENT_IN_PART = 0.4, 1.5
"""s for which an object should have been seen and was not, after which the hand does not have it.

A hand that was always in sight may hide all of an object too, and not seem to.

"""
_CLEAR = 0.95  # 1, share of what there is to see of an object, from which nothing hides it


@dataclass
class _Unseen:
    """What is known of an object in a hand that is not seen."""

    place: Pose | None = None
    """World_from_object when the hand, too, was seen no more; or where it surely was then"""
    absent_since: float | None = None
    """s, since when the hand is in sight and the object should be"""
    was_hidden: bool = False
    """The hand, too, was out of sight meanwhile."""


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
        was at `sure` before; what is not seen there either is in the hand, held in another way than it seems.
        """
        unseen, item = self._unseen[relation], self._bodies.objects[relation[1]]
        share = 0.0 if visibility is None else self._share(item, there, visibility)
        may_hide = not (unseen.was_hidden or share > _CLEAR)
        if visibility is None or share < HALF or (may_hide and self._share(item, sure, visibility) >= HALF):
            unseen.absent_since = None
            return None
        if unseen.absent_since is None:
            unseen.absent_since, unseen.place = now, unseen.place or sure
        return now - unseen.absent_since >= (_ABSENT_IN_PART if may_hide else _ABSENT)

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
            if visibility is None or not unseen.was_hidden or self._share(item, item.path.last, visibility) < HALF:
                return None
        return unseen.place

    def _share(self, item: BelievedObject, there: Pose, visibility: VisibilityQuery) -> float:
        """Of its image, that a camera should see of an object that is there; of the camera that sees most."""
        bodies = self._bodies
        others = [bodies.solid(name) for name in bodies.objects if name in bodies.sim and name != item.name]
        visibilities = visibility([*others, item.solid(there.t, there.q)])
        return max((visible.share for (_, name), visible in visibilities.items() if name == item.name), default=0.0)
