"""Whether a thing that is seen elsewhere got there bit by bit, or at once, as a bumped camera shows it."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def by_way(offsets: Array, variance: float, reach: float) -> float:
    """Nats by which a way explains percepts better than a jump; 0 without percepts.

    Each moment of setting out and of arriving is as probable. In between, motion is steady.

    Args:
        offsets: (n, 3) m of percepts from where the thing was before, oldest first.
        variance: m^2, of each coordinate of a percept.
        reach: m, standard deviation of how far it gets along each axis.
    """
    if len(offsets) == 0:
        return 0.0
    ways, jumps = (_evidence(shapes, offsets, variance, reach) for shapes in _shapes(len(offsets)))
    return float(ways - jumps)


def _evidence(shapes: Array, offsets: Array, variance: float, reach: float) -> Array:
    """Log of the mean likelihood of (n, 3) offsets if they have (k, n) shapes, each as probable; up to a constant."""
    precisions = (shapes**2).sum(axis=1) / variance + 1.0 / reach**2
    fits = ((shapes @ offsets / variance) ** 2).sum(axis=1) / precisions
    logs = 0.5 * (fits - offsets.shape[1] * np.log(precisions))
    return np.asarray(np.logaddexp.reduce(logs) - np.log(len(logs)))


@cache
def _shapes(count: int) -> tuple[Array, Array]:
    """(k, count) shares of the displacement that percepts show, by ways and by jumps.

    A way takes two periods between percepts at least, or nothing would tell it from a jump. It may have begun a period
    before the first percept, and end one after the last.
    """
    pairs = [(start, end) for start in range(-1, count) for end in range(start + 1, count + 1)]
    told = {(start, end): np.clip((np.arange(count) - start) / (end - start), 0.0, 1.0) for start, end in pairs}
    ways = [shape for (start, end), shape in told.items() if end > start + 1]
    jumps = [shape for (start, end), shape in told.items() if end == start + 1]
    return np.array(ways), np.array(jumps)
