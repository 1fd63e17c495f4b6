"""Hysteresis: a relation that began to hold goes on until it is clearly over, in spite of noise; pure."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping
from typing import Generic, TypeVar

Key = TypeVar("Key", bound=Hashable)


class Hysteresis(Generic[Key]):
    """Decides which relations hold, by their margins: from a margin of 0 on, until the margin falls below -`band`.

    Margins that never vary by more than `band` change nothing after the first look.

    Args:
        band: m.
        holding: what holds already, as after a restart.
    """

    def __init__(self, band: float = 0.01, holding: Iterable[Key] = ()) -> None:
        if not band >= 0.0:
            raise ValueError(f"band {band}: expected 0 or more")
        self._band = band
        self._holding = frozenset(holding)

    @property
    def holding(self) -> frozenset[Key]:
        """The keys that hold."""
        return self._holding

    def update(self, margins: Mapping[Key, float]) -> frozenset[Key]:
        """Take in new margins by key, and return the keys that hold now. A key without a margin does not hold."""
        self._holding = frozenset(
            key for key, margin in margins.items() if margin >= (-self._band if key in self._holding else 0.0)
        )
        return self._holding
