"""Keeps what was done with each object: taken up from where it lay, put down, or dropped; by whom, and how surely.

Each deed is a transition of what is believed anyway: who holds the object, whether something carries it, and how a
hand came to hold it no more. What hovers, and nothing known holds, is in the hand of somebody unknown.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose
from dsr.perception.scales import CONFIRMED_IN, SAME_PLACE, SLOW, STEADY
from dsr.vocabulary.handling import Handling
from dsr.vocabulary.nats import EXPECTED, RARE
from dsr.vocabulary.observed_actions import KEPT, PICK, PLACE, RELEASE, UNKNOWN, Deed
from simulation_handler.contact.containment import Containment
from simulation_handler.contact.relations import ContactRelations
from simulation_handler.hands.covering import is_within_reach
from simulation_handler.hands.letting_go import LetGo
from simulation_handler.hands.relation import DONE, LEFT_BEHIND, LET_GO
from simulation_handler.hands.state import HAND_REACH, Hand
from simulation_handler.hands.touching import Touching
from simulation_handler.perception.paths import Path
from simulation_handler.scales import ASTRAY, GAP, GONE_FROM
from simulation_handler.shapes.geometry import Solid
from simulation_handler.state.bodies import FLOOR, Bodies
from simulation_handler.state.objects import BelievedObject
from simulation_handler.worlds.followed import WRONG
from simulation_handler.worlds.model import ObjectState, WeightedWorld

SEEN_LIFTED = 1.0 - math.exp(-RARE)
"""1, that somebody unknown has what was seen on its way up: otherwise its percepts are false, which is rare"""
GUESSED = 1.0 - math.exp(-EXPECTED)
"""1, that of two ways in which nobody saw something happen it was the likelier one: the other is to be expected, too"""


class HoldMoment(NamedTuple):
    """What is believed of an object at one moment."""

    time: float
    """s"""
    pose: Pose
    """world_from_object"""
    bottom: float
    """m, world z of its lowest point"""
    holder: str = ""
    """Hand or gripper that holds it; empty for none that is known"""
    held: float = 1.0
    """1, probability that the holder does hold it, or, of what hovers, that somebody unknown does"""
    near: str = ""
    """The only hand within reach of it; empty for none, or several"""
    palm: float | None = None
    """m, world z of the palm in sight, or the gripper, that has it, or had it last; None if that is not known"""
    opens: bool = False
    """Whether the fingers of its holder are seen apart from it just now."""
    hovers: bool = False
    """Whether nothing known carries it."""
    rests: bool = False
    """Whether something carries it, and nothing holds it."""
    carried: float = 1.0
    """1, probability that it is on or in what is said to carry it then"""
    falls: bool = False
    """Whether it was seen to fall when it was seen last."""
    lowered: bool = False
    """Whether it was seen, or was in a hand, on its way down then."""
    was_followed: bool = True
    """Whether it was seen on its way to there: otherwise its percepts jumped, as false ones do."""
    follows: bool = False
    """Whether it goes along with something, or only cameras in doubt tell that it moves."""
    is_seen: bool = True
    """Whether a camera has seen it lately."""
    path: Path | None = None
    """The way on which it was seen, or went with a hand; None of what is in a gripper"""

    def above(self, other: HoldMoment) -> float:
        """How much higher it is than there, m. Bottom and centre must agree: it may be tipped over."""
        return min(self.bottom - other.bottom, self.pose.t[2] - other.pose.t[2])


@dataclass
class _Hold:
    """An object in the hand or gripper of somebody."""

    by: str
    """Who holds it, or held it last"""
    sure: float
    """1, probability that it does, or did until its fingers opened"""
    since: float
    """s, from when on: what ended before was another hold"""
    lifted: bool
    """Whether it was taken up from where it lay."""
    begun: Vector3
    """m, where it was then"""
    last: HoldMoment
    """When it was last known to be held: in sight, or by a hand in sight"""
    settled: HoldMoment
    """Since when it has been where it is"""
    rests_since: float | None = None
    """s, since when it rests again; None while it does not"""
    vanished: HoldMoment | None = None
    """`last` as it was when neither it nor who holds it was seen any more; None if it was seen since"""


class Deeds:
    """Tells what was done with objects.

    Args:
        bodies: of the belief.
        touching: what hands do.
        relations: by contact.
        containment: what is in what.
    """

    def __init__(
        self, bodies: Bodies, touching: Touching, relations: ContactRelations, containment: Containment
    ) -> None:
        self._bodies = bodies
        self._touching = touching
        self._relations = relations
        self._containment = containment
        self._lay: dict[str, HoldMoment] = {}
        self._low: dict[str, float] = {}  # s, when each was last no higher than it lay
        self._placed: set[str] = set()  # at the moment before
        self._holds: dict[str, _Hold] = {}
        self._deeds: dict[str, tuple[Deed, ...]] = {}

    def of(self, name: str) -> tuple[Deed, ...]:
        """The last deeds with an object, oldest first."""
        return self._deeds.get(name, ())

    def recall(self, name: str, deeds: Sequence[Deed]) -> None:
        """Take over what an earlier run has told of an object."""
        self._deeds[name] = tuple(deeds)[-KEPT:]

    def forget(self, name: str) -> None:
        """Forget an object that is no more."""
        self._lose(name)
        self._deeds.pop(name, None)

    def _lose(self, name: str) -> None:
        """An object has no place any more: nobody knows what is done with it."""
        self._lay.pop(name, None)
        self._low.pop(name, None)
        self._holds.pop(name, None)
        self._placed.discard(name)

    def update(
        self,
        poses: Mapping[str, Pose | None],
        in_doubt: Collection[str],
        worlds: Callable[[str], Sequence[WeightedWorld]],
        now: float,
    ) -> None:
        """Take in where objects are believed to be at time `now` (s), world_from_object.

        Args:
            poses: of all objects; None for one without a place.
            in_doubt: those of which only cameras tell that may have been bumped.
            worlds: gives the weighted worlds of an object.
            now: s
        """
        carriers: dict[str, set[str]] = {}
        for name, carrier in (*self._relations.current(), *self._containment.current()):
            carriers.setdefault(name, set()).add(carrier)
        for name, pose in poses.items():
            if pose is None:
                self._lose(name)
                continue
            item = self._bodies.objects[name]
            solid = self._bodies.solid(name)
            if math.dist(solid.position, pose.t) > GAP:  # what is on its way is ahead of its body
                solid = item.solid(pose.t, pose.q)
            moment = self._moment(item, solid, carriers.get(name, set()), now)
            is_led = item.rides or (name in in_doubt and not moment.holder)
            self.take_in(name, self._weighed(name, moment._replace(follows=is_led), carriers, worlds))

    def _weighed(
        self,
        name: str,
        moment: HoldMoment,
        carriers: Mapping[str, Collection[str]],
        worlds: Callable[[str], Sequence[WeightedWorld]],
    ) -> HoldMoment:
        """The moment with how probable it is what decides in it."""

        def weight(fits: Callable[[WeightedWorld], bool]) -> float:
            """Weight of the worlds that fit; 1 if there are none, as of what was never seen since a restart."""
            every = worlds(name)
            return sum(world.weight for world in every if fits(world)) if every else 1.0

        if moment.holder:
            return moment._replace(held=weight(lambda world: world.objects[name].hand == moment.holder))
        if moment.hovers:
            chance = SEEN_LIFTED if moment.was_followed else GUESSED
            return moment._replace(held=chance * weight(lambda world: world.reason != WRONG))
        if name in self._holds and moment.rests and FLOOR not in carriers[name]:
            return moment._replace(carried=weight(lambda world: _is_carried(world.objects[name], carriers[name])))
        return moment

    def _moment(self, item: BelievedObject, solid: Solid, carriers: Collection[str], now: float) -> HoldMoment:
        """What is believed of an object, but for probabilities."""
        holder = item.holder or item.hand
        hovers = item.static or (item.driven and item.hovering_since is not None)
        hold = self._holds.get(item.name)
        hand = self._touching.hands.get(item.hand or ("" if hold is None else hold.by))
        return HoldMoment(
            time=now,
            pose=solid.pose,
            bottom=solid.bottom,
            holder=holder,
            near=self._near(solid) if hovers and not holder else "",
            palm=self._palm(item, hand),
            opens=bool(item.hand) and self._touching.opens((item.hand, item.name)),
            hovers=hovers,
            rests=bool(carriers) and not (hovers or holder),
            was_followed=item.was_followed,
            falls=item.falls,
            lowered=item.path.velocity[2] < -SLOW,
            is_seen=item.track.is_fresh(now),
            path=None if item.holder else item.path,
        )

    def _palm(self, item: BelievedObject, hand: Hand | None) -> float | None:
        """World z (m) of the palm in sight of a hand, or, of what a gripper holds, of that."""
        if item.holder:
            return self._bodies.sim.position(item.name)[2]
        return hand.path.last.t[2] if hand is not None and hand.perceived else None

    def _near(self, solid: Solid) -> str:
        """The only hand in sight that has an object within reach; empty for none, or several."""
        hands = self._touching.hands.items()
        near = [name for name, hand in hands if hand.perceived and is_within_reach(hand.path.last, solid)]
        return near[0] if len(near) == 1 else ""

    def take_in(self, name: str, moment: HoldMoment) -> None:
        """Take in a moment of an object."""
        if name not in self._placed and self.of(name) and self.of(name)[-1].kind == PICK:
            self._resume(name, self.of(name)[-1], moment)
        hold = self._holds.get(name)
        if hold is None:
            self._begin(name, moment)
        else:
            self._go_on(name, hold, moment)
        self._placed.add(name)

    def _resume(self, name: str, picked: Deed, moment: HoldMoment) -> None:
        """It has a place again. Who had taken it up has it still, as far as is known: nobody saw it meanwhile."""
        by = picked.by if picked.by in self._touching.hands else UNKNOWN
        held = picked.probability * GUESSED
        self._holds[name] = _Hold(by, held, moment.time, True, moment.pose.t, moment, moment)

    def _begin(self, name: str, moment: HoldMoment) -> None:
        """It is held from now on if it is higher than it lay, or was never seen to lie, and somebody has it."""
        if moment.rests:
            self._lay[name] = moment
        if not (moment.holder or moment.hovers) or moment.follows:
            return
        by, lay = moment.holder or moment.near or UNKNOWN, self._lay.get(name)
        if lay is not None and moment.above(lay) <= ASTRAY:
            self._low[name] = moment.time
        hold = _Hold(by, moment.held, moment.time, lay is not None, moment.pose.t, moment, moment)
        if lay is None:
            if moment.holder and moment.hovers:
                self._holds[name] = hold
        elif moment.above(lay) > ASTRAY and (moment.holder or (moment.is_seen and not moment.falls)):
            self._holds[name] = hold
            del self._lay[name]
            self._add(name, Deed(PICK, _left_at(lay, self._low.get(name, lay.time), moment), by, hold.sure))
            hold.since = self.of(name)[-1].time

    def _go_on(self, name: str, hold: _Hold, moment: HoldMoment) -> None:
        """It is held until nobody has it any more, and it falls or rests."""
        if math.dist(moment.pose.t, hold.settled.pose.t) > SAME_PLACE:
            hold.settled = moment
        if moment.holder and (moment.holder != hold.by or not moment.opens):
            hold.by, hold.sure = moment.holder, moment.held
        if moment.holder or (moment.hovers and not moment.falls):
            hold.rests_since = None
            if moment.is_seen or moment.palm is None:
                hold.vanished = None if moment.is_seen else hold.last
            if (moment.hovers and moment.is_seen) or (moment.palm is not None and not moment.opens):
                hold.last = moment
            return
        end = self._touching.let_go.get((hold.by, name))
        if end is not None and end.since < hold.since:
            end = None
        found = _outcome(hold, moment, end)
        if found is None:
            return
        kind, time, sure = found
        del self._holds[name]
        if hold.lifted or math.dist(hold.begun, hold.settled.pose.t) > GONE_FROM:
            self._add(name, Deed(kind, time, hold.by, sure * hold.sure * moment.carried))

    def _add(self, name: str, deed: Deed) -> None:
        """Keep a deed, which is later than the one before."""
        before = self.of(name)
        time = max(deed.time, math.nextafter(before[-1].time, math.inf)) if before else deed.time
        sure = min(round(deed.probability, 2), 1.0)
        self._deeds[name] = (*before, Deed(deed.kind, time, deed.by, sure))[-KEPT:]


def _is_carried(state: ObjectState, carriers: Collection[str]) -> bool:
    """Whether an object is on or in one of these in some world."""
    return not set(carriers).isdisjoint((*state.supports, *state.containers))


def _left_at(lay: HoldMoment, low: float, moment: HoldMoment) -> float:
    """When (s) an object that is higher than it lay has left there, by its way, if that was seen; else now.

    Its body was last as low at `low` (s). That is behind what is seen, but not by more than it takes to be confirmed.
    """
    start = None if moment.path is None else moment.path.start(lay.pose, GONE_FROM)
    return moment.time if start is None else max(start, max(low, lay.time) - CONFIRMED_IN)


def _outcome(hold: _Hold, moment: HoldMoment, end: LetGo | None) -> tuple[str, float, float] | None:
    """What was done with an object that nobody holds any more, when (s), and how surely; None while nobody knows."""
    state, let_go_at = (Handling.FREE, hold.last.time) if end is None else end
    known, settled_at = DONE.get(state), hold.settled.time if end is None else min(hold.settled.time, end.since)
    if moment.falls or known == RELEASE:
        return RELEASE, let_go_at, 1.0
    if not moment.rests:
        hold.rests_since = None
        return None
    hold.rests_since = moment.time if hold.rests_since is None else hold.rests_since
    last = hold.vanished if state is LEFT_BEHIND and hold.vanished is not None else hold.last
    down = last.bottom - moment.bottom
    fell = state is LET_GO and _has_left_palm(last, moment)
    is_known = known == PLACE or fell or moment.is_seen
    if not is_known and moment.time - hold.rests_since < STEADY:
        return None  # it may yet be missing there
    if down <= ASTRAY or known == PLACE:
        return PLACE, settled_at, 1.0
    if fell or (down > HAND_REACH and not last.lowered):
        return RELEASE, let_go_at, GUESSED
    return PLACE, settled_at if moment.is_seen else let_go_at, GUESSED


def _has_left_palm(last: HoldMoment, moment: HoldMoment) -> bool:
    """Whether an object has come down by more than the palm in sight that had it last, and that did not lower it."""
    if last.palm is None or moment.palm is None or last.lowered:
        return False
    return last.bottom - moment.bottom - max(last.palm - moment.palm, 0.0) > ASTRAY
