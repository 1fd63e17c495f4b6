"""What the close-up shows: the objects that lie or stand somewhere, and where they have been before."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

from agents.viewer.model import DrawnSolid, Vector
from dsr.vocabulary.relations import THINGS

_AROUND = 0.05  # m around the objects in the first view: beliefs of things at rest change a little, too
_AHEAD = 0.15  # m by which the view grows beyond what left it: while things move on, the view stands still
_UP = 0.06  # m from what the lowest object rests on to the middle of the view: for towers and what is lifted
_NEAREST = 0.46  # m from the eye to the middle: for four cubes on a table
_EYE = 1.4  # distance of the eye over the radius of what it sees, for rerun's angle of view and labels beside


class Focus(NamedTuple):
    """Where the eye of the close-up looks."""

    at: Vector
    """m, in the world's frame"""
    distance: float
    """m, from the eye to there"""


ANYWHERE = Focus((0.35, 0.0, _UP), _NEAREST)
"""Before any object is known: where an arm that stands at the origin works."""


class Framing:
    """Collects where objects are; what is in a hand, or fell off its table, is not waited for."""

    def __init__(self) -> None:
        self.focus = ANYWHERE
        self._lower = [math.inf] * 2
        self._upper = [-math.inf] * 2

    def note(self, beliefs: Iterable[DrawnSolid], tables: Iterable[DrawnSolid]) -> None:
        """Let the close-up show these objects, too.

        Args:
            beliefs: the objects.
            tables: on which they are.
        """
        bases = list(tables)
        resting = [solid for solid in beliefs if solid.type in THINGS and not solid.held]
        on_tables = [solid for solid in resting if not bases or any(_is_above(solid, table) for table in bases)]
        lower, upper = list(self._lower), list(self._upper)
        for solid in on_tables:
            half = math.hypot(*solid.size[:2]) / 2
            for axis, value in enumerate(solid.place.translation[:2]):
                lower[axis] = min(lower[axis], value - half)
                upper[axis] = max(upper[axis], value + half)
        if lower != self._lower or upper != self._upper:
            self._grow(lower, upper, min(solid.place.translation[2] - solid.size[2] / 2 for solid in on_tables))

    def _grow(self, lower: list[float], upper: list[float], height: float) -> None:
        ahead = _AROUND if self.focus is ANYWHERE else _AHEAD
        self._lower = [new - ahead if new < old else old for new, old in zip(lower, self._lower, strict=True)]
        self._upper = [new + ahead if new > old else old for new, old in zip(upper, self._upper, strict=True)]
        x, y = ((low + high) / 2 for low, high in zip(self._lower, self._upper, strict=True))
        self.focus = Focus((x, y, height + _UP), max(_NEAREST, _EYE * math.dist(self._lower, self._upper) / 2))


def _is_above(solid: DrawnSolid, table: DrawnSolid) -> bool:
    (x, y, z), (table_x, table_y, table_z) = solid.place.translation, table.place.translation
    reach = math.hypot(*table.size[:2]) / 2
    return z >= table_z and math.dist((x, y), (table_x, table_y)) <= reach
