"""Set-points of joints on their way to a target, or along a trajectory, within limits of velocity."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

ACCELERATION = 5.0
"""rad/s^2, of the joint with the longest way"""

CATCH_UP = 1.1
"""Of the velocity limits, at which a trajectory that is elsewhere is caught up with"""

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
        self._trajectory: tuple[Array, Array] | None = None
        self._elapsed = 0.0

    def aim(self, target: Sequence[float], speed: float = 1.0) -> None:
        """Go to `target` (n,) rad at `speed` (0 to 1) of the limits; may be called while moving."""
        self._trajectory = None
        self._target = np.array(target, dtype=float)
        ways = np.abs(self._target - self.positions) + self.velocities**2 / (2 * ACCELERATION)
        if not ways.any():
            return
        shares = np.maximum(ways / ways.max(), _LEAST_SHARE)
        self._cruise = shares * speed * float((self._limits / shares).min())
        self._acceleration = shares * ACCELERATION

    def follow(self, times: Sequence[float], positions: Sequence[Sequence[float]]) -> None:
        """Pass through `positions` (m, n) rad at `times` (m,) s from now, straight in between; stay at the last."""
        self._trajectory = np.array(times, dtype=float), np.array(positions, dtype=float)
        self._elapsed = 0.0

    def stop(self, positions: Sequence[float] | None = None) -> None:
        """Stay where it is, or at `positions` (n,) rad."""
        self._trajectory = None
        if positions is not None:
            self.positions = np.array(positions, dtype=float)
        self._target = self.positions.copy()
        self.velocities[:] = 0.0

    @property
    def is_resting(self) -> bool:
        """Whether it has arrived: another step would change nothing."""
        return self._trajectory is None and not self.velocities.any() and bool((self.positions == self._target).all())

    def step(self, duration: float) -> None:
        """Advance by `duration` s."""
        if self._trajectory is not None:
            self._play(*self._trajectory, duration)
            return
        error = self._target - self.positions
        distance = np.abs(error)
        stopping = np.sqrt(2 * self._acceleration * distance)
        wanted = np.sign(error) * np.minimum(np.minimum(self._cruise, stopping), distance / duration)
        slows = (wanted * self.velocities < 0) | (np.abs(wanted) < np.abs(self.velocities))
        change = np.where(slows, ACCELERATION, self._acceleration) * duration
        self.velocities += np.clip(wanted - self.velocities, -change, change)
        self.positions += self.velocities * duration

    def _play(self, times: Array, positions: Array, duration: float) -> None:
        self._elapsed += duration
        after = int(np.searchsorted(times, self._elapsed))
        if after == 0 or after == len(times):
            wanted = positions[min(after, len(times) - 1)]
        else:
            share = (self._elapsed - times[after - 1]) / (times[after] - times[after - 1])
            wanted = positions[after - 1] + share * (positions[after] - positions[after - 1])
        most = CATCH_UP * self._limits * duration
        step = np.clip(wanted - self.positions, -most, most)
        self.positions += step
        self.velocities = step / duration
        if after == len(times) and not step.any():
            self.stop()
