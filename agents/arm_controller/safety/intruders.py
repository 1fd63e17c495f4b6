"""What has come into the way of an arm since the way was planned: things and zones that are new, moved or grew."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from agents.arm_controller.motion.obstacles import MARGIN
from agents.arm_controller.scene import Obstacle
from dsr.math3d.boxes import CORNERS, Array

LEAST_MOVE = MARGIN
"""m that a corner of a thing may move: ways keep as far away from it; a belief moves by some mm with each percept"""


class Intruders:
    """Compares what is believed to be around an arm with what a way was planned around."""

    def __init__(self) -> None:
        self._known: dict[str, Obstacle] = {}

    def expect(self, things: Sequence[Obstacle]) -> None:
        """Take these things as those that a way was planned around."""
        self._known = {thing.name: thing for thing in things}

    def among(self, things: Sequence[Obstacle]) -> list[Obstacle]:
        """Those of the things that are not where, or as large as, they were; each change is told once."""
        found = [thing for thing in things if not self._is_known(thing)]
        self._known.update((thing.name, thing) for thing in found)
        return found

    def _is_known(self, thing: Obstacle) -> bool:
        known = self._known.get(thing.name)
        return known is not None and (known == thing or _moved(known, thing) <= LEAST_MOVE)


def _moved(before: Obstacle, now: Obstacle) -> float:
    """M by which a corner of the box of a thing moved at most: as that was shifted or turned, or grew."""
    return float(np.linalg.norm(_corners(now) - _corners(before), axis=1).max())


def _corners(thing: Obstacle) -> Array:
    return thing.pose.apply(CORNERS * thing.size * 0.5)
