"""From a path of joint positions to a trajectory: rounded corners, and times within limits of the joints.

The times are those of two passes over the path, forward with the greatest acceleration and backward with the
greatest deceleration, below the speed that limits and curvature allow (K. Shin, N. McKay, "Minimum-Time Control of
Robotic Manipulators with Geometric Path Constraints", IEEE TAC 1985, with limits of joints instead of torques).

Means over a moving window of time then limit the jerk (L. Biagiotti, C. Melchiorri, "FIR filters for online trajectory
planning with time- and frequency-domain specifications", CEP 2012): velocities and accelerations are means, too, so
they keep their limits. `ruckig` does this for ways between two states, and for paths only as a paid service.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SPACING = 0.02
"""rad between two points of a path, along the joint with the largest motion"""
PERIOD = 0.02
"""s between two points of a trajectory"""
_LEAST_POINTS = 5  # so that there is room to gain speed and lose it
_ROUNDS = 2  # of smoothing: the second one makes the curvature continuous
_BEND_SHARE = 0.7  # of the acceleration that may go into bends
_TRIES = 20  # times that a trajectory is made slower until it keeps its limits; two do nearly always
_MEANT = 0.999  # share of the limits that is aimed at when a trajectory is made slower


class MotionLimits(NamedTuple):
    """The limits of one motion."""

    speed: float
    """0 to 1 of the joints' velocity limits"""
    acceleration: float
    """rad/s^2, the most for every joint"""
    jerk: float
    """rad/s^3, the most for every joint"""


@dataclass(frozen=True)
class Trajectory:
    """Joint positions over time, at rest at both ends."""

    times: Array
    """(m,) s since it begins"""
    positions: Array
    """Joint positions (m, n), rad: m samples of n joints."""
    final: int = 1
    """How many of the last positions are on a straight line of the tool, on which the gripper works between things."""

    @property
    def duration(self) -> float:
        """Duration of the trajectory, s."""
        return float(self.times[-1])

    def nearest(self, positions: Array) -> int:
        """Index of the one that is nearest to joint `positions` (n,) rad."""
        return int(np.abs(self.positions - positions).max(axis=1).argmin())


def resampled(path: Array) -> Array:
    """Points (m, n) evenly along the polyline `path` (k, n), ends included."""
    lengths = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(path, axis=0)).max(axis=1, initial=0.0))])
    count = max(_LEAST_POINTS, math.ceil(lengths[-1] / SPACING) + 1)
    at = np.linspace(0.0, lengths[-1], count)
    return np.stack([np.interp(at, lengths, joint) for joint in path.T], axis=1)


def rounded(path: Array, reach: int, head: int, tail: int) -> Array:
    """The path (m, n) with its corners cut: each point the mean of up to `reach` on either side.

    The first `head` and the last `tail` points stay where they are.
    """
    count = len(path)
    index = np.arange(count)
    room = np.minimum(index - head, count - 1 - tail - index)
    half = np.clip(room, 0, reach)
    for _ in range(_ROUNDS):
        sums = np.vstack([np.zeros(path.shape[1]), np.cumsum(path, axis=0)])
        path = (sums[index + half + 1] - sums[index - half]) / (2 * half + 1)[:, None]
    return path


def timed(path: Array, velocity: Array, limits: MotionLimits) -> Trajectory:
    """The fastest way along `path` (m, n) from rest to rest, but for some tenths of a second.

    Args:
        path: rad, evenly spaced; three points or more.
        velocity: (n,) rad/s, the most for each joint.
        limits: of the motion; its share of `velocity` is the most.
    """
    velocity = limits.speed * velocity
    times, rates = _paced(path, velocity, limits.acceleration)
    window = max(1, math.ceil(2.0 * limits.acceleration / (limits.jerk * PERIOD)))
    slower = 1.0
    for _ in range(_TRIES):
        rows = _averaged(_sampled(path, times * slower, rates / slower), window)
        excess = _excess(rows, velocity, limits)
        if excess <= 1.0:
            break
        slower *= excess / _MEANT
    return Trajectory(np.linspace(0.0, PERIOD * (len(rows) - 1), len(rows)), rows)


def _paced(path: Array, velocity: Array, acceleration: float) -> tuple[Array, Array]:
    """When (m,) s each point of the path is passed, and at which rate (m,), points/s."""
    slope = np.gradient(path, axis=0)
    bends = np.abs(np.gradient(slope, axis=0))
    slopes = np.maximum(np.abs(slope), 1e-12)
    limit = np.minimum(
        (velocity / slopes).min(axis=1), np.sqrt(_BEND_SHARE * acceleration / np.maximum(bends.max(axis=1), 1e-12))
    )
    squares = (limit**2).tolist()
    squares[0] = squares[-1] = 0.0
    for passes in (range(1, len(path)), range(len(path) - 2, -1, -1)):
        for index in passes:
            last = index - passes.step
            gain = float((np.maximum(acceleration - bends[last] * squares[last], 0.0) / slopes[last]).min())
            squares[index] = min(squares[index], squares[last] + 2.0 * gain)
    rates = np.sqrt(np.array(squares))
    durations = 2.0 / np.maximum(rates[1:] + rates[:-1], 1e-9)
    return np.concatenate([[0.0], np.cumsum(durations)]), rates


def _sampled(path: Array, times: Array, rates: Array) -> Array:
    """(k, n) rad, where the path is at each period."""
    durations = np.diff(times)
    even = np.minimum(PERIOD * np.arange(math.ceil(times[-1] / PERIOD) + 1), times[-1])
    before = np.clip(np.searchsorted(times, even, side="right") - 1, 0, len(durations) - 1)
    passed = even - times[before]
    gained = 0.5 * passed * (rates[before + 1] - rates[before]) / durations[before]
    travelled = before + passed * (rates[before] + gained)
    points = np.arange(len(path))
    rows = np.stack([np.interp(travelled, points, joint) for joint in path.T], axis=1)
    rows[-1] = path[-1]
    return rows


def _averaged(rows: Array, window: int) -> Array:
    """The mean of each `window` rows in succession, from the first row alone to the last alone."""
    padded = np.vstack([np.repeat(rows[:1], window, axis=0), rows, np.repeat(rows[-1:], window, axis=0)])
    sums = np.cumsum(np.vstack([np.zeros(rows.shape[1]), padded - rows[0]]), axis=0)
    means: Array = (sums[window:] - sums[:-window]) / window + rows[0]
    means[-1] = rows[-1]
    return means


def _excess(rows: Array, velocity: Array, limits: MotionLimits) -> float:
    """By how much a trajectory must become slower to keep the limits; 1 or less if it does."""
    velocities = np.diff(rows, axis=0, prepend=rows[:1], append=rows[-1:]) / PERIOD
    accelerations = np.diff(velocities, axis=0) / PERIOD
    jerks = np.diff(accelerations, axis=0) / PERIOD
    return max(
        float((np.abs(velocities) / velocity).max(initial=0.0)),
        math.sqrt(float(np.abs(accelerations).max(initial=0.0)) / limits.acceleration),
        math.cbrt(float(np.abs(jerks).max(initial=0.0)) / limits.jerk),
    )
