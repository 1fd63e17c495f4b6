"""A naive peer: every thing is where it was recognised last, and is always seen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.adept.unseen.supposing import RecognisedThing
from dsr.vocabulary.nats import MISSED_FRAME, MOST_MISFIT, MOST_MISSED

Array = NDArray[np.float64]


@dataclass
class _Last:
    kind: str
    position: Array
    missed: int = 0


class LastPercept:
    """Surprise by the last percepts, in nats: how far a percept is from there, and how often one is missing.

    Args:
        resolution: m, standard deviation of each coordinate of a percept.
    """

    def __init__(self, resolution: float) -> None:
        self._resolution = resolution
        self._known: list[_Last] = []

    def step(self, percepts: Sequence[RecognisedThing]) -> float:
        """Nats of one frame."""
        free = list(self._known)
        nats = 0.0
        for percept in percepts:
            alike = [one for one in free if one.kind == percept.kind]
            if not alike:
                self._known.append(_Last(percept.kind, percept.position))
                continue
            nearest = min(alike, key=lambda one: math.dist(one.position, percept.position))
            squared = math.dist(nearest.position, percept.position) ** 2 / self._resolution**2
            nats += min(0.5 * squared, MOST_MISFIT)
            nearest.position, nearest.missed = percept.position, 0
            free.remove(nearest)
        for one in free:
            one.missed += 1
            nats += min(one.missed * MISSED_FRAME, MOST_MISSED)
        return nats
