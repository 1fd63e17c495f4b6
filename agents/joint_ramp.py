"""Commanded positions of joints: smooth ways to targets, trajectories, and stops within the limits, step by step.

`ruckig` makes the motions: the fastest ones within limits of velocity, acceleration and jerk (L. Berscheid, T. Kroeger,
"Jerk-limited Real-time Trajectory Generation with Arbitrary Target States", RSS 2021).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from ruckig import ControlInterface, InputParameter, OutputParameter, Result, Ruckig, Synchronization

from dsr.errors import DsrError

Array = NDArray[np.float64]

ACCELERATION = 5.0
"""rad/s^2 of every joint at most: data sheets of arms of this size name about 5 for the large joints"""
JERK = 50.0
"""rad/s^3 of every joint at most: the greatest acceleration builds up in 0.1 s, so the links hardly ring"""
CATCH_UP = 1.1
"""Share of the velocity limits with which the arm catches up with a trajectory that is elsewhere"""


class Ramp:
    """Positions (n,) in rad that move to a target; from rest, in a straight line in joint space.

    Args:
        positions: (n,) where it starts, at rest.
        limits: (n,) highest velocities, rad/s.
        period: s, of a step.
    """

    def __init__(self, positions: Sequence[float], limits: Sequence[float], period: float) -> None:
        count = len(positions)
        self.positions: Array = np.array(positions, dtype=float)
        self.velocities: Array = np.zeros(count)
        self._limits: Array = np.array(limits, dtype=float)
        self._period = period
        self._generator = Ruckig(count, period)
        self._aim = InputParameter(count)
        self._next = OutputParameter(count)
        self._aim.max_acceleration, self._aim.max_jerk = [ACCELERATION] * count, [JERK] * count
        self._is_aiming = False
        self._trajectory: tuple[Array, Array] | None = None
        self._elapsed = 0.0

    def aim(self, target: Sequence[float], speed: float = 1.0) -> None:
        """Go to `target` (n,) rad at `speed` (0 to 1) of the limits; may be called while moving."""
        self._begin(ControlInterface.Position)
        self._aim.target_position = list(target)
        self._aim.target_velocity = [0.0] * len(self.positions)
        self._aim.max_velocity = (self._limits * speed).tolist()
        self._aim.synchronization = Synchronization.Phase

    def follow(self, times: Sequence[float], positions: Sequence[Sequence[float]]) -> None:
        """Pass through `positions` (m, n) rad at `times` (m,) s from now, straight in between; stay at the last."""
        self._is_aiming = False
        self._trajectory = np.array(times, dtype=float), np.array(positions, dtype=float)
        self._elapsed = 0.0

    def stop(self, positions: Sequence[float] | None = None, velocities: Sequence[float] | None = None) -> None:
        """Come to rest within the limits; from `positions` (n,) rad and `velocities` (n,) rad/s, if they were measured.

        An arm that something holds up has a velocity of 0: it stays where it is, and presses no further. A stop that is
        under way goes on.
        """
        if self.is_braking:
            return
        if positions is not None and velocities is not None:
            self.positions = np.array(positions, dtype=float)
            self.velocities = np.clip(velocities, -self._limits, self._limits)
        self._begin(ControlInterface.Velocity)
        self._aim.target_velocity = [0.0] * len(self.positions)
        self._aim.synchronization = Synchronization.Phase

    @property
    def is_resting(self) -> bool:
        """Whether the ramp has arrived: another step would change nothing."""
        return self._trajectory is None and not self._is_aiming

    @property
    def is_braking(self) -> bool:
        """Whether the ramp comes to rest after `stop`."""
        return self._is_aiming and self._aim.control_interface == ControlInterface.Velocity

    def step(self) -> None:
        """Advance by a period."""
        if self._trajectory is not None:
            self._play(*self._trajectory)
        elif self._is_aiming:
            self._approach()

    def _begin(self, interface: ControlInterface) -> None:
        """Start a motion from the present state."""
        was_aiming, self._is_aiming, self._trajectory = self._is_aiming, True, None
        known = was_aiming and self._next.new_velocity == self.velocities.tolist()
        self._aim.control_interface = interface
        self._aim.current_position = self.positions.tolist()
        self._aim.current_velocity = self.velocities.tolist()
        self._aim.current_acceleration = self._next.new_acceleration if known else [0.0] * len(self.positions)
        self._aim.target_acceleration = [0.0] * len(self.positions)

    def _approach(self) -> None:
        result = self._generator.update(self._aim, self._next)
        if result not in (Result.Working, Result.Finished):
            raise DsrError(f"no motion of the joints from {self._aim.current_position}: ruckig says {result}")
        self._next.pass_to_input(self._aim)
        self.positions = np.array(self._next.new_position)
        self.velocities = np.array(self._next.new_velocity)
        if result == Result.Finished:
            self._is_aiming = False
            self.velocities[:] = 0.0
            if self._aim.control_interface == ControlInterface.Position:
                self.positions = np.array(self._aim.target_position)

    def _play(self, times: Array, positions: Array) -> None:
        self._elapsed += self._period
        after = int(np.searchsorted(times, self._elapsed))
        if after == 0 or after == len(times):
            wanted = positions[min(after, len(times) - 1)]
        else:
            share = (self._elapsed - times[after - 1]) / (times[after] - times[after - 1])
            wanted = positions[after - 1] + share * (positions[after] - positions[after - 1])
        most = CATCH_UP * self._limits * self._period
        step = np.clip(wanted - self.positions, -most, most)
        self.positions = self.positions + step
        self.velocities = step / self._period
        if after == len(times) and not step.any():
            self._trajectory = None
