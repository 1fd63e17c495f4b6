"""One change in as many parts as it concerns: each dot is of the replica of the part that it belongs to."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from dsr.crdt.context import Dot, to_ranges
from dsr.crdt.delta import Add, Delta, Write
from dsr.graph.graph import Graph
from dsr.network.keys import part_of


class Changes:
    """One change here.

    Args:
        member: gives the replica of a part, or raises if it may not be written to.
        adds: what is created, each under a dot of its part.
    """

    def __init__(self, member: Callable[[str], Graph], adds: list[Add] | None = None) -> None:
        self._member = member
        self.adds = adds or []
        self._writes: list[Write] = []
        self._removed: list[Dot] = []
        self._dots: list[Dot] = [add.dot for add in self.adds]

    def write(self, owner: Dot, attribute: str, stamp: int, value: Any, *, stream: bool = False) -> None:
        """Write an attribute of one incarnation; as a sample of a stream, without a dot."""
        member = self._member(part_of(owner[0]))
        dot = None if stream else member.new_dot()
        self._writes.append(Write(owner, attribute, stamp, member.rid, dot, value))
        if dot is not None:
            self._dots.append(dot)

    def remove(self, dots: list[Dot]) -> None:
        """Remove incarnations, with one dot in each part."""
        self._removed += dots
        self._dots += [self._member(part).new_dot() for part in dict.fromkeys(part_of(rid) for rid, _ in dots)]

    def delta(self) -> Delta:
        """All of it; `portion` tells what is of which part."""
        dots = {*self._dots, *(add.dot for add in self.adds)}
        return Delta(self.adds, self._writes, self._removed, list(to_ranges(dots)))
