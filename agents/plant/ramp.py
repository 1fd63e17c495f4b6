"""Set-points of joints on their way to a target, within limits of velocity and acceleration."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

ACCELERATION = 5.0
"""rad/s^2, of the joint with the longest way"""

_LEAST_SHARE = 0.05  # of speed and acceleration, for joints that are nearly there already

Array = NDArray[np.float64]


class Ramp:
    """Positions (n,) in rad that move to a target; from rest, in a straight line in joint space.

    Args:
        positions: (n,) where it starts, at rest.
        limits: (n,) highest velocities, rad/s.
    """

    def __init__(self, positions: Sequence[float], limits: Sequence[float]) -> None:
        self.positions: Array = np.array(positions, dtype=float)
        self.velocities: Array = np.zeros(len(positions))
        self._limits: Array = np.array(limits, dtype=float)
        self._target = self.positions.copy()
        self._cruise = self._limits
        self._acceleration: Array = np.full(len(positions), ACCELERATION)

    def aim(self, target: Sequence[float], speed: float = 1.0) -> None:
        """Go to `target` (n,) rad at `speed` (0 to 1) of the limits; may be called while moving."""
        self._target = np.array(target, dtype=float)
        ways = np.abs(self._target - self.positions) + self.velocities**2 / (2 * ACCELERATION)
        if not ways.any():
            return
        shares = np.maximum(ways / ways.max(), _LEAST_SHARE)
        self._cruise = shares * speed * float((self._limits / shares).min())
        self._acceleration = shares * ACCELERATION

    def stop(self) -> None:
        """Stay where it is."""
        self._target = self.positions.copy()
        self.velocities[:] = 0.0

    def step(self, duration: float) -> None:
        """Advance by `duration` s."""
        error = self._target - self.positions
        distance = np.abs(error)
        stopping = np.sqrt(2 * self._acceleration * distance)
        wanted = np.sign(error) * np.minimum(np.minimum(self._cruise, stopping), distance / duration)
        slows = (wanted * self.velocities < 0) | (np.abs(wanted) < np.abs(self.velocities))
        change = np.where(slows, ACCELERATION, self._acceleration) * duration
        self.velocities += np.clip(wanted - self.velocities, -change, change)
        self.positions += self.velocities * duration
