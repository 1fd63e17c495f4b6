"""Lets what is held go along with its hand: it leans as that says, and while it is not seen it is where that has it."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping

from dsr.math3d.transforms import Pose
from dsr.perception.scales import AT_REST, SAME_PLACE, SLOWLY
from simulation_handler.contact.containment import Containment, with_contents
from simulation_handler.contact.placement import separate
from simulation_handler.contact.relations import Relation
from simulation_handler.explaining.situation import VisibilityQuery
from simulation_handler.hands.carrying import levelled, without_yaw
from simulation_handler.hands.contacts import Contacts
from simulation_handler.hands.covering import Covering
from simulation_handler.hands.left_behind import LeftBehind
from simulation_handler.hands.relation import LEFT_BEHIND, Sign
from simulation_handler.hands.state import ELSEWHERE, HAND_REACH, UNSEEN, Hand, HandGrasp
from simulation_handler.perception.paths import between
from simulation_handler.scales import GONE_FROM
from simulation_handler.state.bodies import Bodies
from simulation_handler.state.objects import BelievedObject

_PALM_AT_REST = (AT_REST, GONE_FROM, math.pi)  # s, m, rad: a palm that moved less has not opened, nor drawn back
_DRAWN_BACK = HAND_REACH  # m that an opening hand may draw back before its fingertips are seen


class GoingAlong:
    """Moves what hands hold.

    Args:
        bodies: of the belief.
        containment: what is in what.
        hands: all that are known, as they are at any time.
        grasps: likewise what they have to do with objects, by (hand, object).
        contacts: of their fingertips.
        covering: of hands that cover.
    """

    def __init__(
        self,
        bodies: Bodies,
        containment: Containment,
        hands: Mapping[str, Hand],
        grasps: Mapping[Relation, HandGrasp],
        contacts: Contacts,
        covering: Covering,
    ) -> None:
        self._bodies = bodies
        self._containment = containment
        self._hands = hands
        self._grasps = grasps
        self._contacts = contacts
        self._covering = covering
        self._left_behind = LeftBehind(bodies)

    def keep(self, held: Collection[BelievedObject], now: float) -> None:
        """Take in which objects hands hold at time `now` (s); of all others nothing is remembered."""
        unseen = {(item.hand, item.name) for item in held if now - item.track.last_stamp > UNSEEN}
        self._left_behind.keep(unseen)
        for hand, thing in unseen:
            if not self._hands[hand].perceived:
                self._left_behind.hide((hand, thing))

    def follow(self, item: BelievedObject, visibility: VisibilityQuery | None, now: float) -> None:
        """Let an object go with its hand, which is in sight; what that has left behind stays, and its state says so."""
        pose, relation = self._hands[item.hand].path.last, (item.hand, item.name)
        grasp = self._grasps[relation]
        there = self._covering.place(*relation) if grasp.is_covered else pose @ grasp.hand_from_object
        leaning = without_yaw(levelled(item.solid(there.t, there.q)))
        is_seen = now - item.track.last_stamp <= UNSEEN
        if not is_seen and not grasp.is_covered:
            sure = grasp.sure or item.path.at(item.track.last_stamp)
            is_absent = self._left_behind.is_absent(relation, there, sure, visibility, now)
            if is_absent:
                grasp.note(Sign.ABSENT)
            elif is_absent is None and self._is_through_wall(item, there):
                grasp.note(Sign.THROUGH_WALL)
                self._left_behind.part(relation, sure, now)
            if is_absent is not None or grasp.state is LEFT_BEHIND:
                return
        if not is_seen or math.dist(there.t, item.path.last.t) < ELSEWHERE:  # else the palm is not where it seems
            item.turned_by_hand, item.place_by_hand = leaning, there.t
        if not is_seen:
            turned = there.q if item.shows_rotation else leaning
            if grasp.is_covered or not self._contacts.opens(relation):
                item.path.add(self._in_fingers(item, Pose.unchecked(there.t, turned), pose))
                return
            grasp.opened = pose.stamp
            if (left := self._left(item)) is not None:
                item.path.add(left.with_stamp(pose.stamp))

    def leave(self, item: BelievedObject, hand: str, visibility: VisibilityQuery | None, now: float) -> float:
        """If that hand has come back without an object, that falls, with what is in it, from where it must be.

        Returns when (s) the hand last had it, as far as is known.
        """
        there, bodies = self._left_behind.place((hand, item.name), visibility), self._bodies
        if there is None or now - item.track.last_stamp <= UNSEEN:
            return now
        item.path.begin_anew(there.with_stamp(now))
        if math.dist(there.t, bodies.sim.position(item.name)) < GONE_FROM:
            return there.stamp
        scene, left = bodies.scene(leaving_out=()), item.solid(there.t, there.q).face_down()[0]
        moved = {item.name: bodies.on_contact(left, with_contents({item.name: left}, scene))}
        for solid in (moved | with_contents(moved, scene)).values():
            bodies.put(bodies.objects[solid.name], solid.position, solid.rotation)
        return there.stamp

    def _in_fingers(self, item: BelievedObject, there: Pose, palm: Pose) -> Pose:
        """Where an unseen object is that by the palm of its hand is `there`: it moves only if its fingertips do, too.

        A palm of which little is in sight seems to move, and so does a fingertip that opens. Where fingertips have it
        that were just seen apart, it is not for sure: they may only seem to touch it again.
        """
        grasp, hand = self._grasps[item.hand, item.name], self._hands[item.hand]
        touching = {
            tip: path.last.t
            for tip, path in hand.tips.items()
            if (tip, item.name) in self._contacts.touches and hand.measures(path)
        }
        by_fingertips = grasp.at_fingertips(touching, there.q)
        if by_fingertips is None:
            known = grasp.sure or item.path.at(item.track.last_stamp)
            rest = item.path.at(palm.stamp - 0.5 * _PALM_AT_REST[0])
            has_gone_on = math.dist(known.t, rest.t) > _DRAWN_BACK
            grasp.sure = rest if has_gone_on and hand.path.is_still(*_PALM_AT_REST) else known
            return Pose.unchecked(there.t, there.q, palm.stamp)
        before = item.path.last.t
        position = min(there.t, by_fingertips, key=lambda place: math.dist(place, before))
        held = Pose.unchecked(position, there.q, palm.stamp)
        grasp.hand_from_object = between(grasp.hand_from_object, palm.inverse() @ held, SLOWLY)
        if not grasp.has_just_opened(palm.stamp):
            grasp.sure = held
        return held

    def _is_through_wall(self, item: BelievedObject, there: Pose) -> bool:
        """Whether an object that is `there` would be through a wall of what it is in: its hand has left it behind."""
        hollows = [hollow for inner, hollow in self._containment.current() if inner == item.name]
        solids = [self._bodies.solid(hollow).face_down()[0] for hollow in hollows if hollow in self._bodies.sim]
        solid = item.solid(there.t, there.q).face_down()[0]
        moved = separate([*solids, solid], {item.name: 1.0}).get(item.name, there.t)
        return math.dist(moved, there.t) > SAME_PLACE

    def _left(self, item: BelievedObject) -> Pose | None:
        """Where a hand that is seen to have opened let go of an unseen object, before it drew back; None if unknown."""
        left = self._grasps[item.hand, item.name].sure
        is_near = left is not None and math.dist(left.t, item.path.last.t) <= _DRAWN_BACK
        return left if is_near else None
