"""In which of its stable poses a body rests, if percepts do not tell how it is turned: their height tells."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dsr.math3d import quaternions
from dsr.math3d.quaternions import Quaternion
from dsr.vocabulary import nats
from simulation_handler.config import BeliefConfig
from simulation_handler.contact.placement import place
from simulation_handler.perception.estimate import PLACE_FLOOR
from simulation_handler.perception.percepts import Array
from simulation_handler.shapes.geometry import Solid


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
        nothing can carry any of them.
    """
    found: list[tuple[float, float, Quaternion]] = []
    for rotation in percept.stances():
        placement = place(percept.turned(rotation), covariance, others, config)
        if placement.rests:
            cost = misfit(placement.solid, percept, covariance, turning)
            found.append((cost, placement.solid.position[2], placement.solid.rotation))
    if not found:
        return percept.rotation, True
    least, height, best = min(found, key=lambda entry: entry[0])
    rivals = [cost for cost, other, _ in found if abs(other - height) > config.divergence]
    return best, all(cost - least > nats.AS_GOOD for cost in rivals)


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
