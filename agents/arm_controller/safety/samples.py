"""Whether the samples of an arm can be believed: a driver that lies must not move anything."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from agents.arm_controller.joints import Joints
from agents.arm_controller.model.kinematics import JointChain
from agents.arm_controller.safety.velocities import VelocityCheck

Array = NDArray[np.float64]

BEYOND = 0.02
"""rad or m beyond a limit that a joint may be measured: encoders have offsets, and data sheets round"""
FASTER = 1.5
"""Share of a joint's velocity limit that a sample may show: stamps jitter by some ms of 20"""
JUMP = 0.05
"""rad or m that a sample may be off beside that, by noise of the encoder and of the stamps"""
SHORTEST = 0.02
"""s that count at least between two samples: stamps of some drivers are rounded"""
CLOCKS_APART = 1.0
"""s by which the driver's clock may differ: poses of cameras and of other arms are compared by their stamps"""
KEPT = 100
"""Samples whose delays are known: the least of them is the offset of the driver's clock"""


class SampleCheck:
    """Judges one sample of an arm after the other.

    Args:
        chain: joints with their limits.
        late: s that a sample may come later than others did.
    """

    def __init__(self, chain: JointChain, late: float) -> None:
        self._chain, self._late = chain, late
        self._fastest = chain.velocity
        self._velocities = VelocityCheck(chain)
        self._last: Joints | None = None
        self._delays: list[float] = []

    def problem(self, joints: Joints, now: float) -> str:
        """What is wrong with a sample that came at time `now` (s), in words; empty if nothing is."""
        last, self._last = self._last, joints
        positions = np.array(joints.positions)
        wrong = self._velocities.problem(joints)  # which hears of each sample
        return (
            _of_another_time(joints.stamp, now)
            or self._beyond(positions)
            or ("" if last is None else self._jumped(positions, joints.stamp, last))
            or self._delayed(joints.stamp, now)
            or wrong
        )

    def _beyond(self, positions: Array) -> str:
        off = np.maximum(self._chain.lower - positions, positions - self._chain.upper)
        worst = int(off.argmax())
        if off[worst] <= BEYOND:
            return ""
        joint = self._chain.joints[worst]
        return f"{joint.name} is at {positions[worst]:.3f}, beyond its limits {joint.lower:.3f} to {joint.upper:.3f}"

    def _jumped(self, positions: Array, stamp: float, last: Joints) -> str:
        passed = stamp - last.stamp
        if passed < 0.0:
            return f"a sample is {-passed:.3f} s older than the one before"
        way = np.abs(self._chain.difference(last.positions, positions))
        allowed = FASTER * self._fastest * max(passed, SHORTEST) + JUMP
        worst = int((way - allowed).argmax())
        if way[worst] <= allowed[worst]:
            return ""
        return f"{self._chain.names[worst]} jumped by {way[worst]:.3f} rad within {passed:.3f} s"

    def _delayed(self, stamp: float, now: float) -> str:
        """Whether a sample comes later than others, or is stamped ahead of them: a jump within that time is none."""
        delay = now - stamp
        offset = min(self._delays, default=delay)
        self._delays = [*self._delays[1 - KEPT :], delay]
        if offset - delay > self._late:
            return f"samples of the joints are stamped {offset - delay:.2f} s further ahead than before"
        late = delay - offset
        return f"samples of the joints are {late:.2f} s late" if late > self._late else ""


def _of_another_time(stamp: float, now: float) -> str:
    """Whether the driver has another clock, in words; empty if not."""
    ahead = stamp - now
    if abs(ahead) <= CLOCKS_APART:
        return ""
    side = "ahead of" if ahead > 0.0 else "behind"
    return f"samples of the joints are stamped {abs(ahead):.1f} s {side} the clock of this agent"
