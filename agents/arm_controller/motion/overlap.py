"""How much room sets of boxes have among other boxes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dsr.math3d.boxes import Array, Boxes, gaps


def room(parts: Boxes, things: Boxes, margins: Array, checked: NDArray[np.bool_] | None = None) -> Array:
    """(m, k) m that is left between m sets of parts and each of k things beyond the margins; inf where there is plenty.

    Args:
        parts: (m, p) boxes.
        things: (k) boxes.
        margins: (m, p) m that each part keeps away.
        checked: (m, p, k) which pairs count; all if None.
    """
    away = np.linalg.norm(parts.centers[:, :, None] - things.centers, axis=-1)
    near = away < parts.radii[:, :, None] + things.radii + margins[:, :, None]
    if checked is not None:
        near &= checked
    row, part, thing = np.nonzero(near)
    left = np.full((len(margins), len(things.centers)), np.inf)
    pairs = Boxes(parts.centers[row, part], parts.axes[row, part], parts.halves[row, part])
    np.minimum.at(left, (row, thing), gaps(pairs, things.at(thing)) - margins[row, part])
    return left
