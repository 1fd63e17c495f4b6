"""In which of its stable poses a body rests, if percepts do not tell how it is turned: their height tells."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from dsr.math3d import quaternions
from dsr.math3d.quaternions import Quaternion
from dsr.vocabulary import nats
from simulation_handler.config import BeliefConfig
from simulation_handler.contact.placement import place, separate
from simulation_handler.perception.percepts import Array
from simulation_handler.scales import PLACE_FLOOR
from simulation_handler.shapes.geometry import Solid

_YAWS = 8
"""count of directions in half a turn that are tried where a body would be in the way of its neighbours"""


def likeliest_stance(
    percept: Solid, covariance: Array, turning: Array, others: Sequence[Solid], config: BeliefConfig
) -> tuple[Quaternion, bool]:
    """The rotation, of those with a face down, in which a body rests most likely where it is perceived.

    Args:
        percept: the body as it is perceived, turned as it is believed to be.
        covariance: (3, 3) m^2 of its position, with all that is not known of systematic errors.
        turning: (3, 3) rad^2 of its rotation.
        others: all other solids.
        config: tolerances.

    Returns:
        The rotation, and whether none at another height is about as likely. The rotation of `percept`, for sure, where
        nothing can carry any of them. Turned about the vertical, for nobody sees that, where its neighbours would else
        push it aside.

    Each costs half its squared Mahalanobis distance from the percept.
    """

    def weighed(rotation: Quaternion) -> tuple[float, Solid]:
        solid = place(percept.turned(rotation), covariance, others, config).solid
        return misfit(_beside(solid, others), percept, covariance, turning), solid

    def ways(rotation: Quaternion) -> Iterator[tuple[float, Solid]]:
        cost, solid = weighed(rotation)
        yield cost, solid
        if _beside(solid, others) is not solid:
            yield from ((cost + nats.AS_GOOD, turned) for cost, turned in map(weighed, _turned(solid.rotation)))

    rotations = [q for q in percept.stances() if place(percept.turned(q), covariance, others, config).rests]
    if not rotations:
        return percept.rotation, True
    found = [min(ways(rotation), key=lambda entry: entry[0]) for rotation in rotations]
    least, best = min(found, key=lambda entry: entry[0])
    rivals = [cost for cost, other in found if abs(other.position[2] - best.position[2]) > config.divergence]
    return best.rotation, all(cost - least > nats.AS_GOOD for cost in rivals)


def _beside(solid: Solid, others: Sequence[Solid]) -> Solid:
    """The solid, out of the way of those beside it."""
    near = [other for other in others if math.dist(other.position, solid.position) < other.radius + solid.radius]
    pushed = separate([solid, *near], {solid.name: 1.0}) if near else {}
    return solid.moved(pushed[solid.name]) if pushed else solid


def _turned(rotation: Quaternion) -> Iterator[Quaternion]:
    """The rotation, turned about the vertical."""
    for k in range(1, _YAWS):
        yield quaternions.product(quaternions.from_rotvec((0.0, 0.0, math.pi * k / _YAWS)), rotation)


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
