"""Where a body is perceived, and how well a pose explains that."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from dsr.math3d import quaternions
from simulation_handler.perception.percepts import Array
from simulation_handler.scales import PLACE_FLOOR
from simulation_handler.shapes.geometry import Solid


class PerceivedBody(NamedTuple):
    """Where a body is perceived, with all that is not known of systematic errors."""

    solid: Solid
    """The body there, turned as it is perceived, or else as it is believed to be"""
    covariance: Array
    """(3, 3) m^2 of its position"""
    turning: Array
    """(3, 3) rad^2 of its rotation"""
    freedom: float = math.inf
    """1, degrees of freedom of Student's t distribution, by which the position is off; infinite for a Gaussian"""

    def cost(self, solid: Solid, floor: float = 0.0) -> float:
        """Minus the logarithm of how probable the percept is if the body is at `solid`: nats, up to a constant.

        `floor` (m) is the standard deviation of the height of that pose. It is 0 on a level support: how far models are
        off there, systematic errors tell that were learned alike.
        """
        _, logarithm = np.linalg.slogdet(self._spread(floor))
        return 0.5 * float(logarithm) + self.misfit(solid, floor)

    def misfit(self, solid: Solid, floor: float = 0.0) -> float:
        """By how much `cost` is more for `solid` than for the body where it is perceived, nats."""
        shift = np.subtract(solid.position, self.solid.position)
        distance2, freedom = float(shift @ np.linalg.solve(self._spread(floor), shift)), self.freedom
        tail = distance2 if math.isinf(freedom) else (freedom + 1.0) * math.log1p(distance2 / freedom)
        between = quaternions.product(solid.rotation, quaternions.conjugate(self.solid.rotation))
        turn = np.array(quaternions.to_rotvec(between))
        return 0.5 * (tail + float(turn @ np.linalg.solve(self.turning, turn)))

    def _spread(self, floor: float) -> Array:
        """(3, 3) m^2, covariance of the percept about a pose."""
        return self.covariance + np.diag((PLACE_FLOOR**2, PLACE_FLOOR**2, floor**2))
