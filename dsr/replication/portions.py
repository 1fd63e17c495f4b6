"""The portion of a change that is of one part of a graph (dsr/parts): the replica id in each dot names its part."""

from __future__ import annotations

from collections.abc import Iterable

from dsr.crdt.context import Dot, DotRange
from dsr.crdt.delta import Delta
from dsr.network.keys import part_of


def portion(delta: Delta, part: str) -> Delta:
    """The portion of a delta that is about one part; the ends of an edge may be in any."""

    def mine(dot: Dot | DotRange) -> bool:
        return part_of(dot[0]) == part

    return Delta(
        [add for add in delta.adds if mine(add.dot)],
        [write for write in delta.writes if mine(write.owner) and (write.dot is None or mine(write.dot))],
        [dot for dot in delta.removed if mine(dot)],
        [dots for dots in delta.context if mine(dots)],
        None if delta.live is None else frozenset(dot for dot in delta.live if mine(dot)),
        None if delta.examined is None else [dots for dots in delta.examined if mine(dots)],
    )


def parts_in(delta: Delta) -> list[str]:
    """Names of the parts that a delta is about, in the order of their first mention."""
    return list(dict.fromkeys(part_of(rid) for rid in _named(delta)))


def _named(delta: Delta) -> Iterable[str]:
    """Replica ids of all dots that a delta changes or accounts for."""
    for add in delta.adds:
        yield add.dot[0]
    for write in delta.writes:
        yield write.owner[0]
        if write.dot is not None:
            yield write.dot[0]
    for dot in delta.removed:
        yield dot[0]
    for rid, _, _ in delta.context:
        yield rid
    for rid, _, _ in delta.examined or ():
        yield rid
