"""Drives the bodies of objects that are seen to move along the way that they were seen to take.

A body that is put elsewhere leaves behind what is in it and goes through what is in its way. One that is driven moves
at a velocity that is set anew at each step of physics, so that contact takes along what is in it, on it, or pushed by
it, however deep, and whatever way it is tilted.

The way is played a little late, smoothed, so that noise shakes nothing and no body overshoots where it comes to rest.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence, Set

import numpy as np

from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose
from dsr.perception.scales import (
    AT_REST,
    CONFIRMED_IN,
    FRAME,
    LIKELY_SIGMAS,
    LONGEST_GAP,
    ONE_MOMENT,
    PRESENT,
    SAME_PLACE,
    STEADY,
    SURE_SIGMAS,
)
from dsr.vocabulary import nats
from simulation_handler.config import BeliefConfig
from simulation_handler.contact.containment import Containment
from simulation_handler.contact.perceived import PerceivedBody
from simulation_handler.contact.placement import are_side_by_side, near, place
from simulation_handler.contact.relations import ContactRelations, Relation
from simulation_handler.contact.stances import beside, likeliest_stance, misfit
from simulation_handler.contact.supports import UNKNOWN
from simulation_handler.explaining.drafting import UNSEEN_COVARIANCE
from simulation_handler.explaining.scoring import seems_displaced
from simulation_handler.hands.state import ELSEWHERE, UNSEEN, Hand
from simulation_handler.motion.drives import (
    CATCHING_UP,
    Drive,
    goes_with_hand,
    is_lifted,
    seen_speed,
    stands_or_leans,
    towards,
    velocity_of,
)
from simulation_handler.motion.movers import Movers
from simulation_handler.motion.rolling import rolling
from simulation_handler.motion.supported_objects import HALTED, SupportedObjects, only_base
from simulation_handler.perception.percepts import Array
from simulation_handler.physics.rollouts.scene import STILL
from simulation_handler.physics.simulator import TIME_STEP
from simulation_handler.scales import ASTRAY, GONE_FROM, GRAVITY, PLACE_FLOOR
from simulation_handler.shapes.geometry import Solid
from simulation_handler.state.bodies import Bodies
from simulation_handler.state.objects import BelievedObject

_BODY_LAG = 0.5 * FRAME  # s by which a body is behind what is seen: half of the time until that is known better
HURRY = 2.0
"""1, how many times as fast as it was seen to a body may move to catch up"""
_ARRIVED = LIKELY_SIGMAS * PLACE_FLOOR  # m from where it is seen: nearer, models may be off
_SHORTEST = CONFIRMED_IN  # s of a drive: what sets out slowly has been seen to stay for a while
_OTHER_MOTION = 0.5  # of the way that a load was seen to take, by which that of what it stands on is another one


class Driving:
    """Decides which bodies are driven, and drives them."""

    def __init__(
        self,
        bodies: Bodies,
        relations: ContactRelations,
        containment: Containment,
        hands: Mapping[str, Hand],
        config: BeliefConfig,
    ) -> None:
        self._bodies = bodies
        self._movers = Movers(bodies.objects, hands)
        self._supported = SupportedObjects(bodies, relations, containment)
        self._config = config
        self._drives: dict[str, Drive] = {}
        self._leaders: dict[str, str] = {}  # driven object on or in which each other one is
        self._now = -math.inf

    def update(
        self, now: float, staying: Set[str] = frozenset(), in_doubt: Set[str] = frozenset(),
        missed: Set[str] = frozenset(),
    ) -> None:  # fmt: skip
        """Begin, continue and end drives at time `now` (s).

        Args:
            now: s
            staying: objects that rather are where they were, while their camera moved: what has set out is put back.
            in_doubt: objects of which only cameras tell that probably were: those set out in a hand alone.
            missed: objects that cameras should see where they are, and have not shown for surprisingly long.
        """
        seconds, self._now = max(now - self._now, 0.0), now
        for name in [name for name in self._drives if not self._may_go_on(name)]:
            del self._drives[name]
        before, starts = set(self._drives), dict[str, float]()
        for item in self._bodies.objects.values():
            if item.name in self._drives:
                self._go_on(item, self._drives[item.name], now, seconds)
            elif (start := self._start(item, now)) is not None:
                starts[item.name] = start
        for name in sorted(staying & {name for name in self._drives if self.set_out_from(name)}):
            self._put_back(name)
        for name, start in starts.items():
            if name not in staying | in_doubt or self._bodies.objects[name].hand:
                self._begin(self._bodies.objects[name], start)
        self._lead_from_below(self._drives.keys() - before, now)
        self._let_pass(now, missed)
        supported = self._supported.supported(self._drives)
        self._leaders = {load: name for name in sorted(self._drives) for load in self._supported.supported([name])}
        for item in self._bodies.objects.values():
            item.driven = item.name in self._drives
            item.rides = item.name in supported and not self._is_lost(item, now)

    def _put_back(self, name: str) -> None:
        """Let an object and its load be where it has set out, and be driven no more."""
        back = self._drives.pop(name).origin @ self._bodies.pose(name).inverse()
        for other in sorted({name, *self._supported.supported([name])}):
            if other in self._bodies.objects and other in self._bodies.sim:
                pose = back @ self._bodies.pose(other)
                self._bodies.put(self._bodies.objects[other], pose.t, pose.q)

    def _lead_from_below(self, new: Set[str], now: float) -> None:
        """What stands on an object that is on its way goes with that.

        If it sets out first, that comes along, or it waits until it is sure that they part.
        """
        beneath = self._supported.beneath()
        for name in sorted(new & beneath.keys()):
            load, start = self._bodies.objects[name], self._drives[name].played
            for base in sorted(beneath[name] & self._bodies.objects.keys() - self._drives.keys()):
                item = self._bodies.objects[base]
                if item.holder or load.hand or item.estimate_at(now) is None:
                    continue
                way, other = self._way(item), self._way(load)
                if float(np.linalg.norm(way - other)) < _OTHER_MOTION * float(np.linalg.norm(other)):
                    self._begin(item, start)
                elif float(np.linalg.norm(other)) < GONE_FROM:
                    self._drives.pop(name, None)
        for name in sorted(self._drives.keys() & beneath.keys()):
            item = self._bodies.objects[name]
            others = self._drives.keys() - {name}
            if not item.hand and only_base(name, beneath, others) and not self._is_lost(item, now):
                self._drives.pop(name)

    def _way(self, item: BelievedObject) -> Array:
        """(3,) m from where an object is believed to be to where it was seen last."""
        return np.subtract(item.path.at(item.path.newest).t, self._bodies.sim.position(item.name))

    def _let_pass(self, now: float, missed: Set[str]) -> None:
        """Bodies beside each other, of which one is driven, do not push each other while both are seen: that tells all.

        Their thin walls would get into each other by the noise of that, and not out again without a kick. Nor is
        pushed what was missed before: it is not where the driven one was seen to pass.
        """
        sim, objects = self._bodies.sim, self._bodies.objects.values()
        led = {name for name, drive in self._drives.items() if not drive.runs}
        seen = {item.name for item in objects if now - item.track.last_stamp <= UNSEEN and item.name in sim}
        seen |= {name for name in missed if name in sim}
        pairs = sorted({(min(a, b), max(a, b)) for a in led for b in led | seen if a != b})
        supported = {name: self._supported.supported([name]) for name in {name for pair in pairs for name in pair}}
        sim.let_pass(
            {(a, b) for a, b in pairs if b not in supported[a] and a not in supported[b] and self._beside(a, b)}
        )

    def _beside(self, *pair: str) -> bool:
        """Whether neither of two bodies can be about to stand on the other, or both are driven."""
        return self._drives.keys() >= set(pair) or are_side_by_side(*map(self._bodies.solid, pair))

    def step(self, count: int) -> None:
        """Let `count` steps of physics pass."""
        sim = self._bodies.sim
        for name in self._drives:
            sim.wake(name)
        if not self._drives:
            self._bodies.pass_time(count)
            return
        led = {name: drive for name, drive in self._drives.items() if not drive.runs}
        loads = self._supported.standing(led.keys())
        pushed = self._supported.pushed({name: drive.speed for name, drive in led.items()}, loads)
        for k in range(1, count + 1):
            for name, drive in led.items():
                here = Pose.unchecked(*sim.pose(name))
                before, drive.velocity = drive.velocity, velocity_of(here, drive, k / count, count * TIME_STEP)
                (x, y, z), spin = drive.velocity
                sim.set_velocity(name, (x, y, z + GRAVITY * TIME_STEP), spin)
                for load in loads.get(name, ()):
                    self._supported.take_along(load, here, before, drive.velocity)
            sim.step()
            for name, speed in pushed.items():
                self._supported.slow_down(name, speed)

    @property
    def supports(self) -> set[Relation]:
        """Pairs (object, support) of the driven objects that slide or stand on something, which they hardly touch."""
        drives = self._drives.items()
        return {(name, base) for name, drive in drives for base in drive.supports or () if base != UNKNOWN}

    def lead(self, name: str) -> Vector3:
        """(3,) m that an object has moved on, by what was seen of its way, beyond its body, which is late.

        That of what is on or in a driven object is the same.
        """
        leader = name if name in self._drives else self._leaders.get(name, "")
        drive, item = self._drives.get(leader), self._bodies.objects.get(leader)
        if drive is None or item is None or drive.runs:
            return STILL
        late = min(self._now - drive.played, _BODY_LAG)
        x, y, z = (late * speed for speed in item.path.steady_velocity)
        return x, y, 0.0 if drive.rests else z

    def set_out_from(self, name: str) -> Pose | None:
        """World_from_object where a driven object has set out, if no hand moves it; None for others.

        It may still be there, and its camera has moved.
        """
        drive = self._drives.get(name)
        return None if drive is None or drive.by_hand or self._bodies.objects[name].hand else drive.origin

    def rests(self, name: str) -> bool:
        """Whether something carries a driven object where it is seen, and the object does not move any more."""
        drive = self._drives[name]
        return drive.rests and drive.still_since is not None

    def _may_go_on(self, name: str) -> bool:
        return name in self._bodies.objects and name in self._bodies.sim and not self._bodies.objects[name].holder

    def _start(self, item: BelievedObject, now: float) -> float | None:
        """From when (s) on an object is seen on its way from where it is believed to be; None if it is not."""
        is_seen = item.estimate_at(now) is not None
        if item.holder or item.name not in self._bodies.sim or (is_seen and now - item.path.newest > LONGEST_GAP):
            return None  # in the last case its way ended before a gap: where it is seen now is not confirmed yet
        if not is_seen:
            return item.path.newest if item.hand else None
        solid = self._bodies.solid(item.name)
        strays = self._strays(item, solid.pose)
        if item.hand and (strays or goes_with_hand(item, solid.position)):
            return item.path.newest
        if not strays and not seems_displaced(item, solid, self._config, now):
            return None
        is_explained = self._movers.explain_way(item, solid, self._drives.keys())
        start = item.path.start(solid.pose, GONE_FROM) if is_explained else None
        if start is None and not item.hand:
            return self._start_in_sight(item) if is_explained else None
        return item.path.newest if start is None else start

    def _start_in_sight(self, item: BelievedObject) -> float | None:
        """From when (s) on an object is seen on its way that set out unseen: its body is put where that was seen first.

        None if it does not move, or something may have come along with it: that is to be explained.
        """
        first = item.path.reappeared(GONE_FROM)
        if first is None or self._supported.supported([item.name]):
            return None
        self._bodies.put(item, first.t, self._bodies.pose(item.name).q)
        return first.stamp

    def _strays(self, item: BelievedObject, pose: Pose) -> bool:
        """Whether percepts say that an object is on its way from where it is believed to be."""
        two, three = self._by_noise(item, SURE_SIGMAS), self._by_noise(item, LIKELY_SIGMAS)
        return item.path.strays_from(pose, two) or item.path.goes_away(pose, three)

    def _by_noise(self, item: BelievedObject, sigmas: float) -> float:
        """Metres by which an object may seem elsewhere by so much noise, as far as its systematic error is known."""
        return max(ASTRAY, sigmas * math.hypot(item.noise, item.error_std(self._config)))

    def _begin(self, item: BelievedObject, start: float) -> None:
        self._bodies.set_static(item, False)
        item.was_followed, item.aslant = True, None
        here = self._bodies.pose(item.name)
        self._drives[item.name] = Drive(self._now, start, here, here, here)

    def _go_on(self, item: BelievedObject, drive: Drive, now: float, seconds: float) -> None:
        if not item.hand and self._is_out_of_sight(item, drive, now):
            self._let_run(item, drive, now)
            return
        if drive.runs:
            drive.runs, drive.played, drive.end = False, item.path.newest, self._bodies.pose(item.name)
        before, late = item.path.at(drive.played), now - _BODY_LAG - drive.played
        drive.played += min(late, HURRY * seconds) if late > 0.0 else 0.0
        drive.begin = drive.end
        drive.by_hand = bool(item.hand) or (drive.by_hand and not drive.rests)
        self._aim(item, drive)
        drive.speed = seen_speed(item.path, drive.played)
        passed = math.dist(before.t, item.path.at(drive.played).t)
        behind = math.dist(drive.begin.t, drive.end.t)
        drive.end = towards(drive.begin, drive.end, passed + seconds * max(CATCHING_UP, behind / ONE_MOMENT))
        if item.estimate_at(now) is None:
            if not item.hand:
                self._end(item, drive)
        elif item.hand and not drive.rests:
            drive.still_since = None
        elif now - drive.begun > _SHORTEST and self._is_still(item, drive):
            drive.still_since = now if drive.still_since is None else drive.still_since
            apart = self._bodies.pose(item.name).distance(drive.end)[0]
            if apart >= _ARRIVED and now - drive.still_since > STEADY:
                self._free(item, drive)
            if apart < _ARRIVED or now - drive.still_since > STEADY:
                self._end(item, drive)
        else:
            drive.still_since = None

    def _is_out_of_sight(self, item: BelievedObject, drive: Drive, now: float) -> bool:
        """Whether an object on its way is not seen any more, and nobody has lifted it, who may hold it in the air."""
        late = item.track.late
        if now - item.track.last_stamp <= (PRESENT + late if late > 0.0 else ONE_MOMENT):
            return False
        was_raised = not drive.rests and item.path.last.t[2] > drive.origin.t[2] + self._config.hover_tolerance
        return drive.runs or (any(item.path.velocity) and (item.falls or not was_raised))

    def _let_run(self, item: BelievedObject, drive: Drive, now: float) -> None:
        """Leave the body to physics, as fast as it was seen to move last; for good, once it is unseen."""
        if not drive.runs:
            velocity = item.path.velocity
            rotation, spin = rolling(self._bodies.solid(item.name), velocity, free=not item.shows_rotation)
            self._bodies.put(item, self._bodies.sim.position(item.name), rotation)
            self._bodies.sim.set_velocity(item.name, velocity, spin if drive.rests else STILL)
            drive.runs, drive.supports = True, None
        if item.estimate_at(now) is None:
            del self._drives[item.name]
            item.leave_to_physics()

    def _is_still(self, item: BelievedObject, drive: Drive) -> bool:
        was_played = drive.played >= item.path.newest - AT_REST
        return was_played and item.path.is_still(AT_REST, ASTRAY, self._config.surprise_angle)

    def _aim(self, item: BelievedObject, drive: Drive) -> None:
        """Where the body should be at the end of this step: where it was seen, as far as other bodies allow."""
        pose = item.path.at(drive.played)
        above = self._bodies.above(item, pose.t)
        scene = self._bodies.scene(leaving_out={item.name, *above, *self._supported.supported([item.name])})
        covariance = UNSEEN_COVARIANCE if item.track.estimate is None else item.percept_covariance(self._config)
        config = self._config
        reach = min(SAME_PLACE if is_lifted(item, drive) else self._by_noise(item, SURE_SIGMAS), config.hover_tolerance)
        seen, others = item.solid(pose.t, pose.q), list(scene.values())
        placement = place(seen, covariance, others, config, reach)
        firm = self._stand_firm(seen, others)
        if placement.rests and not item.shows_stance and self._is_turned(item, seen, firm, reach):
            there = PerceivedBody(seen, covariance, item.turning_of_one())
            seen = seen.turned(likeliest_stance(there, firm, config))
            placement = place(seen, covariance, others, config, reach)
        if not (placement.rests or item.shows_tilt):  # its hand says how it leans
            as_before = place(item.solid(pose.t, drive.begin.q), covariance, others, config, reach)
            fallen = place(seen.face_down()[0], covariance, others, config, reach)
            is_upright = as_before.solid.face_down()[1] < self._config.tilt_tolerance
            stands = [as_before] * is_upright + [fallen] * fallen.rests
            placement = stands_or_leans(seen, placement, stands)
        drive.end, drive.supports = placement.solid.pose, placement.supports
        item.hovering_since = None if drive.rests else (item.hovering_since or self._now)

    def _stand_firm(self, seen: Solid, others: Sequence[Solid]) -> list[Solid]:
        """The others, but no objects beside a driven one, which pushes these: they do not tell how it is turned."""
        beside_it = {other.name for other in near(seen, others) if are_side_by_side(seen, other)}
        return [other for other in others if other.name not in beside_it & self._bodies.objects.keys()]

    def _is_turned(self, item: BelievedObject, seen: Solid, others: Sequence[Solid], reach: float) -> bool:
        """Whether an object is seen where it cannot be, turned as it is believed to be, nor be pushed aside to."""
        if item.track.estimate is None:
            return False
        covariance = item.percept_covariance(self._config)
        free = beside(place(seen, covariance, others, self._config, reach).solid, others)
        return misfit(free, seen, covariance, item.turning()) > nats.SURPRISING

    def _end(self, item: BelievedObject, drive: Drive) -> None:
        """Leave the body to perception again; or, if that has lost it, to physics, or to what holds it unseen."""
        for load in self._supported.standing(self._drives.keys()).get(item.name, ()):
            self._supported.take_along(load, self._bodies.pose(item.name), drive.velocity, HALTED)
        del self._drives[item.name]
        item.put, item.placement, item.strikes = self._bodies.pose(item.name), None, 0
        item.track.begin_anew(item.path.newest - (PRESENT if drive.still_since is None else AT_REST))
        item.notice_restart()
        item.is_told_to_rest = True
        self._bodies.sim.set_velocity(item.name, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        is_unseen = item.vanished_when_let_go or not item.track.is_fresh(self._now)
        is_let_go = drive.by_hand and not item.hand and is_unseen
        if not drive.rests and not is_let_go and item.name not in self._supported.supported(self._drives):
            self._bodies.set_static(item, True)

    def _free(self, item: BelievedObject, drive: Drive) -> None:
        """Put a body that cannot get to where it rests in view there: it got stuck on a way that it did not take."""
        if drive.rests and not self._supported.supported([item.name]):
            others = list(self._bodies.scene(leaving_out={item.name}).values())
            solid = beside(item.solid(drive.end.t, drive.end.q), others)
            self._bodies.put(item, solid.position, solid.rotation)

    def _is_lost(self, item: BelievedObject, now: float) -> bool:
        """Whether an object is seen far from where its container should have taken it."""
        is_seen = now - item.track.last_stamp <= ONE_MOMENT and item.estimate_at(now) is not None
        if not is_seen or item.name not in self._bodies.sim:
            return False
        return math.dist(item.percept().position, self._bodies.sim.position(item.name)) > ELSEWHERE
