"""The relations isIn and isOnTop from axis-parallel boxes around things, with hysteresis (Sallami et al., Sec. IV-C).

They need neither contacts nor shapes, and are as coarse as that: a thing that leans against a box is not told from one
that lies on it, and whatever is beneath a box turned upside down is in it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from dsr.math3d.quaternions import Vector3, to_matrix
from dsr.math3d.transforms import Pose

EPSILON = 0.015
"""m by which a bound may be missed (published)"""

Pair = tuple[str, str]


class WorldBox(NamedTuple):
    """A box along the axes of the world."""

    low: Vector3
    """Least x, y and z, m."""
    high: Vector3


def world_box(size: Vector3, pose: Pose) -> WorldBox:
    """Around a box of edge lengths `size` (m) at `pose` (world_from_centre)."""
    rows = to_matrix(pose.q)
    x, y, z = (0.5 * sum(abs(part) * edge for part, edge in zip(row, size, strict=True)) for row in rows)
    cx, cy, cz = pose.t
    return WorldBox((cx - x, cy - y, cz - z), (cx + x, cy + y, cz + z))


def is_in(inner: WorldBox, outer: WorldBox, held_before: bool = False, epsilon: float = EPSILON) -> bool:
    """Whether `inner` stands inside of `outer`: its outline within the other's, its bottom between bottom and top.

    A relation that `held_before` ends only `epsilon` m beyond where it begins.
    """
    slack = epsilon if held_before else 0.0
    within = all(
        inner.low[k] >= outer.low[k] - slack and inner.high[k] <= outer.high[k] + slack for k in (0, 1)
    )  # fmt: skip
    return within and outer.low[2] - epsilon <= inner.low[2] <= outer.high[2] - epsilon + slack


def is_on_top(upper: WorldBox, lower: WorldBox, held_before: bool = False, epsilon: float = EPSILON) -> bool:
    """Whether `upper` stands on `lower`: its bottom at the other's top, up to `epsilon` m, and the outlines overlap.

    A relation that `held_before` ends only `epsilon` m beyond where it begins.
    """
    slack = epsilon if held_before else 0.0
    overlap = min(min(upper.high[k], lower.high[k]) - max(upper.low[k], lower.low[k]) for k in (0, 1))
    return overlap > epsilon - slack and abs(upper.low[2] - lower.high[2]) <= epsilon + slack


class BoxRelations:
    """Relations between named boxes that begin and end as the boxes move.

    Args:
        epsilon: m, see `is_in` and `is_on_top`.
    """

    def __init__(self, epsilon: float = EPSILON) -> None:
        self._epsilon = epsilon
        self.inside: dict[Pair, float] = {}
        """(thing, container) and since when (s)"""
        self.on_top: dict[Pair, float] = {}
        """(thing, what it stands on) and since when (s)"""

    def update(self, things: Mapping[str, WorldBox], fixtures: Mapping[str, WorldBox], now: float) -> None:
        """Take in where everything is at `now` (s). Fixtures carry things, but contain nothing."""
        names = sorted(things)
        inside = [
            (name, other)
            for name in names
            for other in names
            if name != other and is_in(things[name], things[other], (name, other) in self.inside, self._epsilon)
        ]
        self.inside = {pair: self.inside.get(pair, now) for pair in inside}
        below = {**fixtures, **things}
        on_top = [
            (name, other)
            for name in names
            for other in sorted(below)
            if name != other and is_on_top(things[name], below[other], (name, other) in self.on_top, self._epsilon)
        ]
        self.on_top = {pair: self.on_top.get(pair, now) for pair in on_top}

    def contents(self, name: str) -> tuple[str, ...]:
        """What is directly said to be in `name`, sorted."""
        return tuple(inner for inner, outer in sorted(self.inside) if outer == name)

    def recall(self, pair: Pair, since: float) -> None:
        """Take over that a thing has stood on another one since `since` (s)."""
        self.on_top[pair] = since

    def recall_contents(self, pair: Pair, since: float) -> None:
        """Take over that a thing has been in another one since `since` (s)."""
        self.inside[pair] = since

    def forget(self, name: str) -> None:
        """End all relations of a thing that is no more."""
        self.inside = {pair: since for pair, since in self.inside.items() if name not in pair}
        self.on_top = {pair: since for pair, since in self.on_top.items() if name not in pair}
