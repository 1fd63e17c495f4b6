"""Closes fingers until they press as hard as a limit allows, where the driver tells how hard they press."""

from __future__ import annotations

import math
from collections.abc import Callable

from msgspec.structs import replace

from agents.arm_controller.joints import Joints

LEAST = 0.5
"""Share of the limit below which fingers that hold something are told to press more"""
STEP = 0.0005
"""m by which they are told to close further at first, and twice as much each time; then openings are halved between"""
FINEST = 1e-6
"""m between too loose and too tight, below which something has moved: the search begins anew"""
PEAK = 2
"""Samples in a row above the limit before the fingers are stopped: fingers that set off press for one"""
REACT = 2
"""Samples between two changes: fingers need as long to follow"""
SETTLES = 0.3
"""s in which fingers press again after they were stopped: eight changes. Till then what they met counts as touched"""


class GentleFingers:
    """Moves the fingers of one gripper.

    Args:
        limit: N or A as the driver tells it, the most with which they may press; 0 for as hard as the device does.
        move: has the driver move them to an opening (m).
    """

    def __init__(self, limit: float, move: Callable[[float], None]) -> None:
        self._limit, self._send = limit, move
        self._goal = self._wanted = 0.0
        self._is_closing = self._has_met = False
        self._above = self._waited = 0
        self._step, self._loose, self._tight = STEP, 0.0, -math.inf
        self._pressed_at = -math.inf

    def move(self, opening: float, joints: Joints) -> None:
        """Open or close to `opening` m from where the newest sample says that the fingers are."""
        self._goal = self._wanted = opening
        self._is_closing, self._has_met = opening < joints.opening, False
        self._above = self._waited = 0
        self._send(opening)

    def tick(self, joints: Joints) -> None:
        """Have fingers that met something press between `LEAST` of the limit and the limit; call it at each sample."""
        if not self._is_limited or joints.pressing is None:
            return
        self._above = self._above + 1 if joints.pressing > self._limit else 0
        if not self._has_met:
            if self._above == PEAK:
                self._has_met, self._step, self._loose, self._tight = True, STEP, joints.opening, -math.inf
                self._tell(joints.opening)
            return
        self._waited += 1
        if self._waited < REACT or self.is_settled(joints):
            return
        self._tell(max(self._between(is_tight=self._above > 0), self._wanted))

    def _between(self, *, is_tight: bool) -> float:
        """The next opening to try, m, after the present one was too tight or too loose."""
        if is_tight:
            self._tight = self._goal
        else:
            self._loose = self._goal
        if self._loose - self._tight < FINEST:
            self._loose, self._tight = (self._goal + STEP, self._goal) if is_tight else (self._goal, -math.inf)
            self._step = STEP
        if self._tight > -math.inf:
            return (self._loose + self._tight) / 2.0
        self._step *= 2.0
        return self._loose - self._step / 2.0

    def is_settled(self, joints: Joints) -> bool:
        """Whether the fingers press as hard as they are to, as far as there is a limit and they met something."""
        pressing = joints.pressing
        if not (self._is_limited and self._has_met) or pressing is None:
            return True
        is_enough = pressing >= LEAST * self._limit or self._goal <= self._wanted
        return is_enough and pressing <= self._limit

    def felt(self, joints: Joints) -> Joints:
        """The sample, with contact also where closing fingers press with `LEAST` of the limit or more."""
        if not self._is_limited or joints.pressing is None:
            return joints
        if joints.pressing >= LEAST * self._limit:
            self._pressed_at = joints.stamp
        touches = self._has_met and joints.stamp - self._pressed_at <= SETTLES
        return replace(joints, contact=True) if touches else joints

    @property
    def _is_limited(self) -> bool:
        return self._limit > 0.0 and self._is_closing

    def _tell(self, goal: float) -> None:
        self._goal, self._waited = goal, 0
        self._send(goal)

    def problem(self, joints: Joints) -> str:
        """Why the fingers must not close, or hold what they have; empty if all is well."""
        if self._limit and joints.pressing is None:
            return "the driver does not tell how hard the fingers press, which `grip_limit` limits"
        if not self.is_settled(joints):
            return f"the fingers press with {joints.pressing:.3g}, not with {LEAST * self._limit:g} to {self._limit:g}"
        return ""
