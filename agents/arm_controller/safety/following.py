"""Whether an arm does what it was told: it stays on its way, and gets on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from agents.arm_controller.joints import Joints

Array = NDArray[np.float64]

OFF = 0.1
"""rad that a joint may be off the way: arms lag behind in time, and hardly beside it"""
STANDSTILL = 0.25
"""s, beside the time that samples may take, in which an arm gets on: to hear of a trajectory, and to gain speed"""
PROGRESS = 0.002
"""rad by which a joint must have moved for that"""


class Following:
    """Compares an arm with the trajectory that it was told, by place and not by time: it may be late.

    Args:
        positions: (m, n) rad, the way.
        names: of the joints.
        begin: s, when the arm was told.
        late: s that samples may be late.
    """

    def __init__(self, positions: Array, names: tuple[str, ...], begin: float, late: float) -> None:
        self._patience = STANDSTILL + late
        self._way, self._names = positions, names
        self._place = positions[0]
        self._since = begin

    def off_way(self, joints: Joints) -> str:
        """How the arm is off its way, in words; empty if it is on it."""
        away = np.abs(self._way - np.array(joints.positions))
        nearest = away[int(away.max(axis=1).argmin())]
        worst = int(nearest.argmax())
        return f"{self._names[worst]} is {nearest[worst]:.2f} rad off its way" if nearest[worst] > OFF else ""

    def stands_still(self, joints: Joints) -> bool:
        """Whether the arm has not got on for a while."""
        here = np.array(joints.positions)
        if float(np.abs(here - self._place).max()) > PROGRESS:
            self._place, self._since = here, joints.stamp
        return joints.stamp - self._since > self._patience
