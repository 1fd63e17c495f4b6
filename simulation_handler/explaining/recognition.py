"""How probably cameras recognise an unseen thing: the mean over where it may be, not at one exact place."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence

from simulation_handler.explaining.situation import VisibilityQuery
from simulation_handler.scales import ROUNDING, UNSEEN_SLACK
from simulation_handler.shapes.geometry import Solid

_ASIDE = math.sqrt(2.0) * UNSEEN_SLACK
_POINTS = ((_ASIDE, 0.0), (-_ASIDE, 0.0), (0.0, _ASIDE), (0.0, -_ASIDE))
"""m, x and y: the third-degree spherical cubature of a Gaussian with `UNSEEN_SLACK` in both, all as probable
(Arasaratnam and Haykin, Cubature Kalman Filters, IEEE Transactions on Automatic Control 54, 2009)"""


def recognised_about(
    solids: Sequence[Solid], among: Sequence[Solid], visibility: VisibilityQuery
) -> list[dict[str, float]]:
    """Probability (0 to 1) with which each camera that may see an unseen object recognises it, by the camera's name.

    Through a gap, 10 mm make all the difference. Only an object that no camera sees right there counts as hidden.

    Args:
        solids: objects, each where it is believed to be; or places where one may be.
        among: all that may hide them; what has the name of an object does not hide it.
        visibility: what cameras should see.
    """
    found = _recognised(solids, among, visibility)
    open_ = [place for place, there in enumerate(found) if max(there.values(), default=0.0) >= ROUNDING]
    around = [_moved(solids[place], *shift) for place in open_ for shift in _POINTS]
    told = _recognised(around, among, visibility) if around else []
    for number, place in enumerate(open_):
        shares: dict[str, float] = defaultdict(float)
        for by_camera in told[number * len(_POINTS) : (number + 1) * len(_POINTS)]:
            for camera, share in by_camera.items():
                shares[camera] += share / len(_POINTS)
        found[place] = dict(shares)
    return found


def _moved(solid: Solid, dx: float, dy: float) -> Solid:
    x, y, z = solid.position
    return solid.moved((x + dx, y + dy, z))


def _recognised(solids: Sequence[Solid], among: Sequence[Solid], visibility: VisibilityQuery) -> list[dict[str, float]]:
    visible = visibility(solids, among)
    return [{camera: one.recognised for camera, one in by_camera.items()} for by_camera in visible]
