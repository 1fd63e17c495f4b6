"""Finds which fingertips touch which objects, and which hands pinch them, by the percepts of both.

Contact is looked for where hand and object were seen at the same time, for the bodies of the simulation are a little
late. Where the object is not seen it is looked for about the body, and about where the hand that holds it has it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

from dsr.perception.scales import CONTACT_DELAY
from simulation_handler.contact.relations import ContactRelations, Relation
from simulation_handler.hands.fingertips import Gaps, Met, Spans, is_opposed, meet, within
from simulation_handler.hands.relation import PUT_DOWN
from simulation_handler.hands.state import UNSEEN, Hand, HandGrasp
from simulation_handler.shapes.geometry import Solid
from simulation_handler.state.bodies import Bodies
from simulation_handler.state.objects import BelievedObject


class Contacts:
    """Keeps track of touches and pinches, with hysteresis.

    Args:
        bodies: of the belief.
        hands: all that are known, as they are at any time.
        grasps: likewise what they hold, by (hand, object).
    """

    def __init__(self, bodies: Bodies, hands: Mapping[str, Hand], grasps: Mapping[Relation, HandGrasp]) -> None:
        self._bodies = bodies
        self._hands = hands
        self._grasps = grasps
        self._touches = ContactRelations(CONTACT_DELAY)
        self._pinches = ContactRelations(CONTACT_DELAY)
        self._gaps = Gaps()
        self._spans = Spans()
        self._now: tuple[set[Relation], set[Relation]] = set(), set()  # without delay
        self.closed: set[Relation] = set()
        """(hand, object) that pinched, and whose fingertips are now seen as far apart as they were then"""

    @property
    def touches(self) -> Mapping[Relation, float]:
        """(fingertip, object) and since when, s."""
        return self._touches.current()

    @property
    def pinches(self) -> Mapping[Relation, float]:
        """(hand, object) and since when, s."""
        return self._pinches.current()

    def since(self) -> dict[Relation, float]:
        """Since when (s) hands have touched objects: (hand, object); the hand is empty if it is known no more."""
        owners = {tip: name for name, hand in self._hands.items() for tip in hand.tips}
        touched: dict[Relation, float] = {}
        for (tip, item), since in self.touches.items():
            relation = (owners.get(tip, ""), item)
            touched[relation] = min(since, touched.get(relation, since))
        return touched

    def recall_pinch(self, relation: Relation, since: float, now: float) -> None:
        """Restore a pinch that held in an earlier run."""
        self._pinches.recall(relation, since, now)

    def end(self, relation: Relation) -> None:
        """A hand holds an object no more, whatever seemed to touch."""
        hand, thing = relation
        self._pinches.end(relation)
        for tip in self._hands[hand].tips if hand in self._hands else ():
            self._touches.end((tip, thing))

    def forget(self, name: str) -> None:
        """Forget an object that is no more."""
        self._touches.forget(name)
        self._pinches.forget(name)

    def update(self, now: float) -> None:
        """Look for contact at time `now` (s)."""
        self.closed = set()
        self._now = touching, opposed = self._found(now)
        self._touches.update(touching, now)
        self._pinches.update(opposed, now)
        self._spans.keep(opposed | self._pinches.current().keys())

    def opens(self, relation: Relation) -> bool:
        """Whether a hand that holds an object may be letting go of it just now."""
        (touching, opposed), (hand, thing) = self._now, relation
        was_pinched = relation in self.pinches and relation not in opposed
        return was_pinched or not any((tip, thing) in touching for tip in self._hands[hand].tips)

    def seen_at(self, hand: Hand, item: BelievedObject, now: float) -> tuple[float, Solid]:
        """A time (s) for which both are known, and where the object was then."""
        if now - item.track.last_stamp > UNSEEN:
            return hand.path.newest, self._bodies.solid(item.name)
        stamp = min(hand.path.newest, item.path.newest)
        pose = item.path.at(stamp)
        return stamp, item.solid(pose.t, pose.q)

    def _found(self, now: float) -> tuple[set[Relation], set[Relation]]:
        """(fingertip, object) and (hand, object) that touch, and pinch, as far as can be told."""
        touching: set[Relation] = set()
        opposed: set[Relation] = set()
        known = self.touches.keys()
        for name, hand in self._hands.items():
            for item in self._bodies.objects.values():
                if item.name not in self._bodies.sim or item.holder or drops(hand, item):
                    continue
                if not hand.perceived:
                    touching |= known & {(tip, item.name) for tip in hand.tips}
                    opposed |= {(name, item.name)} & self.pinches.keys()
                    continue
                touched = self._touched(name, item, known, now)
                touching |= {(tip, item.name) for tip in touched}
                if self._is_pinched((name, item.name), touched, self.seen_at(hand, item, now)[1], item.noise, now):
                    if not self._was_put_down((name, item.name), now):
                        opposed.add((name, item.name))
                elif sum(met is not None for met in touched.values()) < 2 <= len(touched):
                    opposed |= {(name, item.name)} & self.pinches.keys()
        return touching, opposed

    def _is_pinched(
        self, relation: Relation, touched: Mapping[str, Met | None], solid: Solid, noise: float, now: float
    ) -> bool:
        """Whether fingertips at an object are on opposite sides, or were, and are as far apart as then."""
        points = {tip: met.point for tip, met in touched.items() if met is not None}
        is_closed = relation in self.pinches and bool(self._spans.closed(relation, points, solid, noise))
        if is_closed and not self._was_put_down(relation, now):
            self.closed.add(relation)
        if is_opposed(touched):
            self._spans.note(relation, touched)
            return True
        return is_closed

    def _was_put_down(self, relation: Relation, now: float) -> bool:
        """Whether a hand was seen to open about what rested, which is not seen now, so that it looks pinched again."""
        grasp, item = self._grasps.get(relation), self._bodies.objects[relation[1]]
        return grasp is not None and grasp.state is PUT_DOWN and now - item.track.last_stamp > UNSEEN

    def _touched(
        self, name: str, item: BelievedObject, known: Collection[Relation], now: float
    ) -> dict[str, Met | None]:
        """Fingertips of a hand that touch an object; None for one that is not measured now."""
        hand = self._hands[name]
        is_seen = now - item.track.last_stamp <= UNSEEN
        stamp, solid = self.seen_at(hand, item, now)
        solids = [solid]
        touching = {tip: path.at(stamp).t for tip, path in hand.tips.items() if hand.measures(path)}
        if item.hand == name and not is_seen:
            grasp = self._grasps[item.hand, item.name]  # its body comes later
            there = hand.path.last @ grasp.hand_from_object
            solids.append(item.solid(there.t, there.q))
            holding = {tip: point for tip, point in touching.items() if (tip, item.name) in known}
            place = grasp.at_fingertips(holding, solid.rotation) if len(holding) > 1 else None
            solids += [] if place is None else [item.solid(place, solid.rotation)]
        found: dict[str, Met | None] = {}
        for solid in solids:
            near = meet(solid, touching)
            gaps = {(tip, item.name): met.gap for tip, met in near.items()}
            touch = self._gaps.touching(gaps, known, item.noise, now) if is_seen else within(gaps, known)
            if is_seen and (name, item.name) in self.pinches:
                closed = self._spans.closed((name, item.name), touching, solid, item.noise)
                touch |= {(tip, item.name) for tip in closed & near.keys()}
            met: dict[str, Met | None] = {tip: near[tip] for tip, _ in sorted(touch)}
            if (is_opposed(met), len(met)) > (is_opposed(found), len(found)):
                found = met
        touched = {tip for tip in hand.tips if (tip, item.name) in known}
        if not found and touched & touching.keys():  # seen away: so are those, very likely, that are hidden
            return {}
        return found | dict.fromkeys(touched - touching.keys())


def drops(hand: Hand, item: BelievedObject) -> bool:
    """Whether the object was falling when it was last seen, while the hand was unseen."""
    return item.falls and not hand.path.is_falling
