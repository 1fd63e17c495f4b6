"""Where arrows that pass a column, and labels in a gap, find room: the nearest free place, at little cost for each."""

from __future__ import annotations

import math
from bisect import bisect_right, insort
from collections.abc import Sequence
from typing import NamedTuple

LINE = 24.0
"""px, from one line of a label to the next: lines do not touch in a drawing that is shrunk by a quarter."""
BESIDE = 4.0
"""px between arrows that run side by side"""
_ABOVE, _BELOW = 12.0, 34.0
"""px from the middle of a node to the nearest arrow that passes, for arrow heads and label"""
_LABEL_HEIGHT = 22.0
"""px"""


class Column(NamedTuple):
    """A column of nodes, as wide as their labels."""

    left: float
    right: float
    gap: float
    """To the next column."""
    rows: tuple[float, ...]
    """y of each node."""
    lines: int = 1
    """Of the labels, at most."""

    @property
    def middle(self) -> float:
        """The x of its nodes."""
        return (self.left + self.right) / 2


class FreeLevels:
    """The levels at which arrows can pass a column: they hide neither nodes nor labels nor other arrows."""

    def __init__(self, column: Column) -> None:
        self._rows = column.rows
        self._below = _BELOW + LINE * (column.lines - 1)
        self._beyond: dict[int, dict[int, int]] = {1: {}, -1: {}}
        """By direction, for levels that are not free one beyond them, all up to which are not free either."""

    def take(self, wanted: float) -> float:
        """The free level (y, px) that is nearest to the wanted one; it is not free any more."""
        level = round(wanted / BESIDE)
        after, before = self._next(level, 1), self._next(level, -1)
        found = after if after - level <= level - before else before
        for side, beyond in self._beyond.items():
            beyond[found] = found + side
        return BESIDE * found

    def _next(self, level: int, side: int) -> int:
        """The first free level from one on, to one side."""
        beyond, passed = self._beyond[side], []
        while level in beyond or self._is_hidden(level):
            passed.append(level)
            level = beyond.get(level, level + side)
        beyond.update(dict.fromkeys(passed, level))
        return level

    def _is_hidden(self, level: int) -> bool:
        """Whether a node or its label is there."""
        y = BESIDE * level
        place = bisect_right(self._rows, y - self._below)
        return place < len(self._rows) and self._rows[place] < y + _ABOVE


class FreeHeights:
    """The heights at which labels can stand in one gap without covering one another."""

    def __init__(self) -> None:
        self._runs: list[tuple[float, float]] = []
        """The first and the last label of each run, between whose labels there is no room for another one."""

    def take(self, heights: Sequence[float], most: int) -> float:
        """A free height (px): one of these, or a place near the first one that is fewer than `most` labels away."""
        y = next((height for height in heights if self._run_at(height) is None), None)
        if y is None:
            steps = [(step, sign) for sign in (1, -1) if (step := self._steps(heights[0], sign)) < most]
            step, sign = min(steps, key=lambda one: (one[0], -one[1]), default=(0, 1))
            y = heights[0] + sign * step * _LABEL_HEIGHT
        self._add(y)
        return y

    def _steps(self, height: float, sign: int) -> int:
        """How many labels away there is room, to one side."""
        step = 1
        while (run := self._run_at(height + sign * step * _LABEL_HEIGHT)) is not None:
            end = run[1] if sign > 0 else run[0]
            step = max(step + 1, math.floor(abs(end - height) / _LABEL_HEIGHT))
        return step

    def _run_at(self, y: float) -> tuple[float, float] | None:
        """The run that a label at this height would touch."""
        touched = (run for run in self._near(y) if y - run[1] < _LABEL_HEIGHT and run[0] - y < _LABEL_HEIGHT)
        return next(touched, None)

    def _add(self, y: float) -> None:
        """A label stands there from now on."""
        first = last = y
        near = [run for run in self._near(y) if run[0] - y < 2 * _LABEL_HEIGHT and y - run[1] < 2 * _LABEL_HEIGHT]
        for run in near:
            self._runs.remove(run)
            first, last = min(first, run[0]), max(last, run[1])
        insort(self._runs, (first, last))

    def _near(self, y: float) -> list[tuple[float, float]]:
        """The runs before and behind a height."""
        place = bisect_right(self._runs, (y, math.inf))
        return self._runs[max(0, place - 1) : place + 1]
