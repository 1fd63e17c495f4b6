"""In which of its stable poses a body rests, if percepts do not tell how it is turned: their height tells."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from dsr.math3d import quaternions
from dsr.math3d.quaternions import Quaternion, Vector3
from dsr.vocabulary import nats
from simulation_handler.config import BeliefConfig
from simulation_handler.contact.perceived import PerceivedBody
from simulation_handler.contact.placement import place, separate
from simulation_handler.perception.percepts import Array
from simulation_handler.scales import ANGLES, PLACE_FLOOR
from simulation_handler.shapes.geometry import Solid


class Stance(NamedTuple):
    """One way in which a body may rest where it is perceived."""

    cost: float
    """nats, up to a constant: minus the logarithm of how probable the percept is then"""
    solid: Solid
    """The body there"""


class OtherStance(NamedTuple):
    """How a body may rest instead of in its likeliest way."""

    probability: float
    """1"""
    turn: Quaternion
    """Rotation in the frame of the body, from the likeliest way to this one"""
    shift: Vector3
    """(3,) m in the world frame, from the likeliest place to this one: another side down is another height"""


def stances(seen: PerceivedBody, others: Sequence[Solid], config: BeliefConfig) -> list[Stance]:
    """The ways in which a body may rest where it is perceived, one for each face that may be down; likeliest first.

    How it is believed to rest comes first while no other way is better by `nats.AS_GOOD`. None where nothing can carry
    any of them. Turned about the vertical, for nobody sees that, where its neighbours would else push it aside.

    Args:
        seen: the body as it is perceived, turned as it is believed to be.
        others: all other solids.
        config: tolerances.
    """
    percept, covariance = seen.solid, seen.covariance

    def weighed(rotation: Quaternion) -> Stance:
        solid = place(percept.turned(rotation), covariance, others, config).solid
        return Stance(seen.cost(beside(solid, others)), solid)

    def ways(rotation: Quaternion) -> Iterator[Stance]:
        first = weighed(rotation)
        yield first
        if beside(first.solid, others) is not first.solid:
            turned = map(weighed, _turned(first.solid.rotation))
            yield from (one._replace(cost=one.cost + nats.AS_GOOD) for one in turned)

    rotations = [q for q in percept.stances() if place(percept.turned(q), covariance, others, config).rests]
    found = [min(ways(rotation), key=lambda stance: stance.cost) for rotation in rotations]
    turned = [abs(sum(a * b for a, b in zip(rotation, percept.rotation, strict=True))) for rotation in rotations]
    as_before = found[turned.index(max(turned))] if found else None
    return sorted(found, key=lambda stance: stance.cost - nats.AS_GOOD * (stance is as_before))


def likeliest_stance(seen: PerceivedBody, others: Sequence[Solid], config: BeliefConfig) -> Quaternion:
    """The rotation of the likeliest of `stances`; that of the percept where there is none."""
    found = stances(seen, others, config)
    return found[0].solid.rotation if found else seen.solid.rotation


def is_sure(found: Sequence[Stance], config: BeliefConfig) -> bool:
    """Whether no stance at another height is about as likely as the first one, or likelier."""
    return all(
        stance.cost - found[0].cost > nats.AS_GOOD
        for stance in found
        if abs(stance.solid.position[2] - found[0].solid.position[2]) > config.divergence
    )


def probabilities(found: Sequence[Stance]) -> list[float]:
    """How probable each stance is among these, if people put the thing on any of its faces as often."""
    likelihoods = [math.exp(found[0].cost - stance.cost) for stance in found]
    total = sum(likelihoods)
    return [likelihood / total for likelihood in likelihoods]


def other_stances(found: Sequence[Stance]) -> tuple[OtherStance, ...]:
    """All but the first of some ways to rest."""
    if not found:
        return ()
    (_, first), *others = found
    back, (x, y, z), chances = quaternions.conjugate(first.rotation), first.position, probabilities(found)[1:]
    return tuple(
        OtherStance(chance, quaternions.product(back, solid.rotation), (right - x, ahead - y, top - z))
        for chance, (_, solid) in zip(chances, others, strict=True)
        for right, ahead, top in [solid.position]
    )


def beside(solid: Solid, others: Sequence[Solid]) -> Solid:
    """The solid, out of the way of those beside it; the same one if it is in nobody's way."""
    near = [other for other in others if math.dist(other.position, solid.position) < other.radius + solid.radius]
    pushed = separate([solid, *near], {solid.name: 1.0}) if near else {}
    return solid.moved(pushed[solid.name]) if pushed else solid


def _turned(rotation: Quaternion) -> Iterator[Quaternion]:
    """The rotation, turned about the vertical by up to half a turn."""
    for k in range(1, ANGLES):
        yield quaternions.product(quaternions.from_rotvec((0.0, 0.0, math.pi * k / ANGLES)), rotation)


def misfit(solid: Solid, percept: Solid, covariance: Array, turning: Array) -> float:
    """Half the squared Mahalanobis distance of a pose from a percept, in nats.

    Args:
        solid: the body there.
        percept: the same body as it is perceived.
        covariance: (3, 3) m^2 of its perceived position.
        turning: (3, 3) rad^2 of its perceived rotation.
    """
    shift = np.subtract(solid.position, percept.position)
    between = quaternions.product(solid.rotation, quaternions.conjugate(percept.rotation))
    turn = np.array(quaternions.to_rotvec(between))
    spread = covariance + PLACE_FLOOR**2 * np.eye(3)
    return 0.5 * float(shift @ np.linalg.solve(spread, shift) + turn @ np.linalg.solve(turning, turn))
