"""Predicts where an object that falls unseen out of a container typically comes to lie, from many possible falls."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from functools import cache
from itertools import count, islice
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from dsr.math3d.quaternions import Vector3
from dsr.perception.scales import SAME_PLACE
from simulation_handler.contact.relations import Relation
from simulation_handler.hands.state import UNSEEN
from simulation_handler.perception.percepts import Array
from simulation_handler.physics.rollouts.engine import Engine
from simulation_handler.physics.rollouts.scene import Placing, RolloutBody, RolloutScene
from simulation_handler.physics.simulator import SLEEP_SPEED
from simulation_handler.scales import PLACE_FLOOR, UNSEEN_SLACK
from simulation_handler.shapes.geometry import Solid
from simulation_handler.state.bodies import Bodies

_WAYS = 32  # count of falls that are simulated: their medoid moves little with more
_TRIES = _WAYS**2  # count of samples, of which those are no ways that are in other bodies: nearly all may be
_SPEED = 0.1  # m/s, standard deviation along each axis of how fast what nobody sees rolls in what is poured
_SECONDS = 1.5  # after which it lies
_MOST = 0.9  # of all ends


class _Fall(NamedTuple):
    """Something that falls, nobody sees where."""

    since: float
    """s"""
    end: Placing
    """Where it typically comes to lie."""
    around: Mapping[str, Vector3]
    """Where other bodies were, m, but for the container that it left."""


class Spilling:
    """Predicts a typical resting place for objects that leave a container unseen.

    On which side of a rim it falls depends on millimetres that nobody knows. Many ways are simulated in which it may
    fall from where it last was inside. Its body falls as it does; when it lies, it is put where the one of them ended
    from which nine tenths of all ends are least far away; not, if it was seen or held since, or things there moved.
    """

    def __init__(self, bodies: Bodies) -> None:
        self._bodies = bodies
        self._engine: Engine | None = None
        self._before: dict[str, RolloutBody] = {}  # what was inside in the last step, as it moved then
        self._falls: dict[str, _Fall] = {}

    def close(self) -> None:
        """Free the simulation; harmless when repeated."""
        if self._engine is not None:
            self._engine.close()

    def update(self, inside: Iterable[Relation], left: Iterable[Relation], now: float) -> None:
        """Take in what is in a container at time `now` (s), and what has just left one: (object, container)."""
        for name, container in sorted(relation for relation in left if self._may_spill(relation, now)):
            if name in self._before and (fall := self._fall(self._before[name], container, now)) is not None:
                self._falls[name] = fall
        self._before = {
            name: self._moving(name) for name, container in inside if self._may_spill((name, container), now)
        }
        for name, fall in list(self._falls.items()):
            if not self._is_unknown(name, now):
                del self._falls[name]
            elif now - fall.since > _SECONDS and self._lies(name):
                del self._falls[name]
                if self._is_as_it_was(fall):
                    self._bodies.sim.place(name, *fall.end)

    def _may_spill(self, relation: Relation, now: float) -> bool:
        """Whether an object moves unseen, by physics alone, in a container that is moved."""
        name, container = relation
        return self._bodies.objects[container].driven and self._is_unknown(name, now)

    def _is_unknown(self, name: str, now: float) -> bool:
        """Whether an object moves unseen, by physics alone."""
        item = self._bodies.objects.get(name)
        if item is None or name not in self._bodies.sim:
            return False
        is_held = item.holder or item.hand or item.driven or item.static
        return not is_held and now - item.track.last_stamp > UNSEEN

    def _lies(self, name: str) -> bool:
        return max(self._bodies.sim.speed(name)) < SLEEP_SPEED

    def _is_as_it_was(self, fall: _Fall) -> bool:
        """Whether nothing was moved since, nor taken away: the object may lie on that, or beside it."""
        sim = self._bodies.sim
        places = fall.around.items()
        return all(name in sim and math.dist(sim.position(name), place) < SAME_PLACE for name, place in places)

    def _moving(self, name: str) -> RolloutBody:
        velocity, spin = self._bodies.sim.velocity(name)
        return self._bodies.body(name)._replace(velocity=velocity, spin=spin)

    def _fall(self, body: RolloutBody, container: str, now: float) -> _Fall | None:
        """How a body that moves so falls out of a container; None if it is stuck in others."""
        objects, sim = self._bodies.objects, self._bodies.sim
        scene = self._bodies.frozen().held([item.name for item in objects.values() if item.driven and item.name in sim])
        falls = self._candidates(scene, body)
        if not falls:
            return None
        self._engine = self._engine or Engine()
        ends = [self._engine.run(_with(scene, fall), _SECONDS).poses[body.name] for fall in falls]
        places = np.array([position for position, _ in ends])
        distances = np.linalg.norm(places[:, None] - places, axis=2)
        medoid = int(np.argmin(np.quantile(distances, _MOST, axis=1)))
        others = (other for other in objects if other in sim and other not in (body.name, container))
        around = {other: sim.position(other) for other in others if self._may_touch(other, body, ends[medoid][0])}
        return _Fall(now, ends[medoid], around)

    def _may_touch(self, other: str, body: RolloutBody, place: Vector3) -> bool:
        """Whether a body at a place is so near another object that they may touch, however both are turned."""
        reach = 0.5 * (math.hypot(*body.size) + math.hypot(*self._bodies.objects[other].size)) + SAME_PLACE
        return math.dist(self._bodies.sim.position(other), place) < reach

    def _candidates(self, scene: RolloutScene, body: RolloutBody) -> list[RolloutBody]:
        """How the body may be on its way, without being in others."""
        solids = [other.solid for other in scene.bodies if other.name != body.name]
        radius = 0.5 * min(body.size)
        reach = radius - PLACE_FLOOR
        spread = np.repeat((UNSEEN_SLACK, _SPEED, _SPEED / radius), 3)  # m, m/s and rad/s, along each axis: it rolls
        falls: list[RolloutBody] = []
        for shift, push, turn in zip(*np.split(_normal(len(spread)) * spread, 3, axis=1), strict=True):
            position, velocity, spin = (
                _sum(body.position, shift), _sum(body.velocity, push), _sum(body.spin, turn)
            )  # fmt: skip
            if all(_distance(solid, position, reach) >= reach for solid in solids):
                falls.append(body._replace(position=position, velocity=velocity, spin=spin))
            if len(falls) == _WAYS:
                break
        return falls


@cache
def _normal(size: int) -> Array:
    """(_TRIES, size) evenly spread samples of a normal distribution: a Halton sequence from its second point on.

    `scipy.stats` has it, too, but takes longer to import than most processes take to start.
    """
    quantile = NormalDist().inv_cdf
    primes = list(islice((n for n in count(2) if all(n % k for k in range(2, n))), size))
    return np.array([[quantile(_mirrored(n, base)) for base in primes] for n in range(1, _TRIES + 1)])


def _mirrored(number: int, base: int) -> float:
    """The digits of `number`, mirrored at the point: van der Corput's sequence."""
    share, result = 1.0, 0.0
    while number:
        number, digit = divmod(number, base)
        share /= base
        result += digit * share
    return result


def _sum(vector: Vector3, change: Array) -> Vector3:
    x, y, z = np.add(vector, change).tolist()
    return x, y, z


def _distance(solid: Solid, point: Vector3, reach: float) -> float:
    """How far (m) a point is from the surface of a solid, if that may be less than `reach`."""
    return math.inf if math.dist(solid.position, point) > solid.radius + reach else solid.signed_distance(point)[0]


def _with(scene: RolloutScene, body: RolloutBody) -> RolloutScene:
    return RolloutScene(tuple(body if other.name == body.name else other for other in scene.bodies))
