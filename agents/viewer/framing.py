"""What the close-up shows: the objects that lie or stand somewhere, and where they have been before."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

from agents.viewer.model import DrawnSolid, Vector
from dsr.vocabulary.relations import THINGS

_STEP = 0.1  # m by which the part that is shown grows: the view stands still while things move a little
_NEAREST = 0.46  # m from the eye to the middle: for four cubes on a table
_EYE = 2.4  # distance of the eye over the radius of what it sees, for rerun's angle of view and labels beside


class Focus(NamedTuple):
    """Where the eye of the close-up looks."""

    at: Vector
    """m, in the world's frame"""
    distance: float
    """m, from the eye to there"""


ANYWHERE = Focus((0.35, 0.0, 0.0), _NEAREST)
"""Before any object is known: where an arm that stands at the origin works."""


class Framing:
    """Collects where objects are; what is in a hand, or fell off its table, is not waited for."""

    def __init__(self) -> None:
        self.focus = ANYWHERE
        self._lower = [math.inf] * 3
        self._upper = [-math.inf] * 3

    def note(self, beliefs: Iterable[DrawnSolid], tables: Iterable[DrawnSolid]) -> None:
        """Let the close-up show these objects, too.

        Args:
            beliefs: the objects.
            tables: on which they are.
        """
        bases = list(tables)
        resting = [solid for solid in beliefs if solid.type in THINGS and not solid.held]
        on_tables = [solid for solid in resting if not bases or any(_is_above(solid, table) for table in bases)]
        before = [*self._lower, *self._upper]
        for solid in on_tables:
            half = math.hypot(*solid.size[:2]) / 2
            for axis, value in enumerate(solid.place.translation):
                self._lower[axis] = min(self._lower[axis], _STEP * math.floor((value - half) / _STEP))
                self._upper[axis] = max(self._upper[axis], _STEP * math.ceil((value + half) / _STEP))
        if [*self._lower, *self._upper] != before:
            x, y, z = ((low + high) / 2 for low, high in zip(self._lower, self._upper, strict=True))
            self.focus = Focus((x, y, z), max(_NEAREST, _EYE * math.dist(self._lower[:2], self._upper[:2]) / 2))


def _is_above(solid: DrawnSolid, table: DrawnSolid) -> bool:
    (x, y, z), (table_x, table_y, table_z) = solid.place.translation, table.place.translation
    reach = math.hypot(*table.size[:2]) / 2
    return z >= table_z and math.dist((x, y), (table_x, table_y)) <= reach
