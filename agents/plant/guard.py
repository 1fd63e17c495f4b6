"""The simulated arm's own safety: it moves only while its controller gives signs of life, and not while forbidden.

The guard is on the device's side, as in a real arm's cabinet. So it works when the controller has died.
"""

from __future__ import annotations

from agents.plant.arm import SimulatedArm
from agents.plant.messages import Command, Follow, KeepAlive, Stop

SHOWN = 0.2
"""s for which a fault is shown at least, that no sample of it is missed: ten samples"""


class ArmGuard:
    """Passes commands on to an arm, and stops it by itself.

    Args:
        arm: what moves.
        patience: s without a sign of life of the controller after which a moving arm stops; 0 for never.
        period: s, of a step.
    """

    def __init__(self, arm: SimulatedArm, patience: float, period: float) -> None:
        self.fault = ""
        """Why the arm stopped by itself or refuses to move; empty if it does as it is told."""
        self._arm, self._patience, self._period = arm, patience, period
        self._forbidden = ""
        self._silence = 0.0
        self._since = 0.0
        """s since the arm last stopped by itself"""
        self._is_asked = False
        """Whether the present motion is one that the controller asked for."""

    def obey(self, command: Command) -> None:
        """Do what the controller asks, unless motion is forbidden."""
        self._silence = 0.0
        if isinstance(command, KeepAlive):
            if not (self._forbidden or self._arm.is_driven) and self._since > SHOWN:
                self.fault = ""
            return
        if isinstance(command, Stop):
            self._arm.stop()
            return
        if self._forbidden:
            return
        if isinstance(command, Follow) and (aside := self._arm.aside(command.times, command.positions)):
            self._refuse(f"the way begins {aside[1]:.2f} rad from where {aside[0]} is")
            return
        self.fault, self._is_asked = "", True
        if isinstance(command, Follow):
            self._arm.follow(command.times, command.positions)
        else:
            self._arm.move_gripper(command.opening)

    def forbid(self, reason: str) -> None:
        """Stop, and refuse all motion from now on; with no reason, motion is allowed again, and nothing moves yet."""
        if reason and not self._forbidden:
            self._is_asked = False
            self._arm.stop()
        if reason != self._forbidden:
            self.fault = reason
        self._forbidden = reason

    def step(self) -> None:
        """Count the time of a step since the last sign of life."""
        self._silence += self._period
        self._since += self._period
        self._is_asked = self._is_asked and self._arm.is_driven
        if self._is_asked and self._patience and self._silence > self._patience:
            self._refuse(f"no sign of life of the arm's controller for {self._silence:.2g} s")

    def _refuse(self, reason: str) -> None:
        """Stop, and show why."""
        self.fault, self._is_asked, self._since = reason, False, 0.0
        self._arm.stop()
