"""Wrong designs of parts: some history must fail with each.

Each is put in alone, in the place of a right one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple
from unittest import mock

from benchmarks.interest.histories import Setting, run
from dsr.crdt.context import Dot
from dsr.crdt.store import Incarnation, Observer
from dsr.network import keys
from dsr.parts import graph, held
from dsr.parts.graph import PartedGraph
from dsr.parts.store import PartStore


class Mutant(NamedTuple):
    """A wrong design in the place of a right one."""

    title: str
    """What is wrong."""
    target: Any
    name: str
    wrong: Callable[[Any], Any]
    """Makes the wrong one of the right one."""


def _known_without_the_part(right: Any) -> Any:
    """What is in a part that is not held counts as seen, so its absence as a removal."""

    def is_known(self: PartedGraph, dot: Dot) -> bool:
        part = keys.part_of(dot[0])
        return bool((part and part not in self.parts) or right(self, dot))

    return is_known


def _emptied(right: Any) -> Any:
    """A part that was left answers with its context and nothing in it."""

    def detach(self: PartStore) -> list[Incarnation]:
        entries: list[Incarnation] = right(self)
        self.entries = {}
        self.forget_order()
        return entries

    return detach


def _never_buried(right: Any) -> Any:
    return lambda self, delta, member: delta


def _one_id_for_ever(right: Any) -> Any:
    """Who asks for a part again goes on as the replica that it was, with new counters."""
    return lambda rid, part, number: right(rid, part, 1)


def _told_nothing(right: Any) -> Any:
    """A part that is left stays in sight."""

    def leave(self: PartedGraph, part: str) -> None:
        member = self.parts.pop(part)
        self.leaving.discard(part)
        member.store._observer = Observer()

    return leave


def _all_of_the_base(right: Any) -> Any:
    return lambda delta: [keys.WHOLE]


MUTANTS = (
    Mutant("what is not held counts as removed", PartedGraph, "is_known", _known_without_the_part),
    Mutant("a part that was left answers as if it were empty", PartStore, "detach", _emptied),
    Mutant("edges into other parts are never buried", PartedGraph, "with_burials", _never_buried),
    Mutant("counters are used again in a part", held, "part_rid", _one_id_for_ever),
    Mutant("a part that is left stays in sight", PartedGraph, "leave", _told_nothing),
    Mutant("changes are all of the base", graph, "parts_in", _all_of_the_base),
)


def shown_by(mutant: Mutant, seeds: Iterable[int]) -> int | None:
    """The first of these seeds whose history fails with a mutant; None if none does."""
    with mock.patch.object(mutant.target, mutant.name, mutant.wrong(getattr(mutant.target, mutant.name))):
        return next((seed for seed in seeds if run(Setting(seed)).problem), None)

