"""What a group of rows is, and what it tells while it measures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib.util import find_spec
from typing import Any, NamedTuple, TypeVar

import msgspec

from benchmarks.rows import Peer, Row, Spec, judged

T = TypeVar("T")


class Step(msgspec.Struct, frozen=True, tag=True):
    """What is being measured now."""

    text: str


class Measured(msgspec.Struct, frozen=True, tag=True):
    """A row is ready."""

    row: Row


class Curve(msgspec.Struct, frozen=True, tag=True):
    """Data for a plot: plain numbers, lists and dictionaries."""

    name: str
    data: Any


class Missing(msgspec.Struct, frozen=True, tag=True):
    """A peer that is not installed."""

    module: str


Message = Step | Measured | Curve | Missing


class Run:
    """One run of a group: how thorough it is, and where its findings go."""

    def __init__(self, tell: Callable[[Message], None], *, quick: bool = False) -> None:
        self._tell = tell
        self.quick = quick

    def pick(self, thorough: T, quick: T) -> T:
        """One of two counts, by how thorough the run is."""
        return quick if self.quick else thorough

    def step(self, text: str) -> None:
        """Say what is measured next."""
        self._tell(Step(text))

    def row(self, spec: Spec, value: float, peers: Sequence[Peer] = (), note: str = "") -> None:
        """Report a row; the first of `peers` is the one to be compared with."""
        self._tell(Measured(judged(spec, value, peers, note)))

    def curve(self, name: str, data: Any) -> None:
        """Report data for the plot of this name."""
        self._tell(Curve(name, data))

    def has(self, module: str) -> bool:
        """Whether a peer's module is installed; else that is reported."""
        if find_spec(module) is not None:
            return True
        self._tell(Missing(module))
        return False


class Group(NamedTuple):
    """Rows that are measured together, in processes of their own."""

    name: str
    specs: Sequence[Spec]
    measure: Callable[[Run], None]
