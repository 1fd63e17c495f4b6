"""Whether the velocities of an arm's samples fit their positions: by velocities the arm counts as standing still."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from agents.arm_controller.joints import Joints
from agents.arm_controller.model.kinematics import JointChain

Array = NDArray[np.float64]

SPAN = 0.035
"""s over which ways are compared: two samples at 50 Hz, whose stamps jitter, so that a lie is noticed within 0.1 s"""
LAG = 0.06
"""s by which velocities may come later than positions: devices filter them over some samples"""
NOISE = 0.003
"""rad or m that a way may be off by the steps of encoders: two steps of one with 4096 a turn"""
JITTER = 0.5
"""Share by which the way of the told velocities may be off, beside that: stamps jitter by some ms of 20"""
BREAK = 0.2
"""s between two samples from which nothing is known of the velocities in between"""
_DELAYS = np.linspace(0.0, 1.0, 4)
"""Shares of `LAG` for which the way of the positions is looked at"""


class VelocityCheck:
    """Compares the way that velocities tell with the way that positions went, now or a moment ago.

    A truthful velocity that a device filters is that of a moment ago. So its integral over `SPAN` is between the least
    and the greatest way of the joint in a time so long that ended up to `LAG` ago.

    A joint that is knocked swings between two samples, so the velocities of a moment may fit no way. But they differ,
    while a driver that lies repeats itself. So only a velocity that the samples within `SPAN` tell alike is compared,
    whatever the one before them told.

    Args:
        chain: joints, of which some turn without end.
    """

    def __init__(self, chain: JointChain) -> None:
        self._chain = chain
        self._last: Joints | None = None
        self._samples: deque[tuple[float, Array, Array]] = deque()
        """Stamp (s), how far the joints have gone (n,), and the velocities told (n,)"""

    def problem(self, joints: Joints) -> str:
        """Which joint of the newest sample tells a velocity that is not its own, in words; empty for none."""
        self._add(joints)
        stamps = np.array([stamp for stamp, _, _ in self._samples])
        begin = int(np.searchsorted(stamps, joints.stamp - SPAN, side="right")) - 1
        if begin < 0:
            return ""
        told = np.array([velocities for _, _, velocities in self._samples])[begin:]
        way = (np.diff(stamps[begin:]) @ (told[1:] + told[:-1])) / 2
        gone = self._gone(stamps, joints.stamp - stamps[begin])
        off = np.maximum(gone.min(axis=0) - way, way - gone.max(axis=0)) - NOISE - JITTER * np.abs(way)
        off[(told[1:] != told[-1]).any(axis=0)] = -np.inf
        worst = int(off.argmax())
        if off[worst] <= 0.0:
            return ""
        name, velocity, span = self._chain.names[worst], joints.velocities[worst], joints.stamp - stamps[begin]
        return f"{name} tells {velocity:.2f} rad/s, and has gone {gone[0, worst]:.3f} rad within {span:.3f} s"

    def _add(self, joints: Joints) -> None:
        last, self._last = self._last, joints
        gone = np.zeros(len(joints.positions))
        if last is None or not 0.0 <= joints.stamp - last.stamp <= BREAK:
            self._samples.clear()
        else:
            gone = self._samples[-1][1] + self._chain.difference(last.positions, joints.positions)
        self._samples.append((joints.stamp, gone, np.array(joints.velocities)))
        kept = joints.stamp - SPAN - self._lag - BREAK
        while self._samples[0][0] < kept:
            self._samples.popleft()

    @property
    def _lag(self) -> float:
        """s, `LAG`, or of a slow device an interval: what happens within one no sample tells."""
        return LAG if len(self._samples) < 2 else max(LAG, self._samples[-1][0] - self._samples[-2][0])

    def _gone(self, stamps: Array, span: float) -> Array:
        """(k, n) rad or m that the joints went within `span` s, until now and until some moments ago."""
        ends = stamps[-1] - self._lag * _DELAYS
        ways = np.array([gone for _, gone, _ in self._samples]).T
        return np.array([np.interp(ends, stamps, way) - np.interp(ends - span, stamps, way) for way in ways]).T
