"""Finds objects that hands must be moving, whatever their visible fingertips show, because nothing else can.

They hover and move rigidly with a palm; or they are moved while the only hand that had them within reach is hidden.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import NamedTuple

from dsr.math3d import quaternions
from dsr.math3d.quaternions import Quaternion, Vector3
from dsr.math3d.transforms import Pose
from simulation_handler.contact.relations import Relation
from simulation_handler.hands.covering import is_within_reach
from simulation_handler.hands.state import ELSEWHERE, FINGERS, UNSEEN, Hand
from simulation_handler.motion.movers import coasts, may_push
from simulation_handler.scales import TILTED
from simulation_handler.shapes.geometry import Solid
from simulation_handler.state.bodies import Bodies
from simulation_handler.state.objects import BelievedObject

_RIGID = 0.25
"""Share of the way by which the palm may seem to go elsewhere: a hand that only passes by goes its own way."""


class _Start(NamedTuple):
    """Where an object was that has hovered near a hand ever since."""

    time: float
    """s"""
    position: Vector3
    """m, in the world"""
    hand_from_object: Pose


class Carrying:
    """Finds objects in hands of which some fingertips are hidden: nothing else can hold an object in the air."""

    def __init__(self, bodies: Bodies) -> None:
        self._bodies = bodies
        self._starts: dict[Relation, _Start] = {}
        self._hidden: dict[Relation, _Start] = {}  # since the hand is out of sight

    def moved_unseen(self, hands: Mapping[str, Hand], held: Collection[str], now: float) -> dict[Relation, _Start]:
        """Objects that are seen to move, and were last within reach of one hand, which nobody sees any more.

        Nothing moves by itself: that hand does, unless another one may, or another object pushes it, or it coasts.

        Args:
            hands: all that are known.
            held: objects that something is known to hold or contain.
            now: s.
        """
        hidden: dict[Relation, _Start] = {}
        by_hand: dict[str, list[Relation]] = {}
        for item in self._bodies.objects.values():
            if item.name in held or item.holder or item.name not in self._bodies.sim:
                continue
            if now - item.track.last_stamp > UNSEEN or coasts(item, self._seen(item)):
                continue
            for name, hand in hands.items():
                relation, palm = (name, item.name), hand.path
                start = self._hidden.get(relation)
                if palm.newest == -math.inf or (start is None and not is_within_reach(palm.last, self._seen(item))):
                    continue
                by_hand.setdefault(item.name, []).append(relation)
                if not hand.perceived:
                    before = item.path.at(palm.newest)
                    hidden[relation] = start or _Start(palm.newest, before.t, palm.last.inverse() @ before)
        self._hidden = hidden
        return {
            relation: start
            for (relation,) in (found for found in by_hand.values() if len(found) == 1)
            if (start := hidden.get(relation)) is not None and self._is_moved(relation[1], start)
        }

    def _is_moved(self, name: str, start: _Start) -> bool:
        """Whether an object is seen on its way, on which no other one can have pushed it."""
        item, objects = self._bodies.objects[name], self._bodies.objects.values()
        seen = self._seen(item)
        others = (other for other in objects if other.driven and other is not item)
        is_away = item.path.strays_from(Pose.unchecked(start.position, seen.rotation), ELSEWHERE)
        return item.driven and is_away and not any(may_push(other, seen) for other in others)

    def _seen(self, item: BelievedObject) -> Solid:
        return item.solid(item.path.last.t, item.path.last.q)

    def update(
        self, hands: Mapping[str, Hand], held: Collection[str], now: float
    ) -> dict[Relation, tuple[float, Pose]]:
        """Since when (s) hands have carried objects that are seen, and hand_from_object, by (hand, object).

        Args:
            hands: all that are known.
            held: objects that something is known to hold or contain.
            now: s.
        """
        starts: dict[Relation, _Start] = {}
        carried: dict[Relation, tuple[float, Pose]] = {}
        for item in self._bodies.objects.values():
            if item.name in held or item.name not in self._bodies.sim or not _hovers(item, now):
                continue
            for name, hand in hands.items():
                if not hand.perceived or hand.measured >= FINGERS:
                    continue
                stamp = min(hand.path.newest, item.path.newest)
                palm, there = hand.path.at(stamp), item.path.at(stamp)
                if not is_within_reach(palm, self._bodies.solid(item.name)):
                    continue
                relation, hand_from_object = (name, item.name), palm.inverse() @ there
                start = self._starts.get(relation, _Start(stamp, there.t, hand_from_object))
                distance = math.dist(there.t, start.position)
                if distance >= ELSEWHERE:
                    if math.dist(hand_from_object.t, start.hand_from_object.t) <= _RIGID * distance:
                        carried[relation] = start.time, hand_from_object
                    start = _Start(stamp, there.t, hand_from_object)
                starts[relation] = start
        self._starts = starts
        return carried


def _hovers(item: BelievedObject, now: float) -> bool:
    """Whether an object is seen in the air, and neither falls nor is in a gripper."""
    is_seen = now - item.track.last_stamp <= UNSEEN
    return is_seen and item.hovering_since is not None and not item.holder and not item.falls


def levelled(solid: Solid) -> Quaternion:
    """Rotation of a solid by its hand, levelled: a small tilt counts as noise of the hand, a large one is kept.

    Up to half the tilt that noise alone may give, all is noise. Beyond the whole of that, all is tilt.
    """
    flat, tilt = solid.face_down()
    return quaternions.slerp(flat.rotation, solid.rotation, min(max(2.0 * tilt / TILTED - 1.0, 0.0), 1.0))


def without_yaw(rotation: Quaternion) -> Quaternion:
    """The tilt of a rotation alone: hands tell yaw less well than is known of the objects in them."""
    return quaternions.product(rotation, quaternions.conjugate(quaternions.about_z(rotation)))
