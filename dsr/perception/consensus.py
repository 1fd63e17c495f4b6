"""Whether objects that seem displaced alike tell of a moved camera more than its pose takes."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

SURE_OF_ROTATION = 0.75
"""rad^2, trace of a rotation's covariance up to which a percept tells it"""


def tells_rotation(covariance: NDArray[np.float64]) -> bool:
    """Whether percepts with this covariance (3, 3) of their rotation, rad^2, tell how something is turned."""
    return bool(covariance[0, 0] + covariance[1, 1] + covariance[2, 2] < SURE_OF_ROTATION)


def agree_beyond_chance(turnings: Iterable[bool]) -> bool:
    """Whether objects that agree on a motion of the camera could not agree just because it was fitted to them.

    A place has three numbers, and so has a turn; the camera's own pose has both. At least one place or turn more must
    agree. Two objects of which one shows how it is turned are enough, and so are three bare places.

    Args:
        turnings: of each object whether its percepts tell how it is turned.
    """
    return sum(1 + turning for turning in turnings) > 2
