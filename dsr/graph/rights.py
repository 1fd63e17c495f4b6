"""What others take of a change that is made here: of an element that several have made, each may have another type."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol

from dsr.crdt.context import Dot
from dsr.crdt.store import Incarnation


class Incarnations(Protocol):
    """Where incarnations are found by their creation dots."""

    def element(self, dot: Dot) -> Incarnation | None:
        """Find the live node or edge under `dot`; None if there is none."""

    def is_known(self, dot: Dot) -> bool:
        """Whether `dot` was seen: its element is here, or was removed."""


class Rights(Protocol):
    """Tells what a replica may change."""

    def may_write(self, rid: str, entry: Incarnation, attributes: Iterable[str]) -> bool:
        """Whether replica `rid` may write these attributes of one incarnation."""

    def removable(self, rid: str, dots: list[Dot], elements: Incarnations) -> list[Dot]:
        """Select those of `dots` that replica `rid` may remove together."""

    def may_describe(self, rid: str, what: str, name: str) -> bool:
        """Whether replica `rid` may tell what a name means: that of a type of nodes or edges, or of an attribute."""
