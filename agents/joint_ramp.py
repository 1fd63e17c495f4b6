"""Commanded positions of joints: along trajectories, and to rest within the limits, step by step.

`ruckig` makes the stops: the fastest ones within limits of acceleration and jerk (L. Berscheid, T. Kroeger,
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
ASIDE = 0.1
"""rad that a trajectory may begin beside the arm, as far as the arm may be off its way: more is the way of another arm,
or of one that is believed to be elsewhere"""


class Ramp:
    """Positions (n,) in rad that follow trajectories, and come to rest.

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
        self._rest = InputParameter(count)
        self._rest.control_interface = ControlInterface.Velocity
        self._rest.synchronization = Synchronization.Phase
        self._rest.max_acceleration, self._rest.max_jerk = [ACCELERATION] * count, [JERK] * count
        self._rest.target_velocity = self._rest.target_acceleration = [0.0] * count
        self._next = OutputParameter(count)
        self.is_braking = False
        """Whether the ramp comes to rest after `stop`."""
        self._trajectory: tuple[Array, Array] | None = None
        self._elapsed = 0.0

    def aside(self, times: Sequence[float], positions: Sequence[Sequence[float]]) -> tuple[int, float] | None:
        """The joint, by index, that cannot come to the begin of a trajectory in time, and how far (rad) it is away.

        None if the trajectory, as of `follow`, begins where the joints are or can be by then.
        """
        away = np.abs(np.array(positions[0], dtype=float) - self.positions)
        left = away - self._limits * times[0]
        worst = int(left.argmax())
        return (worst, float(away[worst])) if left[worst] > ASIDE else None

    def follow(self, times: Sequence[float], positions: Sequence[Sequence[float]]) -> None:
        """Pass through `positions` (m, n) rad at `times` (m,) s from now, straight in between; stay at the last."""
        self.is_braking = False
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
        self.is_braking, self._trajectory = True, None
        self._rest.current_position = self.positions.tolist()
        self._rest.current_velocity = self.velocities.tolist()
        self._rest.current_acceleration = [0.0] * len(self.positions)

    @property
    def is_resting(self) -> bool:
        """Whether the ramp has arrived: another step would change nothing."""
        return self._trajectory is None and not self.is_braking

    def step(self) -> None:
        """Advance by a period."""
        if self._trajectory is not None:
            self._play(*self._trajectory)
        elif self.is_braking:
            self._brake()

    def _brake(self) -> None:
        result = self._generator.update(self._rest, self._next)
        if result not in (Result.Working, Result.Finished):
            raise DsrError(f"no way to rest of the joints from {self._rest.current_position}: ruckig says {result}")
        self._next.pass_to_input(self._rest)
        self.positions = np.array(self._next.new_position)
        self.velocities = np.array(self._next.new_velocity)
        if result == Result.Finished:
            self.is_braking = False
            self.velocities[:] = 0.0

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
