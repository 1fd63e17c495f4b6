"""Commanded positions of joints: along trajectories, and to rest within the limits, step by step.

`ruckig` makes the stops and joins an arm to a trajectory beside it: the fastest ways within limits of acceleration and
jerk (L. Berscheid, T. Kroeger, "Jerk-limited Real-time Trajectory Generation with Arbitrary Target States", RSS 2021).
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
"""Share of the velocity limits that an arm may reach while it catches up with a trajectory beside it"""
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
        self._join = InputParameter(count)
        self._join.max_velocity = ((CATCH_UP - 1.0) * self._limits).tolist()
        self._join.max_acceleration, self._join.max_jerk = [ACCELERATION] * count, [JERK] * count
        self._beside: Array | None = None
        """(n,) rad by which the joints still are beside their trajectory"""
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
        """Pass through `positions` (m, n) rad at `times` (m,) s from now, straight in between; stay at the last.

        The joints go to the first positions in the time until then. What the velocity limits do not allow in that time,
        the joints make up for on the way, within the limits of acceleration and jerk.
        """
        self.is_braking = False
        rows, first = np.array(positions, dtype=float), times[0]
        reach = self._limits * first
        begin = rows[0] - np.clip(rows[0] - self.positions, -reach, reach)
        if first > 0.0:
            times, rows = [0.0, *times], np.vstack([begin, rows])
        self._trajectory = np.array(times, dtype=float), rows
        self._elapsed = 0.0
        slope = (rows[1] - rows[0]) / (times[1] - times[0]) if len(rows) > 1 else np.zeros(len(begin))
        self._begin_beside(self.positions - begin, slope)

    def rest(self, positions: Sequence[float]) -> None:
        """Stay at `positions` (n,) rad, where the joints were measured at rest."""
        self.positions, self.velocities = np.array(positions, dtype=float), np.zeros(len(self.positions))
        self.is_braking, self._trajectory = False, None

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
        self._generator.reset()
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
        arrived = self._advance(self._rest)
        self.positions = np.array(self._next.new_position)
        self.velocities = np.array(self._next.new_velocity)
        if arrived:
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
        if self._beside is not None:
            self._make_up()
            wanted = wanted if self._beside is None else wanted + self._beside
        most = CATCH_UP * self._limits * self._period
        step = np.clip(wanted - self.positions, -most, most)
        self.positions = self.positions + step
        self.velocities = step / self._period
        if after == len(times) and self._beside is None and not step.any():
            self._trajectory = None

    def _begin_beside(self, beside: Array, slope: Array) -> None:
        """Begin to make up for (n,) rad between the joints and a trajectory that begins at `slope` (n,) rad/s.

        Joints that move change to its velocity within the limits; joints at rest begin with it, as they are told.
        """
        faster = self.velocities - slope if self.velocities.any() else np.zeros(len(beside))
        self._beside = beside if beside.any() or faster.any() else None
        self._generator.reset()
        self._join.current_position, self._join.current_velocity = beside.tolist(), faster.tolist()
        self._join.current_acceleration = [0.0] * len(beside)

    def _make_up(self) -> None:
        """Advance by a period on the way to the trajectory."""
        arrived = self._advance(self._join)
        self._beside = None if arrived else np.array(self._next.new_position)

    def _advance(self, way: InputParameter) -> bool:
        """Advance by a period on a `way` of `ruckig`; whether it has come to its end."""
        result = self._generator.update(way, self._next)
        if result not in (Result.Working, Result.Finished):
            raise DsrError(f"no way of the joints from {way.current_position}: ruckig says {result}")
        self._next.pass_to_input(way)
        return bool(result == Result.Finished)
