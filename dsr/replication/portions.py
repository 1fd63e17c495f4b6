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
    """Names of the parts that a delta is about: those of additions first."""
    return list(dict.fromkeys(map(part_of, _named(delta))))


def _named(delta: Delta) -> Iterable[str]:
    """Replica ids of all dots that a delta changes or accounts for, each once."""
    rids = dict.fromkeys([add.dot[0] for add in delta.adds])
    rids |= dict.fromkeys([write.owner[0] for write in delta.writes])
    rids |= dict.fromkeys([dot[0] for write in delta.writes if (dot := write.dot) is not None])
    for dots in (delta.removed, delta.context, delta.examined or ()):
        rids |= dict.fromkeys([each[0] for each in dots])
    return rids
