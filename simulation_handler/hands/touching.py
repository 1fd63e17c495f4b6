"""Follows hands: the objects that they touch, how, and the objects that go with them unseen.

What is seen of an object counts more than what is seen of the hand that holds it; while it is unseen, it is where
the hand has it; while neither is seen, nothing changes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from dsr.math3d.transforms import Pose
from dsr.perception.scales import CONFIRMED_IN, CONTACT_DELAY, UNSEEN_AFTER
from dsr.vocabulary.handling import ENDED, HOLDING, Handling
from simulation_handler.contact.containment import Containment
from simulation_handler.contact.relations import Relation
from simulation_handler.explaining.situation import VisibilityQuery
from simulation_handler.hands.carrying import Carrying
from simulation_handler.hands.contacts import Contacts, drops
from simulation_handler.hands.covering import RESOLVED, Covering
from simulation_handler.hands.going_along import GoingAlong
from simulation_handler.hands.letting_go import LetGo, LettingGo
from simulation_handler.hands.relation import (
    COVERING,
    FREE,
    HIDING,
    LEFT_BEHIND,
    PINCHING,
    TOUCHING,
    Sign,
    holds,
    is_told,
)
from simulation_handler.hands.state import (
    ELSEWHERE,
    FINGERS,
    HALF,
    HAND_REACH,
    UNSEEN,
    Hand,
    HandGrasp,
    HandPercept,
)
from simulation_handler.perception.paths import Path, between
from simulation_handler.perception.visibility import ExpectedVisibility
from simulation_handler.state.bodies import Bodies
from simulation_handler.state.objects import BelievedObject

_GRIP_BLEND = 0.2  # weight of the newest in how a hand holds an object


class Touching:
    """Keeps track of hands and of the objects that they hold."""

    def __init__(self, bodies: Bodies, containment: Containment) -> None:
        self.visibility: VisibilityQuery | None = None
        """What cameras should see; None without one."""
        self._bodies = bodies
        self._containment = containment
        self._hands: dict[str, Hand] = {}
        self._grasps: dict[Relation, HandGrasp] = {}
        self._contacts = Contacts(bodies, self._hands, self._grasps)
        self._covering = Covering(bodies)
        self._carrying = Carrying(bodies)
        self._going_along = GoingAlong(bodies, containment, self._hands, self._grasps, self._contacts, self._covering)
        self._letting_go = LettingGo()
        self._over: dict[Relation, Handling] = {}  # how the grasps that have just ended did
        self._recalled: dict[Relation, float] = {}  # s up to which a recalled grasp may wait for its touch

    @property
    def grasps(self) -> Mapping[Relation, HandGrasp]:
        """Grasps of objects that hands touch, by (hand, object)."""
        return {relation: grasp for relation, grasp in self._grasps.items() if grasp.state not in ENDED}

    @property
    def holds(self) -> Mapping[Relation, HandGrasp]:
        """Grasps of objects that may be held, by (hand, object)."""
        return {
            (hand, thing): grasp
            for (hand, thing), grasp in self._grasps.items()
            if is_told(grasp.state, held=self._bodies.objects[thing].hand == hand)
        }

    @property
    def let_go(self) -> Mapping[Relation, LetGo]:
        """How the last hold of each object ended that no hand holds now, by (hand, object)."""
        return self._letting_go.ended

    @property
    def hands(self) -> Mapping[str, Hand]:
        """All hands that are known, by name."""
        return self._hands

    def opens(self, relation: Relation) -> bool:
        """Whether a hand in sight that holds an object may be letting go of it just now: (hand, object)."""
        hand = self._hands.get(relation[0])
        if hand is None or not hand.perceived:
            return False
        has_just_opened = relation in self._grasps and self._grasps[relation].has_just_opened(hand.path.newest)
        return has_just_opened or self._contacts.opens(relation)

    def paths(self) -> dict[str, Path]:
        """Paths of the fingertips in sight, by name."""
        return {
            name: path
            for hand in self._hands.values()
            if hand.perceived
            for name, path in sorted(hand.tips.items())
            if hand.measures(path)
        }

    def observe(self, hands: Mapping[str, HandPercept]) -> None:
        """Take in the percepts of all hands; hands that are not among them are gone."""
        for name in self._hands.keys() - hands.keys():
            del self._hands[name]
            self._letting_go.forget(name)
        for name, percept in hands.items():
            hand = self._hands.setdefault(name, Hand())
            hand.perceived = percept.perceived
            if not percept.perceived:
                continue
            hand.path.add(percept.pose)
            for tip in hand.tips.keys() - percept.tips.keys():
                if not self._may_touch_hidden(tip, hand):
                    del hand.tips[tip]
            for tip, pose in percept.tips.items():
                hand.tips.setdefault(tip, Path()).add(pose)

    def _may_touch_hidden(self, tip: str, hand: Hand) -> bool:
        """Whether a fingertip that is hidden goes on touching: what is hidden with it, or anything for a short time."""
        now = hand.path.newest
        touched = [self._bodies.objects[thing] for name, thing in self._contacts.touches if name == tip]
        is_short = now - hand.tips[tip].newest <= UNSEEN_AFTER
        return any(is_short or now - item.track.last_stamp > UNSEEN for item in touched)

    def recall(self, relation: Relation, grasp: HandGrasp, now: float) -> None:
        """Restore a grasp that held in an earlier run."""
        if grasp.is_covered:
            self._covering.recall(relation, grasp.hand_from_object, grasp.since)
            return
        self._grasps[relation] = grasp
        self._recalled[relation] = math.inf
        if grasp.state is PINCHING:
            self._contacts.recall_pinch(relation, grasp.since, now)

    def forget(self, name: str) -> None:
        """Forget an object that is no more."""
        for relation in [relation for relation in self._grasps if name in relation]:
            del self._grasps[relation]
        self._contacts.forget(name)
        self._covering.forget(name)
        self._letting_go.forget(name)

    def take(self, name: str, now: float) -> str:
        """Find the hand that must have taken a missing object, and let that hand have it from now on; empty if none
        touches or covered it.
        """
        for (hand, thing), grasp in self._grasps.items():
            is_at_it = grasp.state in (TOUCHING, COVERING) and hand in self._hands and self._hands[hand].perceived
            if thing == name and is_at_it:
                grasp.note(Sign.COVERED)  # what is missed where a hand is at it is hidden by that
                if grasp.is_covered:
                    self._covering.recall((hand, thing), grasp.hand_from_object, now)
                    return hand
        return self._covering.take(name, now)

    def update(self, now: float) -> None:
        """Decide at time `now` (s) which objects are touched and held. Unseen held objects go with their hand."""
        self._contacts.update(now)
        self._update_grasps(now)
        self._update_covered(now)
        self._update_carried(now)
        holders = self._holders(now)
        for item in self._bodies.objects.values():
            before, item.hand = item.hand, holders.get(item.name, "")
            item.turned_by_hand = item.place_by_hand = None
            if item.hand and item.hand != before:
                self._letting_go.begin((item.hand, item.name))
            if before and not item.hand:
                self._let_go(item, before, now)
        for hand, thing in self._letting_go.ended:
            item = self._bodies.objects[thing]
            if hand in self._hands and now - item.track.last_stamp <= UNSEEN:
                self._letting_go.resolve((hand, thing), self._hands[hand], item, now)
        held = [item for item in self._bodies.objects.values() if item.hand]
        self._going_along.keep(held, now)
        for item in held:
            relation = item.hand, item.name
            if not self._hands[item.hand].perceived:
                if item.is_in_air and not item.falls and now - item.track.last_stamp <= UNSEEN:
                    self._letting_go.keep_aloft(relation, item, now)
                continue
            if not self.opens(relation):
                self._letting_go.keep(relation, self._hands[item.hand], item, now)
            self._going_along.follow(item, self.visibility, now)
            if self._grasps[relation].state is LEFT_BEHIND:
                self._let_go(item, item.hand, now)

    def _let_go(self, item: BelievedObject, hand: str, now: float) -> None:
        """A hand does not hold an object any more."""
        item.hand, item.let_go_at = "", now
        relation = hand, item.name
        state = self._grasps[relation].state if relation in self._grasps else self._over.get(relation, FREE)
        left_at = self._going_along.leave(item, hand, self.visibility, now)
        if hand in self._hands:  # of one that is no more, nobody can say anything
            self._letting_go.end(relation, state, left_at)

    def _goes_on_hiding(self, relation: Relation, now: float) -> bool:
        """Whether a hand is presumed to hold what it hides, if only in part, with the fingertips that would tell."""
        (name, thing), hand = relation, self._hands.get(relation[0])
        is_seen = now - self._bodies.objects[thing].track.last_stamp <= UNSEEN
        if is_seen or self._grasps[relation].state is not HIDING or hand is None or hand.measured >= FINGERS:
            return False
        return any(visible.hidden_by == name for visible in self._visibilities(thing))

    def _update_grasps(self, now: float) -> None:
        """Begin, go on and end."""
        for relation, until in list(self._recalled.items()):
            if relation not in self._grasps or now > until:
                del self._recalled[relation]
            elif (seen := self._hands.get(relation[0])) is not None and seen.perceived:
                self._recalled[relation] = min(until, now + 2.0 * CONTACT_DELAY)
        self._over = {}
        touched, pinched = self._contacts.since(), self._contacts.pinches
        for relation in [relation for relation, grasp in self._grasps.items() if not grasp.is_covered]:
            is_touched = relation in touched or self._is_aloft(relation, now) or self._goes_on_hiding(relation, now)
            is_elsewhere = self._is_elsewhere(relation, now)
            if is_elsewhere or self._is_over(relation, is_touched):
                self._contacts.end(relation)
                self._end(relation, Sign.ELSEWHERE if is_elsewhere else self._parting(relation, now))
        for relation, since in self._contacts.since().items():
            name, thing = relation
            is_covered = relation in self._grasps and self._grasps[relation].is_covered and relation not in pinched
            if name in self._hands and thing in self._bodies.sim and self._hands[name].perceived and not is_covered:
                self._go_on(relation, since, relation in pinched, now)

    def _update_covered(self, now: float) -> None:
        """The grasps of hands that cover what they touch: those of which fingertips say nothing."""
        busy = {
            relation
            for relation, grasp in self._grasps.items()
            if not grasp.is_covered and (grasp.state is PINCHING or self._hands[relation[0]].measured >= RESOLVED)
        }
        self._covering.update(self._hands, busy, self.visibility, now)
        covers = self._covering.covers
        for relation in [relation for relation, grasp in self._grasps.items() if grasp.is_covered]:
            if relation not in covers:
                self._end(relation, Sign.ELSEWHERE)
        for relation, cover in covers.items():
            grasp = self._grasps.setdefault(relation, HandGrasp(cover.since, cover.hand_from_object))
            grasp.hand_from_object = cover.hand_from_object
            grasp.note(Sign.COVERED)
            if cover.taken:
                grasp.note(Sign.TAKEN)

    def _update_carried(self, now: float) -> None:
        """Begin grasps of what only a hand can be moving whose fingertips are not all seen, or that is hidden."""
        held = {thing for _, thing in self._grasps} | {thing for thing, _ in self._containment.current()}
        for relation, (since, hand_from_object) in self._carrying.update(self._hands, held, now).items():
            self._grasps[relation] = grasp = HandGrasp(since, hand_from_object, aloft=now)
            grasp.note(Sign.TOUCHES)
        for relation, start in self._carrying.moved_unseen(self._hands, held, now).items():
            self._grasps[relation] = grasp = HandGrasp(start.time, start.hand_from_object)
            grasp.note(Sign.TOUCHES)

    def _go_on(self, relation: Relation, since: float, is_pinched: bool, now: float) -> None:
        """A hand in sight touches an object: begin that grasp, or bring it up to date."""
        name, thing = relation
        item, hand = self._bodies.objects[thing], self._hands[name]
        there = self._hand_from_object(hand, item, now)
        grasp = self._grasps.setdefault(relation, HandGrasp(since, there))
        is_seen = now - item.track.last_stamp <= UNSEEN
        for sign in self._signs(relation, grasp, since, now, is_pinched=is_pinched, is_seen=is_seen):
            grasp.note(sign)
        if is_seen:
            grasp.sure = None
        if relation in self._contacts.closed:
            grasp.opened = -math.inf  # it was a false look
        if is_seen or not item.hand:
            before = grasp.hand_from_object
            if not item.shows_tilt:
                there = Pose.unchecked(there.t, before.q)
            grasp.hand_from_object = between(before, there, _GRIP_BLEND)
            self._note_places(grasp, hand, item, now)

    def _signs(
        self, relation: Relation, grasp: HandGrasp, since: float, now: float, *, is_pinched: bool, is_seen: bool
    ) -> Iterator[Sign]:
        """Evidence of fingertips that touch an object."""
        item, hand = self._bodies.objects[relation[1]], self._hands[relation[0]]
        yield Sign.TOUCHES
        if is_seen:
            yield Sign.SHOWN
        if is_pinched:
            yield Sign.OPPOSED
        if is_seen and self._drops(relation, now):
            yield Sign.FALLS
        if is_pinched:
            return
        at_rest = Sign.OPEN_ALOFT if item.hovering_since is not None else Sign.OPEN_AT_REST
        yield at_rest if is_seen else Sign.OPEN_UNSEEN
        if math.dist(self._hand_from_object(hand, item, now).t, grasp.met) > ELSEWHERE:
            yield Sign.ALONG
        if not is_seen and since < now - CONFIRMED_IN and self._hides(*relation):
            yield Sign.HIDDEN

    def _drops(self, relation: Relation, now: float) -> bool:
        """Whether an object has come down from fingertips that may have opened."""
        hand, item = self._hands[relation[0]], self._bodies.objects[relation[1]]
        return self._contacts.opens(relation) and self._letting_go.has_fallen(relation, hand, item, now)

    def _parting(self, relation: Relation, now: float) -> Sign:
        """Evidence of how a hand came to touch an object no more."""
        hand, item = self._hands.get(relation[0]), self._bodies.objects[relation[1]]
        is_seen = now - item.track.last_stamp <= UNSEEN
        if hand is None:
            return Sign.PARTED
        if drops(hand, item) or (is_seen and self._letting_go.has_fallen(relation, hand, item, now)):
            return Sign.FALLS
        return Sign.PARTED_AT_REST if is_seen and item.hovering_since is None else Sign.PARTED

    def _end(self, relation: Relation, sign: Sign) -> None:
        """Forget a grasp that ends with that evidence, but for this moment how it did."""
        grasp = self._grasps.pop(relation)
        grasp.note(sign)
        self._over[relation] = grasp.state

    def _hides(self, name: str, thing: str) -> bool:
        """Whether a hand hides an object that it touches, and some of its own fingertips are hidden, too."""
        hand = self._hands[name]
        if self.visibility is None or hand.measured >= FINGERS:
            return False
        visibilities = self._visibilities(thing)
        return all(visible.share < HALF for visible in visibilities) and any(
            visible.hidden_by == name for visible in visibilities
        )

    def _visibilities(self, thing: str) -> list[ExpectedVisibility]:
        """What each camera should see of an object."""
        if self.visibility is None or thing not in self._bodies.sim:
            return []
        among = [self._bodies.solid(other) for other in self._bodies.objects if other in self._bodies.sim]
        (by_camera,) = self.visibility([self._bodies.solid(thing)], among)
        return list(by_camera.values())

    def _is_over(self, relation: Relation, is_touched: bool) -> bool:
        """Whether an object is touched no more, as far as that can be known."""
        hand = self._hands.get(relation[0])
        if hand is None:
            return True
        is_known = hand.perceived or drops(hand, self._bodies.objects[relation[1]])
        return is_known and not is_touched and relation not in self._recalled

    def _is_aloft(self, relation: Relation, now: float) -> bool:
        """Whether a hand carries an object in the air, or did until that was hidden a moment before the hand."""
        grasp, hand = self._grasps[relation], self._hands.get(relation[0])
        is_seen = now - self._bodies.objects[relation[1]].track.last_stamp <= UNSEEN
        goes_on = now - grasp.aloft <= (CONTACT_DELAY if is_seen else UNSEEN_AFTER)
        if (goes_on and hand is not None and not hand.perceived) or self._carries(relation, now):
            grasp.aloft = now
        return goes_on or grasp.aloft == now

    def _carries(self, relation: Relation, now: float) -> bool:
        """Whether an object that a hand held is seen in the air where that would have it: nothing else can hold it."""
        name, thing = relation
        item, hand = self._bodies.objects[thing], self._hands.get(name)
        hovers = item.is_in_air
        is_alone = sum(held == thing for _, held in self.grasps) == 1
        if hand is None or item.hand != name or not hovers or not is_alone or item.falls:
            return False
        stamp, solid = self._contacts.seen_at(hand, item, now)
        there = hand.path.at(stamp) @ self._grasps[relation].hand_from_object
        return now - item.track.last_stamp <= UNSEEN and math.dist(there.t, solid.position) < HAND_REACH

    def _hand_from_object(self, hand: Hand, item: BelievedObject, now: float) -> Pose:
        stamp, solid = self._contacts.seen_at(hand, item, now)
        return hand.path.at(stamp).inverse() @ solid.pose

    def _note_places(self, grasp: HandGrasp, hand: Hand, item: BelievedObject, now: float) -> None:
        """Keep in mind where fingertips touch an object."""
        stamp, solid = self._contacts.seen_at(hand, item, now)
        object_from_world = solid.pose.inverse()
        for tip, path in hand.tips.items():
            if (tip, item.name) in self._contacts.touches and hand.measures(path):
                place = object_from_world @ path.at(stamp)
                before = grasp.places.get(tip, place.t)
                x, y, z = (a + _GRIP_BLEND * (b - a) for a, b in zip(before, place.t, strict=True))
                grasp.places[tip] = (x, y, z)

    def _is_elsewhere(self, relation: Relation, now: float) -> bool:
        """Whether an object is seen where the hand, whose touching fingertips are unseen, cannot have it.

        That is, at rest elsewhere; or far from where a hand out of sight was, in another hand.
        """
        name, thing = relation
        item, hand = self._bodies.objects[thing], self._hands.get(name)
        if hand is None or thing not in self._bodies.sim or item.estimate_at(now) is None:
            return False
        if hand.perceived and hand.measured:
            return False
        there = hand.path.last @ self._grasps[relation].hand_from_object if hand.path.newest > -math.inf else None
        away = math.inf if there is None else math.dist(there.t, self._bodies.sim.position(thing))
        rests = not item.driven and item.placement is not None and item.placement.rests
        return (rests and away > ELSEWHERE) or (not hand.perceived and away > HAND_REACH and self._pinches(thing, name))

    def _pinches(self, thing: str, besides: str) -> bool:
        """Whether a hand in sight pinches an object, besides the one of that name."""
        return any(
            held == thing and name != besides and grasp.state is PINCHING and self._hands[name].perceived
            for (name, held), grasp in self._grasps.items()
            if name in self._hands
        )

    def _holders(self, now: float) -> dict[str, str]:
        """The hand that holds each object: pinches it, or touches what nothing else carries.

        What is in something that it holds goes along, unless it pinched that before.
        """
        holders: dict[str, str] = {}
        carried: dict[str, str] = {}
        for (hand, thing), grasp in sorted(self._grasps.items(), key=lambda entry: (entry[1].since, entry[0])):
            item = self._bodies.objects[thing]
            hovers = item.is_in_air
            is_seen = now - item.track.last_stamp <= UNSEEN
            if grasp.state in HOLDING:
                holders.setdefault(thing, hand)
            elif holds(grasp.state, held=item.hand == hand, hovers=hovers, seen=is_seen):
                carried.setdefault(thing, hand)
        held = carried | holders
        inside = [pair for pair in self._containment.current() if held.get(pair[0]) == held.get(pair[1])]
        goes_along = {
            thing for thing, hollow in inside if thing not in holders or self._held_longer(hollow, thing, held)
        }
        return {thing: hand for thing, hand in held.items() if thing not in goes_along}

    def _held_longer(self, hollow: str, thing: str, held: Mapping[str, str]) -> bool:
        """Whether a hand that seems to hold a container and what is in it held the container first."""
        hand = held.get(hollow, "")
        older, newer = (self._grasps.get((hand, name)) for name in (hollow, thing))
        return older is not None and newer is not None and older.since < newer.since
