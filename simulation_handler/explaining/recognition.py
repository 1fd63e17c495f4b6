"""How probably cameras recognise an unseen thing: the mean over where it may be, not at one exact place."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Collection

from simulation_handler.explaining.situation import VisibilityQuery
from simulation_handler.scales import ROUNDING, UNSEEN_SLACK
from simulation_handler.shapes.geometry import Solid

_ASIDE = math.sqrt(2.0) * UNSEEN_SLACK
_POINTS = ((_ASIDE, 0.0), (-_ASIDE, 0.0), (0.0, _ASIDE), (0.0, -_ASIDE))
"""m, x and y: the third-degree spherical cubature of a Gaussian with `UNSEEN_SLACK` in both, all as probable
(Arasaratnam and Haykin, Cubature Kalman Filters, IEEE Transactions on Automatic Control 54, 2009)"""


def recognised_about(solid: Solid, others: Collection[Solid], visibility: VisibilityQuery) -> dict[str, float]:
    """Probability (0 to 1) with which each camera that may see an unseen object recognises it, by the camera's name.

    Through a gap, 10 mm make all the difference. Only an object that no camera sees right there counts as hidden.

    Args:
        solid: the object, where it is believed to be.
        others: all that may hide it.
        visibility: what cameras should see.
    """
    there = _recognised(solid, others, visibility)
    if max(there.values(), default=0.0) < ROUNDING:
        return there
    x, y, z = solid.position
    found: dict[str, float] = defaultdict(float)
    for dx, dy in _POINTS:
        for camera, share in _recognised(solid.moved((x + dx, y + dy, z)), others, visibility).items():
            found[camera] += share / len(_POINTS)
    return dict(found)


def _recognised(solid: Solid, others: Collection[Solid], visibility: VisibilityQuery) -> dict[str, float]:
    visible = visibility([*others, solid])
    return {camera: one.recognised for (camera, name), one in visible.items() if name == solid.name}
