"""How probably cameras recognise an unseen thing at the places where it may be, not at one exact place."""

from __future__ import annotations

import math
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
) -> list[dict[str, tuple[float, ...]]]:
    """Probabilities (0 to 1) with which each camera recognises an unseen object, by the camera's name.

    There is one for each of the places where the object may be, all as probable: through a gap, 10 mm make all the
    difference. Only an object that no camera sees right there counts as hidden, and has that one place.

    Args:
        solids: objects, each where it is believed to be; or places where one may be.
        among: all that may hide them; what has the name of an object does not hide it.
        visibility: what cameras should see.
    """
    here = _recognised(solids, among, visibility)
    found: list[dict[str, tuple[float, ...]]] = [{camera: (one,) for camera, one in there.items()} for there in here]
    open_ = [place for place, there in enumerate(here) if max(there.values(), default=0.0) >= ROUNDING]
    around = [_moved(solids[place], *shift) for place in open_ for shift in _POINTS]
    told = _recognised(around, among, visibility) if around else []
    for number, place in enumerate(open_):
        about = told[number * len(_POINTS) : (number + 1) * len(_POINTS)]
        cameras = {camera: None for by_camera in about for camera in by_camera}
        found[place] = {camera: tuple(by_camera.get(camera, 0.0) for by_camera in about) for camera in cameras}
    return found


def _moved(solid: Solid, dx: float, dy: float) -> Solid:
    x, y, z = solid.position
    return solid.moved((x + dx, y + dy, z))


def _recognised(solids: Sequence[Solid], among: Sequence[Solid], visibility: VisibilityQuery) -> list[dict[str, float]]:
    visible = visibility(solids, among)
    return [{camera: one.recognised for camera, one in by_camera.items()} for by_camera in visible]
