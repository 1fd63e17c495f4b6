"""Keeps when hands last had hold of objects, whether objects have fallen since, and how each hold ended."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from statistics import median
from typing import NamedTuple

from dsr.math3d.transforms import Pose
from dsr.perception.scales import CONTACT_DELAY, SURE_SIGMAS
from dsr.vocabulary.handling import ENDED, Handling
from simulation_handler.contact.relations import Relation
from simulation_handler.hands.relation import DROPPED, LET_GO, PUT_DOWN
from simulation_handler.hands.state import UNSEEN, Hand
from simulation_handler.scales import ASTRAY
from simulation_handler.state.objects import BelievedObject

_REMEMBERED = 2.0 * CONTACT_DELAY  # s, longer than fingertips that open seem to touch what falls


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
    palm: Pose
    """World_from_hand"""
    place: Pose
    """World_from_object"""

    def height_with(self, palm: Pose) -> float:
        """World z (m) of the object if it went with the palm, which is there now: as that is shifted, or turned."""
        turned = palm @ self.palm.inverse() @ self.place
        return min(self.place.t[2] + palm.t[2] - self.palm.t[2], turned.t[2])


class LettingGo:
    """Remembers holds and their ends, by (hand, object)."""

    def __init__(self) -> None:
        self._holds: dict[Relation, tuple[_Hold, ...]] = {}  # of the last moments
        self._aloft: dict[Relation, float] = {}  # s, when each was last seen in the air while its hand was not seen
        self._ended: dict[Relation, LetGo] = {}

    @property
    def ended(self) -> Mapping[Relation, LetGo]:
        """How the last hold of each object ended, until a hand holds it again."""
        return self._ended

    def keep(self, relation: Relation, hand: Hand, item: BelievedObject, now: float) -> None:
        """Fingertips have hold of an object at time `now` (s); for a moment they may seem to, as it falls."""
        recent = self._recent(relation, now)
        if not _has_fallen(hand, item, recent, now):
            self._holds[relation] = (*recent, _Hold(min(now, item.path.newest), hand.path.last, item.path.last))

    def keep_aloft(self, relation: Relation, item: BelievedObject, now: float) -> None:
        """An object is seen in the air at time `now` (s), and its hand is out of sight: that has hold of it still."""
        self._holds[relation] = tuple(self._recent(relation, now))  # where the palm was before tells nothing any more
        self._aloft[relation] = item.path.newest

    def _recent(self, relation: Relation, now: float) -> list[_Hold]:
        return [hold for hold in self._holds.get(relation, ()) if now - hold.time <= _REMEMBERED]

    def has_fallen(self, relation: Relation, hand: Hand, item: BelievedObject, now: float) -> bool:
        """Whether an object is seen to have come down since the hand last had hold of it, by more than the hand."""
        return _has_fallen(hand, item, self._holds.get(relation, ()), now)

    def begin(self, relation: Relation) -> None:
        """A hand holds an object again."""
        self._ended = {known: end for known, end in self._ended.items() if known[1] != relation[1]}
        self._holds = {known: hold for known, hold in self._holds.items() if known[1] != relation[1]}
        self._aloft = {known: time for known, time in self._aloft.items() if known[1] != relation[1]}

    def end(self, relation: Relation, state: Handling, latest: float) -> None:
        """A hand does not hold an object any more, since `latest` (s) at the latest.

        It has not let go of what it has in something.
        """
        if state not in ENDED and state is not PUT_DOWN:
            return
        aloft = self._aloft.get(relation, -math.inf)
        last = max((*(hold.time for hold in self._holds.get(relation, ())), aloft))
        last = latest if last == -math.inf else last
        self._ended[relation] = LetGo(state, min(last, latest))

    def resolve(self, relation: Relation, hand: Hand, item: BelievedObject, now: float) -> None:
        """An object that a hand let go unseen is seen again: it has fallen, or lies where it was.

        Of what is lower, and may have gone down with its hand, nobody knows; nor of what is still in the air.
        """
        end, holds = self._ended.get(relation), self._holds.get(relation, ())
        is_confirmed = item.path.newest >= item.track.last_stamp  # a single percept that is far away may be false
        if end is None or end.state is not LET_GO or not is_confirmed or not holds:
            return
        if self.has_fallen(relation, hand, item, now):
            self._ended[relation] = LetGo(DROPPED, end.since)
        elif item.hovering_since is None and (_is_known(hand, now) or not _is_lower(item, holds)):
            self._ended[relation] = LetGo(PUT_DOWN, end.since)

    def forget(self, name: str) -> None:
        """Forget an object or a hand that is no more."""
        self._holds = {relation: hold for relation, hold in self._holds.items() if name not in relation}
        self._aloft = {relation: time for relation, time in self._aloft.items() if name not in relation}
        self._ended = {relation: end for relation, end in self._ended.items() if name not in relation}


def _has_fallen(hand: Hand, item: BelievedObject, holds: Sequence[_Hold], now: float) -> bool:
    """Whether an object has come down since then, by more than the hand: one that is not seen may have gone with it.

    Both are compared when the object came to where it is now: a hand that has put it down may rise at once.
    """
    if not holds or not _is_known(hand, now) or item.path.newest <= holds[-1].time:
        return False
    low = item.path.last.t[2] + 0.5 * _by_noise(item)
    down = next(pose for pose in item.path.since(holds[0].time) if pose.t[2] <= low)
    palm = hand.path.at(down.stamp)
    with_hand = median(hold.height_with(palm) for hold in holds)  # palms are noisy, and it may fall already
    return _is_lower(item, holds) and with_hand > item.path.last.t[2] + _by_noise(item)


def _is_known(hand: Hand, now: float) -> bool:
    """Whether it is known where a hand is."""
    return hand.perceived and now - hand.path.newest <= UNSEEN


def _is_lower(item: BelievedObject, holds: Sequence[_Hold]) -> bool:
    """Whether an object is lower than it was in the hand, by more than noise."""
    noise = math.sqrt(2.0) * _by_noise(item)  # both are percepts
    return max(hold.place.t[2] for hold in holds) > item.path.last.t[2] + noise


def _by_noise(item: BelievedObject) -> float:
    """Metres by which a percept of an object may be too low by noise alone: the farther it is seen from, the more."""
    return max(ASTRAY, SURE_SIGMAS * item.noise)
