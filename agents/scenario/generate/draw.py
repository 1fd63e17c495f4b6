"""The source of all chance of an episode: draws numbers, directions and choices from one seed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, TypeVar

import numpy as np

Item = TypeVar("Item")
_DIGITS = 4  # of lengths in m, angles in rad and speeds: files stay readable, and 0.1 mm is finer than any sensor here


class NumberRange(NamedTuple):
    """The bounds of a number that is drawn uniformly."""

    low: float
    high: float


class Draw:
    """Draws from the random numbers of one episode.

    Args:
        family: name of the family.
        seed: of the episode.
        attempt: number of the draws that were thrown away before this one.
    """

    def __init__(self, family: str, seed: int, attempt: int) -> None:
        self._rng = np.random.default_rng([*family.encode(), seed, attempt])

    def number(self, bounds: NumberRange) -> float:
        """A number within some bounds, in their unit, rounded."""
        return round(float(self._rng.uniform(*bounds)), _DIGITS)

    def factor(self, bounds: NumberRange) -> float:
        """A positive number whose logarithm is uniform: of what varies by orders of magnitude."""
        low, high = map(math.log, bounds)
        return round(math.exp(float(self._rng.uniform(low, high))), _DIGITS)

    def count(self, low: int, high: int) -> int:
        """A whole number from `low` to `high`, both included."""
        return int(self._rng.integers(low, high + 1))

    def chance(self, share: float = 0.5) -> bool:
        """True in that share of the draws."""
        return bool(self._rng.random() < share)

    def one_of(self, items: Sequence[Item]) -> Item:
        """One of some items."""
        return items[int(self._rng.integers(len(items)))]

    def some_of(self, items: Sequence[Item], count: int) -> list[Item]:
        """So many different ones of some items, in any order; all if there are fewer."""
        return [items[index] for index in self._rng.permutation(len(items))[:count].tolist()]

    def angle(self) -> float:
        """A direction in the plane, rad, from -pi to pi."""
        return self.number(NumberRange(-math.pi, math.pi))

    def direction(self) -> tuple[float, float]:
        """A unit vector in the plane."""
        angle = self.angle()
        return round(math.cos(angle), _DIGITS), round(math.sin(angle), _DIGITS)

    def within(self, radius: float) -> tuple[float, float]:
        """A point of the disc of that radius (m) about the origin."""
        distance = radius * math.sqrt(float(self._rng.random()))
        x, y = self.direction()
        return round(distance * x, _DIGITS), round(distance * y, _DIGITS)
