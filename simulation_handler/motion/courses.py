"""Many simulated courses of what went out of sight on its way: nobody knows exactly how fast it was."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations

from dsr.math3d.transforms import Pose
from dsr.perception.scales import SAME_PLACE
from simulation_handler.config import BeliefConfig
from simulation_handler.contact.depenetration import depenetrated
from simulation_handler.contact.relations import SupportedPose, resting
from simulation_handler.explaining.glimpses import DRAW_COUNT
from simulation_handler.hands.state import UNSEEN
from simulation_handler.motion.movers import coasts
from simulation_handler.motion.rolling import rolling
from simulation_handler.motion.setting_out import SettingOut, starts_of
from simulation_handler.physics.rollouts.scene import RolloutBody
from simulation_handler.physics.simulator import MOST_STEPS, SLEEP_SPEED, TIME_STEP, Simulator
from simulation_handler.state.bodies import FLOOR, Bodies
from simulation_handler.state.objects import BelievedObject


class Courses:
    """Simulates how what vanished on its way may have gone on.

    The courses of an object go through each other, and meet all other bodies where these are believed to be.
    """

    def __init__(self, bodies: Bodies, config: BeliefConfig) -> None:
        self._bodies = bodies
        self._config = config
        self._running: dict[str, _Simulated] = {}
        self._waiting: dict[str, tuple[float, float]] = {}
        """Objects whose courses are to begin: s, when each was seen last, and time (s) that was lost since."""
        self._idle: list[Simulator] = []
        self._now = -math.inf

    def close(self) -> None:
        """Free the simulations; harmless when repeated."""
        for sim in (*self._idle, *(one.sim for one in self._running.values())):
            sim.close()

    def update(self, now: float) -> None:
        """Begin and end courses, and bring them to time `now` (s)."""
        objects, before, self._now = self._bodies.objects, self._now, now
        for name, one in list(self._running.items()):
            item = objects.get(name)
            if item is None or item.track.last_stamp != one.since or item.hand or item.holder:
                one.clear()
                self._idle.append(self._running.pop(name).sim)
        self._note_waiting(before, now)
        new = self._begin_next()
        moving = {name: one for name, one in self._running.items() if not one.rests}
        if moving:
            bodies = self._bodies.frozen().bodies
            for name, one in moving.items():
                one.advance([body for body in bodies if body.name != name], now)
        if new is not None:
            self._follow(new, self._running[new.name].typical())

    def _note_waiting(self, before: float, now: float) -> None:
        """Note what has just vanished on its way, and the time that all lose if the last update is long ago."""
        lost = max(0.0, now - before - MOST_STEPS * TIME_STEP)  # as for all bodies
        for one in self._running.values():
            one.lose(lost)
        self._waiting = {name: (since, so_far + lost) for name, (since, so_far) in self._waiting.items()}
        for name, item in self._bodies.objects.items():
            since = item.track.last_stamp
            if before - since <= UNSEEN < now - since and _is_on_its_way(item):
                gap = now - max(before, since + UNSEEN)
                self._waiting[name] = since, max(0.0, gap - MOST_STEPS * TIME_STEP)

    def _begin_next(self) -> BelievedObject | None:
        """Begin the courses of one object, for to begin takes about as long as a tick; return the object."""
        while self._waiting:
            name, (since, lost) = next(iter(self._waiting.items()))
            del self._waiting[name]
            item = self._bodies.objects.get(name)
            if item is not None and item.track.last_stamp == since:
                sim = self._idle.pop() if self._idle else Simulator(most_parts=1)
                one = _Simulated(sim, item, [self._begin(item, start) for start in _starts(item)])
                one.lose(lost)
                self._running[name] = one
                return item
        return None

    def of(self, name: str) -> tuple[SupportedPose, ...]:
        """Where an object is by each of its courses, each as probable; none if it did not vanish on its way."""
        one = self._running.get(name)
        return () if one is None else one.whereabouts()

    def _follow(self, item: BelievedObject, typical: RolloutBody) -> None:
        """Let the body of what rolls or falls go on at the typical velocity, unless it does already."""
        if item.driven or item.static or item.name not in self._bodies.sim:
            return
        if len(item.track.way) == 1:  # which tells no velocity: a drawn one is no better than the one believed
            return
        if coasts(item, self._bodies.solid(item.name)):
            item.leave_to_physics()
            self._bodies.put(item, typical.position, typical.rotation)
            self._bodies.sim.set_velocity(item.name, typical.velocity, typical.spin)

    def _begin(self, item: BelievedObject, start: SettingOut) -> RolloutBody:
        """A body that sets out so: at the height of what carries the object; if seen above that, outside of others.

        What percepts have in another body is on the camera's side of that: it is seen.
        """
        ray = item.track.trail[-1].ray
        x, y, z = (start.position - item.error_mean * ray).tolist()
        a, b, c = start.velocity.tolist()
        rotation, as_seen = item.path.last.q, True
        if item.name in self._bodies.sim:
            (_, _, height), rotation = self._bodies.sim.pose(item.name)
            as_seen = abs(z - height) > self._config.hover_tolerance or item.is_in_air
            if not as_seen:
                z, c = height, 0.0
        solid = item.solid((x, y, z), rotation)
        if as_seen:
            solid = depenetrated(solid, self._bodies.scene(leaving_out={item.name}).values(), -ray)
        rotation, spin = rolling(solid, (a, b, c), free=not item.shows_rotation)
        return RolloutBody(
            item.name, item.size, solid.position, rotation, item.mass, item.friction, shape=item.shape,
            rolling_friction=item.rolling_friction, velocity=(a, b, c), spin=spin,
        )  # fmt: skip


class _Simulated:
    """The courses of one object, in a simulation that nothing else is in."""

    def __init__(self, sim: Simulator, item: BelievedObject, starts: Sequence[RolloutBody]) -> None:
        self.sim = sim
        self.since = self._time = item.track.last_stamp
        """s, when it was seen last"""
        self._others: dict[str, RolloutBody] = {}
        self._starts = starts
        self._names = [f"{start.name} {number}" for number, start in enumerate(starts)]
        for name, start in zip(self._names, starts, strict=True):
            _add(sim, name, start, start.mass)
            sim.set_velocity(name, start.velocity, start.spin)
        sim.let_pass(set(combinations(self._names, 2)))

    @property
    def rests(self) -> bool:
        """Whether none of them moves any more."""
        return bool(self._others) and all(max(self.sim.speed(name)) < SLEEP_SPEED for name in self._names)

    def lose(self, seconds: float) -> None:
        """Let time pass in which nothing moves."""
        self._time += seconds

    def advance(self, others: Sequence[RolloutBody], now: float) -> None:
        """Let time pass up to `now` (s) among these other bodies, which nothing moves."""
        for name in self._others.keys() - {body.name for body in others}:
            self.sim.remove(name)
            del self._others[name]
        for body in others:
            before = self._others.get(body.name)
            if before is not None and _is_made_anew(before, body):
                self.sim.remove(body.name)
                before = None
            if before is None:
                _add(self.sim, body.name, body, 0.0)
            elif (before.position, before.rotation) != (body.position, body.rotation):
                self.sim.place(body.name, body.position, body.rotation)
            self._others[body.name] = body
        count = round((now - self._time) / TIME_STEP)
        self.sim.step(count)
        self._time += count * TIME_STEP

    def whereabouts(self) -> tuple[SupportedPose, ...]:
        """Where the object is by each, and on what."""
        pairs = sorted(resting(self.sim.contacts()))
        supports = {
            name: tuple(lower for upper, lower in pairs if upper == name and lower != FLOOR) for name in self._names
        }
        return tuple(SupportedPose(Pose.unchecked(*self.sim.pose(name)), supports[name]) for name in self._names)

    def typical(self) -> RolloutBody:
        """The body on the first course, that of the typical velocity, as it is now."""
        position, rotation = self.sim.pose(self._names[0])
        velocity, spin = self.sim.velocity(self._names[0])
        return self._starts[0]._replace(position=position, rotation=rotation, velocity=velocity, spin=spin)

    def clear(self) -> None:
        """Take all bodies out."""
        for name in self.sim.names:
            self.sim.remove(name)


def _starts(item: BelievedObject) -> list[SettingOut]:
    return starts_of(item.track.way, DRAW_COUNT)


def _is_on_its_way(item: BelievedObject) -> bool:
    """Whether an object moved by itself when seen last, or was seen once, in the air, where it was not before."""
    trail, way = item.track.trail, item.track.way
    if item.hand or item.holder or item.rides or not way:
        return False
    if len(way) > 1:
        return item.driven or item.track.is_restless
    is_new = len(trail) < 2 or math.dist(trail[-2].position, trail[-1].position) > SAME_PLACE
    return item.is_in_air and is_new


def _is_made_anew(before: RolloutBody, now: RolloutBody) -> bool:
    """Whether a body is more than moved: it has another size, shape or friction."""
    return (before.size, before.shape, before.friction) != (now.size, now.shape, now.friction)


def _add(sim: Simulator, name: str, body: RolloutBody, mass: float) -> None:
    sim.add_body(
        name, body.size, body.shape, body.position, body.rotation,
        mass=mass, friction=body.friction, rolling_friction=body.rolling_friction,
    )  # fmt: skip
