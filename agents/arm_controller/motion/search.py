"""Searches a way through joint space where simple ways are blocked, and shortens it.

Two trees of free ways grow from both ends towards each other (J. Kuffner, S. LaValle, "RRT-Connect: An Efficient
Approach to Single-Query Path Planning", ICRA 2000). How long that takes has a heavy tail: on the same problem it is
over after 90 branches, or not after 1500, as luck has it. So the trees are begun anew, with more patience each time
(N. Wedge, M. Branicky, "On Heavy-tailed Runtimes and Restarts in Rapidly-exploring Random Trees", AAAI 2008
workshop). Whatever is found is cut short between points at random
(R. Geraerts, M. Overmars, "Creating High-quality Paths for Motion Planning", IJRR 2007). Many points are checked at
once.

OMPL has the same methods. Its random numbers have one seed for a whole process, which is set before their first use, so
that no run could be repeated. `python -m benchmarks.motion` compares both.
"""

from __future__ import annotations

from collections.abc import Callable, Generator

import numpy as np
from numpy.typing import NDArray

from agents.arm_controller.motion.trajectory import SPACING

Array = NDArray[np.float64]
Free = Callable[[Array], NDArray[np.bool_]]
"""Tells which of joint positions (m, n) are free, (m,)."""
Draw = Callable[[], Array]
"""Gives joint positions (n,) at random."""

LONGEST = 1.5
"""rad along the joint with the largest motion, of one branch of a tree: longer ones are blocked nearly always"""
CHUNK = 24
"""Points that are checked at once: as many as double the time of a check of one"""
SHORTCUTS = 60
"""Shortcuts that are tried: further ones make ways shorter by less than 1 % on average"""

FIRST = 100
"""Branches of the first pair of trees: enough for four of five problems. Half or twice as many do as well"""
LONGER = 1.5
"""How many times as many branches the next pair has: most of a search is in its last ones, however long it takes"""

Search = Generator[None, None, Array]
"""Yields after each piece of work of some ms, for ever if there is no way; returns a way (k, n) rad."""


class _Tree:
    """Free ways from one point, as points with their parents."""

    def __init__(self, root: Array) -> None:
        self.points = root[None]
        self._parents = [-1]

    def nearest(self, point: Array) -> int:
        return int(((self.points - point) ** 2).sum(axis=1).argmin())

    def add(self, point: Array, parent: int) -> int:
        self.points = np.vstack([self.points, point])
        self._parents.append(parent)
        return len(self._parents) - 1

    def way(self, index: int) -> Array:
        """(k, n) from the root to the point."""
        found = []
        while index >= 0:
            found.append(index)
            index = self._parents[index]
        return np.asarray(self.points[found[::-1]])


def search(start: Array, goal: Array, free: Free, draw: Draw) -> Search:
    """Find a free way from `start` (n,) to `goal` (n,), both free; a polyline, straight in between.

    Args:
        start: rad or m.
        goal: rad or m.
        free: judges points.
        draw: draws points to grow towards.
    """
    branches = float(FIRST)
    while (found := (yield from _by_trees(start, goal, free, draw, int(branches)))) is None:
        branches *= LONGER
    return found


def _by_trees(
    start: Array, goal: Array, free: Free, draw: Draw, most: int
) -> Generator[None, None, Array | None]:
    """A way by one pair of trees with so many branches; None if they do not meet."""
    trees = (_Tree(start), _Tree(goal))
    for number in range(most):
        here, there = trees if number % 2 == 0 else trees[::-1]
        wanted = there.points[0] if number < 2 else draw()
        grown = _grow(here, wanted, free, LONGEST)
        yield
        if grown is None:
            continue
        other = _grow(there, here.points[grown], free, np.inf)
        yield
        if other is not None and np.array_equal(there.points[other], here.points[grown]):
            ways = (here.way(grown), there.way(other)[::-1][1:])
            found = np.vstack(ways)
            return found if here is trees[0] else found[::-1]
    return None


def _grow(tree: _Tree, wanted: Array, free: Free, longest: float) -> int | None:
    """Add the last free point on the straight line from the nearest point; None if the line is blocked at once."""
    nearest = tree.nearest(wanted)
    root = tree.points[nearest]
    rows = _line(root, wanted, longest)
    good = _free_points(rows, free)
    return None if good == 0 else tree.add(rows[good - 1], nearest)


def _line(start: Array, end: Array, longest: float = np.inf) -> Array:
    """(k, n) points from `start`, without that, to `end` or as far as is allowed."""
    length = float(np.abs(end - start).max())
    count = max(1, int(np.ceil(length / SPACING)))
    kept = count if length <= longest else max(1, int(longest / SPACING))
    shares = np.arange(1, kept + 1) / count
    rows = start + shares[:, None] * (end - start)
    if kept == count:
        rows[-1] = end
    return np.asarray(rows)


def _free_points(rows: Array, free: Free) -> int:
    """How many points are free before the first one that is not."""
    for begin in range(0, len(rows), CHUNK):
        good = free(rows[begin : begin + CHUNK])
        if not good.all():
            return begin + int(np.argmin(good))
    return len(rows)


def shortened(way: Array, free: Free, rng: np.random.Generator, tries: int = SHORTCUTS) -> Search:
    """The way (k, n) cut short where that is free: between corners first, then between points at random.

    Args:
        way: polyline, straight in between; free.
        free: judges points.
        rng: draws points.
        tries: shortcuts at random.
    """
    first = 0
    while first < len(way) - 2:
        for last in range(len(way) - 1, first + 1, -1):
            yield
            if is_free(way[first], way[last], free):
                way = np.vstack([way[: first + 1], way[last:]])
                break
        first += 1
    for _ in range(tries if len(way) > 2 else 0):
        yield
        way = _cut(way, free, np.sort(rng.uniform(0.0, 1.0, 2)))
        if len(way) == 2:
            break
    return way


def _cut(way: Array, free: Free, shares: Array) -> Array:
    """The way, straight between the points at two shares of its length if that is free."""
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))])
    one, other = shares * lengths[-1]
    before, after = int(np.searchsorted(lengths, one)), int(np.searchsorted(lengths, other))
    if before == after:  # both on one straight piece
        return way
    ends = np.array([[np.interp(at, lengths, joint) for joint in way.T] for at in (one, other)])
    if not is_free(ends[0], ends[1], free):
        return way
    return np.vstack([way[:before], ends, way[after:]])


def is_free(start: Array, end: Array, free: Free) -> bool:
    """Tell whether the straight line between joint positions (n,) is free; points far apart are checked first."""
    rows = _line(start, end)
    order = np.argsort(np.arange(len(rows)) % max(1, len(rows) // CHUNK), kind="stable")
    return _free_points(rows[order], free) == len(rows)
