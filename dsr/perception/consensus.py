"""Whether objects that seem displaced alike tell of a moved camera more than its pose takes."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

SURE_OF_ROTATION = 0.75
"""rad^2, trace of a rotation's covariance up to which a percept tells it"""


def tells_rotation(covariance: NDArray[np.float64]) -> bool:
    """Whether percepts with this covariance (3, 3) of their rotation, rad^2, tell how something is turned."""
    return float(np.trace(covariance)) < SURE_OF_ROTATION


def agree_beyond_chance(turnings: Iterable[bool]) -> bool:
    """Whether objects that agree on a motion of the camera could not agree just because it was fitted to them.

    A pose has six numbers, a place three. As many numbers as one more place has must agree beyond those of the
    camera's own pose. Two objects of which one shows how it is turned are enough, and so are three bare places.

    Args:
        turnings: of each object whether its percepts tell how it is turned.
    """
    return sum(6 if turning else 3 for turning in turnings) >= 6 + 3
