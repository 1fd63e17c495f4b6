"""From a path of joint positions to a trajectory: rounded corners, and times within velocity and acceleration limits.

The times are those of two passes over the path, forward with the greatest acceleration and backward with the
greatest deceleration, below the speed that limits and curvature allow (K. Shin, N. McKay, "Minimum-Time Control of
Robotic Manipulators with Geometric Path Constraints", IEEE TAC 1985, with limits of joints instead of torques).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

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


@dataclass(frozen=True)
class Trajectory:
    """Joint positions over time, at rest at both ends."""

    times: Array
    """(m,) s since it begins"""
    positions: Array
    """Joint positions (m, n), rad: m samples of n joints."""

    @property
    def duration(self) -> float:
        """Duration of the trajectory, s."""
        return float(self.times[-1])


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


def timed(path: Array, velocity: Array, acceleration: float) -> Trajectory:
    """The fastest way along `path` (m, n) from rest to rest.

    Args:
        path: rad, evenly spaced; three points or more.
        velocity: (n,) rad/s, the most for each joint.
        acceleration: rad/s^2, the most for every joint along the path; bends add to it at most as much again.
    """
    slope = np.gradient(path, axis=0)
    bend = np.abs(np.gradient(slope, axis=0)).max(axis=1)
    steep = np.maximum(np.abs(slope), 1e-12)
    limit = np.minimum((velocity / steep).min(axis=1), np.sqrt(_BEND_SHARE * acceleration / np.maximum(bend, 1e-12)))
    gain = (acceleration / steep.max(axis=1)).tolist()
    speed = limit.tolist()
    speed[0] = speed[-1] = 0.0
    for passes in (range(1, len(path)), range(len(path) - 2, -1, -1)):
        for index in passes:
            last = index - passes.step
            speed[index] = min(speed[index], math.sqrt(speed[last] ** 2 + 2.0 * gain[last]))
    rates = np.array(speed)
    durations = 2.0 / np.maximum(rates[1:] + rates[:-1], 1e-9)
    times = np.concatenate([[0.0], np.cumsum(durations)])
    even = np.linspace(0.0, times[-1], max(2, math.ceil(times[-1] / PERIOD) + 1))
    before = np.clip(np.searchsorted(times, even, side="right") - 1, 0, len(durations) - 1)
    passed = even - times[before]
    gained = 0.5 * passed * (rates[before + 1] - rates[before]) / durations[before]
    travelled = before + passed * (rates[before] + gained)
    points = np.arange(len(path))
    return Trajectory(even, np.stack([np.interp(travelled, points, joint) for joint in path.T], axis=1))
