"""Finds hands that cover an object while they take it: fingertips and object are unseen when they close.

A hand that rests with its fingers at an object which it hides is presumed to touch it. If it goes away and the object
is not seen where it was, it is in that hand, until it is seen elsewhere than there. What is seen to be missing where a
hand has covered it, even in passing, or touches it, was taken by that.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass

from dsr.math3d import quaternions
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose
from dsr.perception.scales import AT_REST, CONFIRM_FRAMES, CONFIRMED_IN, FRAME, SLOWLY
from simulation_handler.contact.relations import Relation
from simulation_handler.explaining.situation import VisibilityQuery
from simulation_handler.hands.anatomy import HAND
from simulation_handler.hands.state import ELSEWHERE, FINGERS, HALF, UNSEEN, Hand
from simulation_handler.perception.paths import Path, between
from simulation_handler.scales import GONE_FROM
from simulation_handler.shapes.geometry import Solid
from simulation_handler.state.bodies import Bodies
from simulation_handler.state.objects import BelievedObject

RESOLVED = 2
"""Number of visible fingertips from which contact tells what a hand touches"""
_GRIPS = tuple((k / FINGERS * HAND.reach, 0.0, 0.0) for k in range(FINGERS + 1))
"""m, in the palm's frame: where a hand may have what it holds, from the palm to between the fingertips"""
_GRIP_REACH = 0.5 * HAND.palm.size[1]  # m from there to the surface of the object: half the palm's width
_TURNING = 1.5  # s in which what a hand covers turns with it


@dataclass
class Cover:
    """A hand that covers an object."""

    since: float
    """Begin of the cover, s."""
    hand_from_object: Pose
    anchor: Pose
    """Pose of the palm in the world while it rested"""
    place: Vector3
    """(3,) m, where the object was then"""
    taken: bool = False
    """The hand went away, and the object was not seen since."""


class Covering:
    """Keeps track of which hands cover which objects, and may have taken them."""

    def __init__(self, bodies: Bodies) -> None:
        self._bodies = bodies
        self._covers: dict[Relation, Cover] = {}
        self._palms: dict[str, Pose] = {}
        self._now = -math.inf
        self._passed: dict[str, tuple[float, str, Pose]] = {}  # when a hand last covered each object, and how

    @property
    def covers(self) -> Mapping[Relation, Cover]:
        """Covers by (hand, object)."""
        return self._covers

    def place(self, hand: str, thing: str) -> Pose:
        """World_from_object of a covered object, by the present pose of the hand."""
        return self._palms[hand] @ self._covers[hand, thing].hand_from_object

    def forget(self, name: str) -> None:
        """Forget an object that is no more."""
        self._covers = {relation: cover for relation, cover in self._covers.items() if name not in relation}
        self._passed.pop(name, None)

    def take(self, name: str, now: float) -> str:
        """Find the hand that must have taken a missing object, and let that hand have it from now on; empty if none can
        have.
        """
        time, hand, there = self._passed.get(name, (-math.inf, "", None))
        if there is None or time < self._bodies.object(name).track.last_stamp - UNSEEN:
            return ""
        self.recall((hand, name), there, now)
        return hand

    def recall(self, relation: Relation, hand_from_object: Pose, since: float) -> None:
        """Believe again that a hand has taken an object that it covered."""
        nowhere = (math.inf, math.inf, math.inf)
        self._covers[relation] = Cover(since, hand_from_object, _point(nowhere), nowhere, taken=True)
        if relation[1] in self._bodies.sim:
            begin = self._bodies.pose(relation[1])
            for stamp in (since - FRAME, since):
                self._bodies.object(relation[1]).path.add(begin.with_stamp(stamp))

    def update(
        self, hands: Mapping[str, Hand], busy: Collection[Relation], visibility: VisibilityQuery | None, now: float
    ) -> None:
        """Decide at time `now` (s) which objects are covered.

        Args:
            hands: all that are known.
            busy: (hand, object) that touch by what is seen of fingertips: those know better.
            visibility: what cameras should see; without it nothing is covered.
            now: s
        """
        self._follow(hands, now)
        for (name, thing), cover in list(self._covers.items()):
            is_known = name in hands and thing in self._bodies.sim and (name, thing) not in busy
            if not is_known or not self._goes_on(name, hands[name], self._bodies.object(thing), cover, now):
                del self._covers[name, thing]
        taken = {thing for _, thing in (*busy, *self._covers)}
        occupied = {name for name, _ in (*busy, *self._covers)}
        for name, hand in hands.items():
            if visibility is None or not hand.perceived or hand.measured >= RESOLVED or name in occupied:
                continue
            thing = self._covered(name, hand, visibility, taken)
            if thing:
                there = self._palms[name].inverse() @ self._bodies.pose(thing)
                self._passed[thing] = (now, name, there)
                if hand.path.is_still(AT_REST, GONE_FROM, math.inf):
                    self._covers[name, thing] = Cover(now, there, _mean(hand.path), self._bodies.pose(thing).t)
                    taken.add(thing)

    def _follow(self, hands: Mapping[str, Hand], now: float) -> None:
        """Turn with the hands in sight, slowly: of one whose fingers are not seen, little tells how it is turned."""
        seconds, self._now = max(now - self._now, 0.0), now
        covering = {name for name, _ in self._covers}
        for name in self._palms.keys() - hands.keys():
            del self._palms[name]
        for name, hand in hands.items():
            if hand.perceived:
                last = hand.path.last
                before = self._palms.get(name, last)
                share = 1.0 - math.exp(-seconds / (_TURNING if name in covering else CONFIRMED_IN))
                is_lost = last.stamp - before.stamp > 2.0 * UNSEEN
                turned = last.q if is_lost else quaternions.slerp(before.q, last.q, share)
                self._palms[name] = Pose.unchecked(last.t, turned, last.stamp)

    def _goes_on(self, name: str, hand: Hand, item: BelievedObject, cover: Cover, now: float) -> bool:
        """Whether a hand goes on covering an object; brings up to date how."""
        if not hand.perceived:
            return True
        palm = self._palms[name]
        is_seen = now - item.track.last_stamp <= UNSEEN
        has_left = hand.path.strays_from(cover.anchor, GONE_FROM)
        if is_seen and item.path.newest > -math.inf:
            stamp = min(hand.path.newest, item.path.newest)
            there = Pose.unchecked(hand.path.at(stamp).t, palm.q).inverse() @ item.path.at(stamp)
            cover.taken |= math.dist(item.path.last.t, cover.place) > GONE_FROM
            if math.dist(there.t, cover.hand_from_object.t) > ELSEWHERE or (has_left and not cover.taken):
                return False
            cover.hand_from_object = between(cover.hand_from_object, there, SLOWLY)
        elif has_left:
            cover.taken = True
        elif not cover.taken:
            here = self._bodies.pose(item.name)
            cover.hand_from_object = between(cover.hand_from_object, palm.inverse() @ here, SLOWLY)
            item.path.add(here.with_stamp(palm.stamp))  # where its way in the hand begins
        return True

    def _covered(self, name: str, hand: Hand, visibility: VisibilityQuery, taken: Collection[str]) -> str:
        """The object at the fingers of a hand that hides it, the nearest; empty if there is none."""
        near = [
            item
            for item in self._bodies.objects.values()
            if item.name in self._bodies.sim and item.name not in taken and not item.holder and item.hand in ("", name)
            if is_within_reach(hand.path.last, self._bodies.solid(item.name))
        ]
        if not near:
            return ""
        among = [self._bodies.solid(other) for other in self._bodies.objects if other in self._bodies.sim]
        visibilities = visibility([self._bodies.solid(item.name) for item in near], among)
        hidden = []
        for item, by_camera in zip(near, visibilities, strict=True):
            seen = by_camera.values()
            if all(g.share < HALF for g in seen) and any(g.hidden_by == name for g in seen):
                hidden.append((self._distance(hand, item.name), item.name))
        return min(hidden)[1] if hidden else ""

    def _distance(self, hand: Hand, thing: str) -> float:
        place = (hand.path.last.inverse() @ self._bodies.pose(thing)).t
        return min(math.dist(place, grip) for grip in _GRIPS)


def is_within_reach(palm: Pose, solid: Solid) -> bool:
    """Whether a hand, whose palm is there in the world, may have a body in it."""
    if math.dist(palm.t, solid.position) > HAND.reach + _GRIP_REACH + solid.radius:
        return False
    return any(solid.signed_distance((palm @ _point(grip)).t)[0] <= _GRIP_REACH for grip in _GRIPS)


def _mean(path: Path) -> Pose:
    """Where something was, that rests."""
    places = [path.at(path.newest - k * FRAME).t for k in range(1, 2 * CONFIRM_FRAMES)]  # its ends may be motions
    x, y, z = (sum(values) / len(places) for values in zip(*places, strict=True))
    return _point((x, y, z))


def _point(place: Vector3) -> Pose:
    return Pose.unchecked(place, (0.0, 0.0, 0.0, 1.0))
