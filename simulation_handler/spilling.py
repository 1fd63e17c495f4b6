"""What falls unseen out of a container: of the ways in which it may fall, the one that ends in the middle of them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import cache

import numpy as np
from scipy.stats import norm, qmc

from dsr.quaternions import Vector3
from simulation_handler.bodies import Bodies
from simulation_handler.geometry import Solid
from simulation_handler.hands import UNSEEN
from simulation_handler.percepts import Array
from simulation_handler.relations import Relation
from simulation_handler.rollouts.engine import Engine
from simulation_handler.rollouts.scene import Body, Scene
from simulation_handler.surfaces import outwards

_WAYS = 20
_TRIES = 60  # of which those are no ways that are in other bodies
_METRES = 0.01  # standard deviation of where along each axis it is, of what nobody sees roll in what is poured
_SPEED = 0.1  # m/s, likewise of how fast
_SECONDS = 1.5  # after which it lies
_DEEPEST = 0.002  # m that its middle part may be in other bodies


class Spilling:
    """Lets what leaves a container unseen fall in a typical way.

    On which side of a rim it falls depends on millimetres that nobody knows. Of many ways in which physics lets it
    fall from where it last was inside, its body takes the one with the least mean square error: that ends nearest to
    the mean of all ends.
    """

    def __init__(self, bodies: Bodies) -> None:
        self._bodies = bodies
        self._engine: Engine | None = None
        self._before: dict[str, Body] = {}  # what was inside in the last step, as it moved then

    def close(self) -> None:
        """Free the simulation; harmless when repeated."""
        if self._engine is not None:
            self._engine.close()

    def update(self, inside: Iterable[Relation], left: Iterable[Relation], now: float) -> None:
        """Take in what is in a container at time `now` (s), and what has just left one: (object, container)."""
        for name, _ in sorted(relation for relation in left if self._may_spill(relation, now)):
            if name in self._before:
                self._let_fall(self._before[name])
        spilling = sorted(relation for relation in inside if self._may_spill(relation, now))
        scene = self._bodies.frozen() if spilling else None
        self._before = {} if scene is None else {name: self._moving(scene[name]) for name, _ in spilling}

    def _may_spill(self, relation: Relation, now: float) -> bool:
        """Whether an object moves unseen, by physics alone, in a container that is moved."""
        name, container = relation
        return self._bodies.objects[container].driven and self._is_unknown(name, now)

    def _is_unknown(self, name: str, now: float) -> bool:
        """Whether an object moves unseen, by physics alone."""
        item = self._bodies.objects[name]
        is_held = item.holder or item.hand or item.driven or item.pinned
        return not is_held and now - item.track.last_stamp > UNSEEN

    def _moving(self, body: Body) -> Body:
        velocity, spin = self._bodies.sim.velocity(body.name)
        return body._replace(velocity=velocity, spin=spin)

    def _let_fall(self, body: Body) -> None:
        sim = self._bodies.sim
        driven = [item.name for item in self._bodies.objects.values() if item.driven and item.name in sim]
        scene = self._bodies.frozen().held(driven)
        ways = self._ways(scene, body)
        if not ways:
            return
        self._engine = self._engine or Engine()
        ends = np.array([self._engine.run(_with(scene, way), _SECONDS).poses[body.name][0] for way in ways])
        way = ways[int(np.argmin(np.linalg.norm(ends - ends.mean(axis=0), axis=1)))]
        sim.place(way.name, way.position, way.rotation, way.velocity, way.spin)

    def _ways(self, scene: Scene, body: Body) -> list[Body]:
        """How the body may be on its way, without being in others."""
        solids = [other.solid for other in scene.bodies if other.name != body.name]
        reach = 0.5 * min(body.size) - _DEEPEST
        ways: list[Body] = []
        for shift, push in zip(_METRES * _normal()[:, :3], _SPEED * _normal()[:, 3:], strict=True):
            if len(ways) == _WAYS:
                break
            x, y, z = np.add(body.position, shift).tolist()
            a, b, c = np.add(body.velocity, push).tolist()
            if all(_distance(solid, (x, y, z), reach) >= reach for solid in solids):
                ways.append(body._replace(position=(x, y, z), velocity=(a, b, c)))
        return ways


@cache
def _normal() -> Array:
    """(_TRIES, 6) evenly spread samples of a normal distribution: a Halton sequence."""
    sequence = qmc.Halton(6, scramble=False)
    sequence.fast_forward(1)
    samples: Array = norm.ppf(sequence.random(_TRIES))
    return samples


def _distance(solid: Solid, point: Vector3, reach: float) -> float:
    """How far (m) a point is from the surface of a solid, if that may be less than `reach`."""
    return math.inf if math.dist(solid.position, point) > solid.radius + reach else outwards(solid, point)[0]


def _with(scene: Scene, body: Body) -> Scene:
    return Scene(tuple(body if other.name == body.name else other for other in scene.bodies))
