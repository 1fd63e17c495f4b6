"""What things may lie on, asked about many places at once."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from simulation_handler.shapes.geometry import Solid
from simulation_handler.state.bodies import FLOOR

Array = NDArray[np.float64]


class Lying(NamedTuple):
    """Where a thing lies at each of some places."""

    heights: Array
    """(n,) m, world z of its centre"""
    carriers: NDArray[np.intp]
    """(n,) numbers of what carries it there, of `Carriers.names`"""


class Carriers:
    """All that a thing may lie on: the pieces of fixtures and things.

    Args:
        solids: what may carry.
    """

    def __init__(self, solids: Sequence[Solid]) -> None:
        parts = [part for solid in solids for part in solid.parts]
        self.names = (*(part.name for part in parts), FLOOR)
        """Of each piece, its body's; the last one carries what nothing is known to carry"""
        self._of: dict[str, list[int]] = {}
        for number, name in enumerate(self.names[:-1]):
            self._of.setdefault(name, []).append(number)
        self._tops = np.array([part.top for part in parts])
        self._bottoms = np.array([part.bottom for part in parts])
        self._fixed = np.array([part.fixed for part in parts], dtype=bool)
        self._centres = np.array([part.position[:2] for part in parts]).reshape(-1, 2)
        self._radii = np.array([part.radius for part in parts])
        self._normals, self._offsets = _half_planes([part.footprint for part in parts])

    def lying(self, solid: Solid, places: Array, without: Collection[str] = ()) -> Lying:
        """Where a thing lies that is brought to places: on what is highest there.

        It is not brought up on a fixture that is higher than it was, nor on anything that is on such a fixture. In what
        is hollow, it lies on the floor of that.

        Args:
            solid: the thing where it was, a face down. Where nothing carries it, it is as high as there.
            places: (n, 2) m, world.
            without: names of what does not carry it.
        """
        found = Lying(np.full(len(places), solid.position[2]), np.full(len(places), len(self.names) - 1))
        may = self._reaching(solid, places)
        for name in without:
            may[self._of.get(name, [])] = False
        numbers = np.flatnonzero(may)
        if not len(numbers):
            return found
        normals, offsets = self._normals[:, numbers], self._offsets[:, numbers]
        sides = (places @ normals.reshape(-1, 2).T).reshape(len(places), *offsets.shape) + offsets
        tops = np.where(sides.min(axis=1) >= 0.0, self._tops[numbers], -math.inf)
        highest = tops.argmax(axis=1)
        level = tops[np.arange(len(places)), highest]
        is_on = level > -math.inf
        found.heights[is_on] = level[is_on] + solid.half_height
        found.carriers[is_on] = numbers[highest[is_on]]
        return found

    def _reaching(self, solid: Solid, places: Array) -> NDArray[np.bool_]:
        """(n,) which pieces are low enough, and near at least one of the places."""
        low = self._tops < solid.position[2] + solid.half_height
        above = self._tops[self._fixed & ~low]
        ceiling = above.min() if len(above) else math.inf
        middle = 0.5 * (places.min(axis=0) + places.max(axis=0))
        reach = self._radii + np.linalg.norm(places - middle, axis=1).max()
        near = ((self._centres - middle) ** 2).sum(axis=1) <= reach**2
        return np.asarray(near & np.where(self._fixed, low, self._bottoms < ceiling))


def _half_planes(outlines: Sequence[Sequence[tuple[float, float]]]) -> tuple[Array, Array]:
    """Normals (k, n, 2) and offsets (k, n) of the edges of outlines: inside, normal @ point + offset is at least 0."""
    most = max(map(len, outlines), default=0)
    filled = [[*outline, *[outline[-1]] * (most - len(outline))] for outline in outlines]
    ends = np.array(filled).reshape(len(outlines), most, 2).transpose(1, 0, 2)
    starts = np.roll(ends, 1, axis=0)
    along = ends - starts
    normals = np.stack((-along[..., 1], along[..., 0]), axis=-1)
    return normals, -(normals * starts).sum(axis=-1)
