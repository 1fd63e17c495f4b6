"""Lets bodies lean: against what they are beside, as far as a short simulation leaves them where they are perceived."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from dsr.math3d import quaternions
from dsr.math3d.quaternions import Quaternion, Vector3
from dsr.vocabulary import nats
from simulation_handler.config import BeliefConfig
from simulation_handler.contact.depenetration import depenetrated
from simulation_handler.contact.placement import Placement, covariance_given_height, given_height
from simulation_handler.contact.stances import misfit
from simulation_handler.perception.percepts import Array
from simulation_handler.physics.rollouts.engine import Engine
from simulation_handler.physics.rollouts.scene import RolloutBody, RolloutScene
from simulation_handler.scales import SLOW
from simulation_handler.shapes.geometry import Solid
from simulation_handler.state.bodies import Bodies
from simulation_handler.state.objects import BelievedObject

_TIPS = 8  # count of tilts up to lying at which a neighbour may be met, and of halvings between two of them, to 1 mrad
_UP: Array = np.array((0.0, 0.0, 1.0))


class _Found(NamedTuple):
    """What was found the last time, and for what."""

    flat: Placement
    around: Mapping[str, Solid]
    leans: tuple[tuple[Solid, tuple[str, ...]], ...]
    """How it may lean, and what carries it then"""


class Leaning:
    """Finds how an object leans on a neighbour, if that explains its percepts better than that it stands by itself.

    If percepts tell how it is turned, that is where a simulation begins. If they do not, it begins where the object
    has tipped so far, about where it is perceived, that a neighbour stops it. Where the simulation leaves it weighs.
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

    def find(
        self, item: BelievedObject, percept: Solid, covariance: Array, flat: Placement, scene: Mapping[str, Solid]
    ) -> Placement | None:
        """How an object leans; None if it stands, or lies, as `flat` has it.

        Args:
            item: the object.
            percept: where it is perceived.
            covariance: (3, 3) m^2 of that position.
            flat: how it would rest with a face down.
            scene: all other solids.

        What is believed stays so while the other explains what is perceived only as well.
        """
        around = {name: other for name, other in scene.items() if _is_beside(other, flat)}
        is_held = not flat.rests  # by something unknown, unless it leans
        is_upright = percept.face_down()[1] <= self._config.tilt_tolerance
        if not around or percept.kind == "sphere" or (is_held and is_upright):
            return None
        known = self._found.get(item.name)
        if known is None or not self._holds(known, flat, around):
            starts = [percept] if item.shows_stance else _tipped(percept, covariance, flat, list(around.values()))
            leans = [lean for start in starts if (lean := self._settled(item, start, scene)) is not None]
            known = self._found[item.name] = _Found(flat, around, tuple(leans))
        turning = item.turning()
        as_believed = -nats.AS_GOOD if item.placement is None or self._is_flat(item.placement.solid) else nats.AS_GOOD
        least, best = misfit(flat.solid, percept, covariance, turning) + as_believed + is_held * nats.HELD, None
        for solid, supports in known.leans:
            cost = misfit(solid, percept, covariance, turning)
            if cost < least:
                least, best = cost, Placement(solid, supports, covariance_given_height(covariance))
        return best

    def _holds(self, known: _Found, flat: Placement, around: Mapping[str, Solid]) -> bool:
        """Whether what was found before was found for the same."""
        near = self._config.divergence
        return (
            known.flat.supports == flat.supports
            and known.around.keys() == around.keys()
            and math.dist(known.flat.solid.position, flat.solid.position) < near
            and all(math.dist(other.position, around[name].position) < near for name, other in known.around.items())
        )

    def _is_flat(self, solid: Solid) -> bool:
        return solid.face_down()[1] <= self._config.divergence_angle

    def _settled(
        self, item: BelievedObject, start: Solid, scene: Mapping[str, Solid]
    ) -> tuple[Solid, tuple[str, ...]] | None:
        """How an object leans a short time after it was put there, and on what; None if it does not, or moves."""
        clear = depenetrated(start, [other for other in scene.values() if other.fixed], _UP)
        friction = self._config.default_friction
        objects = self._bodies.objects
        others = [
            RolloutBody(
                name, other.size, other.position, other.rotation, fixed=True, shape=other.shape,
                friction=objects[name].friction if name in objects else friction,
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
        return (solid, tuple(sorted(supports))) if supports else None


def _is_beside(other: Solid, flat: Placement) -> bool:
    """Whether something may stop a body that tips over: it is near, and carries it not."""
    solid = flat.solid
    reach = other.radius + solid.radius
    return (
        other.name not in flat.supports
        and other.top > solid.bottom
        and math.dist(other.position[:2], solid.position[:2]) < reach
    )  # fmt: skip


def _tipped(percept: Solid, covariance: Array, flat: Placement, around: Sequence[Solid]) -> Iterator[Solid]:
    """The body tipped over each of its sides about where it is perceived, until a neighbour stops it."""
    level = flat.solid.bottom
    for side in flat.solid.level_sides():
        away = np.array((-side[0], -side[1], 0.0))

        def tipped(angle: float, side: Vector3 = side) -> Solid:
            return _on_level(percept, covariance, _tip(flat.solid.rotation, side, angle), level)

        def is_stopped(solid: Solid, away: Array = away) -> bool:
            return depenetrated(solid, around, away) is not solid

        angles = [0.5 * math.pi * k / _TIPS for k in range(_TIPS + 1)]
        first = next((k for k, angle in enumerate(angles) if is_stopped(tipped(angle))), 0)
        if first == 0:
            continue
        free, stopped = angles[first - 1], angles[first]
        for _ in range(_TIPS):
            middle = 0.5 * (free + stopped)
            free, stopped = (free, middle) if is_stopped(tipped(middle)) else (middle, stopped)
        yield tipped(free)


def _tip(rotation: Quaternion, side: Vector3, angle: float) -> Quaternion:
    """A rotation tipped over a horizontal `side` (unit vector in the world)."""
    turn = quaternions.from_rotvec((-side[1] * angle, side[0] * angle, 0.0))
    return quaternions.product(turn, rotation)


def _on_level(percept: Solid, covariance: Array, rotation: Quaternion, level: float) -> Solid:
    """The body turned so, with its lowest point at the height `level` (m), where it is perceived else."""
    turned = percept.turned(rotation)
    return turned.moved(given_height(percept.position, covariance, level + turned.half_height))
