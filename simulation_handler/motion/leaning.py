"""Lets bodies lean: against what they are beside, as far as a short simulation leaves them where they are perceived."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from dsr.math3d import quaternions
from dsr.math3d.quaternions import Quaternion, Vector3
from dsr.perception.scales import SLOW
from dsr.vocabulary import nats
from simulation_handler.config import BeliefConfig
from simulation_handler.contact.depenetration import depenetrated
from simulation_handler.contact.perceived import PerceivedBody
from simulation_handler.contact.placement import Placement, covariance_given_height, given_height, near
from simulation_handler.contact.stances import beside
from simulation_handler.explaining.piles import BREADTH
from simulation_handler.perception.percepts import Array
from simulation_handler.physics.rollouts.engine import Engine
from simulation_handler.physics.rollouts.scene import RolloutBody, RolloutScene
from simulation_handler.scales import ANGLES, PLACE_FLOOR, even_spread
from simulation_handler.shapes.geometry import Solid
from simulation_handler.state.bodies import Bodies
from simulation_handler.state.objects import BelievedObject

_UP: Array = np.array((0.0, 0.0, 1.0))


class Lean(NamedTuple):
    """One way in which a body may lean."""

    solid: Solid
    """The body there"""
    supports: tuple[str, ...]
    """Names of what carries it then, sorted"""
    is_steady: bool = False
    """Whether a simulation leaves it there"""


class Judged(NamedTuple):
    """How a body rests, by what is perceived."""

    leaning: Placement | None
    """How it leans; None if it stands, or lies"""
    aslant: float = 0.0
    """Probability that it leans, known how or not"""


class _Found(NamedTuple):
    """What was found the last time, and for what."""

    flat: Placement
    around: Mapping[str, Solid]
    leans: tuple[Lean, ...]


class Leaning:
    """Finds how an object leans on a neighbour, if that explains its percepts better than that it stands by itself.

    If percepts tell how it is turned, that is where a simulation begins. If they do not, it begins where the object
    has tipped so far, about where it is perceived, that it touches a neighbour. Where the simulation leaves it weighs.
    """

    def __init__(self, bodies: Bodies, config: BeliefConfig) -> None:
        self._bodies = bodies
        self._config = config
        self._engine: Engine | None = None
        self._found: dict[str, _Found] = {}

    def close(self) -> None:
        """Free the simulation; harmless when repeated."""
        if self._engine is not None:
            self._engine.close()

    def judge(
        self, item: BelievedObject, seen: PerceivedBody, flat: Placement, around: Mapping[str, Solid],
        scene: Mapping[str, Solid],
    ) -> Judged:  # fmt: skip
        """Whether and how an object leans.

        Args:
            item: the object.
            seen: where it is perceived, by what other objects tell of systematic errors.
            flat: how it would rest with a face down.
            around: the solids that are its `neighbours`.
            scene: all other solids.

        What is believed to lean does so while standing explains what is perceived only as well. Where only a lean
        that no simulation tells is likelier than standing, it leans in the way that fits best, steady or not.
        """
        is_held = not flat.rests  # by something unknown, unless it leans
        is_upright = seen.solid.face_down()[1] <= self._config.tilt_tolerance
        if seen.solid.kind == "sphere" or (is_held and is_upright):
            return Judged(None)
        is_flat = item.placement is None or self._is_flat(item.placement.solid)
        there = beside(flat.solid, list(around.values()))
        if is_flat and seen.misfit(there) + is_held * nats.HELD <= nats.AS_GOOD:
            return Judged(None)
        standing = seen.cost(there) + is_held * nats.HELD
        leans = self._leans(item, seen, flat, around, scene)
        ways = [(seen.cost(lean.solid, PLACE_FLOOR) + nats.LEANS, lean) for lean in leans]
        ways.sort(key=lambda way: way[0])
        steady = [way for way in ways if way[1].is_steady]
        unknown = math.inf if item.shows_stance else seen.cost(seen.solid, _heights(seen.solid)) + nats.LEANS
        least = min([unknown, *(cost for cost, _ in steady)])
        aslant = 1.0 / (1.0 + math.exp(min(least - standing, nats.MOST_MISFIT)))
        likelier = standing + (0.0 if is_flat else nats.AS_GOOD)
        lean = next((lean for cost, lean in steady if cost < likelier), None)
        if lean is None and ways and unknown < likelier:  # some friction or contact is not as simulated
            lean = ways[0][1]
        if lean is None:
            return Judged(None, aslant)
        covariance = covariance_given_height(seen.covariance, PLACE_FLOOR)
        return Judged(Placement(lean.solid, lean.supports, covariance, is_held=not lean.is_steady), aslant)

    def _leans(
        self, item: BelievedObject, seen: PerceivedBody, flat: Placement, around: Mapping[str, Solid],
        scene: Mapping[str, Solid],
    ) -> tuple[Lean, ...]:  # fmt: skip
        """The ways in which an object may lean; they are worked out anew when something has changed."""
        known = self._found.get(item.name)
        if known is None or not self._holds(known, flat, around):
            told = [Lean(seen.solid, ())] if item.shows_stance else self._tipped(item, seen, flat, around.values())
            starts = [*self._as_before(item), *told]
            leans = [self._settled(item, start.solid, scene) or start for start in starts]
            known = self._found[item.name] = _Found(flat, around, tuple(lean for lean in leans if lean.supports))
        return known.leans

    def _holds(self, known: _Found, flat: Placement, around: Mapping[str, Solid]) -> bool:
        """Whether what was found before was found for the same."""
        near = self._config.divergence
        return (
            known.flat.supports == flat.supports
            and known.around.keys() == around.keys()
            and math.dist(known.flat.solid.position, flat.solid.position) < near
            and all(math.dist(other.position, around[name].position) < near for name, other in known.around.items())
        )

    def _as_before(self, item: BelievedObject) -> list[Lean]:
        """How the body leans in the simulation, if it does."""
        if item.placement is None or item.name not in self._bodies.sim:
            return []
        body = self._bodies.solid(item.name)
        return [] if self._is_flat(body) else [Lean(body, item.placement.supports)]

    def _is_flat(self, solid: Solid) -> bool:
        return solid.face_down()[1] <= self._config.divergence_angle

    def _tipped(
        self, item: BelievedObject, seen: PerceivedBody, flat: Placement, around: Collection[Solid]
    ) -> list[Lean]:
        """The tilts with which the body touches a neighbour about where it is perceived; those that fit best."""
        found = [
            Lean(solid, tuple(sorted({other.name, *flat.supports})))
            for other in around
            for way in _ways_to(other, flat.solid)
            for rotation in _facing(flat.solid, way, turns=not item.shows_rotation)
            for solid in _touching(seen, rotation, way, flat.solid.bottom, other)
            if not self._is_flat(solid)
        ]
        return sorted(found, key=lambda lean: seen.cost(lean.solid, PLACE_FLOOR))[:BREADTH]

    def _settled(self, item: BelievedObject, start: Solid, scene: Mapping[str, Solid]) -> Lean | None:
        """How an object leans a short time after it was put there, and on what; None if it does not, or moves."""
        clear = depenetrated(start, [other for other in scene.values() if other.fixed], _UP)
        objects = self._bodies.objects
        others = [
            RolloutBody(
                name, other.size, other.position, other.rotation, fixed=True, shape=other.shape,
                friction=objects[name].friction if name in objects else self._bodies.friction_of(name),
            )
            for name, other in scene.items()
        ]  # fmt: skip
        body = RolloutBody(
            item.name, item.size, clear.position, clear.rotation, item.mass, item.friction, False, item.shape,
            item.rolling_friction,
        )  # fmt: skip
        self._engine = self._engine or Engine()
        outcome = self._engine.run(RolloutScene((*others, body)), self._config.rollout_seconds)
        solid = start.at(*outcome.poses[item.name])
        if self._is_flat(solid) or outcome.speeds[item.name][0] > SLOW:
            return None
        pairs = [{contact.upper, contact.lower} for contact in outcome.contacts]
        supports = {name for pair in pairs if item.name in pair for name in pair - {item.name}}
        return Lean(solid, tuple(sorted(supports)), is_steady=True) if supports else None


def _heights(solid: Solid) -> float:
    """M, standard deviation of how high the middle of a body is that leans: all heights that it may have are alike."""
    return even_spread(solid.radius - 0.5 * min(solid.size))


def neighbours(flat: Placement, scene: Mapping[str, Solid]) -> dict[str, Solid]:
    """The solids of a scene that may stop a body that tips over: they are near, and carry it not."""
    (x, y, _), radius, bottom = flat.solid.position, flat.solid.radius, flat.solid.bottom
    return {
        other.name: other
        for other in near(flat.solid, scene.values())
        if math.hypot(other.position[0] - x, other.position[1] - y) < other.radius + radius
        if other.top > bottom and other.name not in flat.supports
    }


def _ways_to(other: Solid, solid: Solid) -> Iterator[Vector3]:
    """Horizontal unit vectors from a body to a neighbour: to its middle, and straight to the side that is nearest."""
    x, y = (there - here for there, here in zip(other.position[:2], solid.position[:2], strict=True))
    distance = math.hypot(x, y)
    if distance > PLACE_FLOOR:
        yield (x / distance, y / distance, 0.0)
        if other.kind == "box":
            a, b, _ = max(other.level_sides(), key=lambda side: side[0] * x + side[1] * y)
            length = math.hypot(a, b)
            yield (a / length, b / length, 0.0)


def _facing(flat: Solid, way: Vector3, *, turns: bool) -> Iterator[Quaternion]:
    """Rotations that put a face down; with `turns`, turned about the vertical so that a side is across the way."""
    for rotation in flat.stances() if turns else [flat.rotation]:
        for x, y, _ in flat.turned(rotation).level_sides()[::2]:
            angle = math.atan2(way[1], way[0]) - math.atan2(y, x)
            angle -= math.pi * round(angle / math.pi)  # both sides are alike
            yield quaternions.product(quaternions.from_rotvec((0.0, 0.0, angle)), rotation) if turns else rotation


def _touching(seen: PerceivedBody, rotation: Quaternion, way: Vector3, level: float, other: Solid) -> Iterator[Solid]:
    """The body tipped towards a neighbour, and away from it, so far that it just touches that."""
    away = np.array((-way[0], -way[1], 0.0))

    def tipped(angle: float) -> Solid:
        return _on_level(seen, _tip(rotation, way, angle), level)

    def is_free(angle: float) -> bool:
        solid = tipped(angle)
        return depenetrated(solid, [other], away) is solid

    for sign in (1.0, -1.0):
        angles = [sign * 0.5 * math.pi * k / ANGLES for k in range(ANGLES + 1)]
        are_free = [is_free(angle) for angle in angles]
        for (one, two), (is_first_free, is_next_free) in zip(pairwise(angles), pairwise(are_free), strict=True):
            if is_first_free == is_next_free:
                continue
            free, stopped = (one, two) if is_first_free else (two, one)
            for _ in range(ANGLES):  # halvings, to 1 mrad
                middle = 0.5 * (free + stopped)
                free, stopped = (middle, stopped) if is_free(middle) else (free, middle)
            yield tipped(free)


def _tip(rotation: Quaternion, side: Vector3, angle: float) -> Quaternion:
    """A rotation tipped over a horizontal `side` (unit vector in the world)."""
    turn = quaternions.from_rotvec((-side[1] * angle, side[0] * angle, 0.0))
    return quaternions.product(turn, rotation)


def _on_level(seen: PerceivedBody, rotation: Quaternion, level: float) -> Solid:
    """The body turned so, with its lowest point at the height `level` (m), where it is perceived else."""
    turned = seen.solid.turned(rotation)
    return turned.moved(given_height(turned.position, seen.covariance, level + turned.half_height))
