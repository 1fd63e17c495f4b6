"""How a replica goes on under another id, after somebody spoke in the name of the one it had.

Peers that believed the lie take for seen what the replica adds from then on, so only another id helps. What it had
added and they may not have taken it adds anew; then an element may have two incarnations, as when two create one name.
It never has more of them: what came anew under the last id goes when it comes anew under the next one.
"""

from __future__ import annotations

import re
import secrets
from collections.abc import Iterable, Mapping
from types import MappingProxyType

from dsr.crdt.context import Dot, to_ranges
from dsr.crdt.delta import Add, Delta, Write
from dsr.graph.graph import Graph

_NONE: Mapping[Dot, Dot] = MappingProxyType({})
_TAKEN = re.compile(r"(?P<first>.+)r(?P<number>[0-9]{6})[0-9a-f]{8}")


def next_id(rid: str) -> str:
    """An id that nobody can know, of the same agent and process; of two ids of one replica the later is the greater."""
    found = _TAKEN.fullmatch(rid)
    first, number = (found["first"], int(found["number"])) if found else (rid, 0)
    return f"{first}r{number + 1:06}{secrets.token_hex(4)}"


def going_on_as(
    graph: Graph, rid: str, confirmed: int, now: float, forged: Iterable[Dot] = (), renewed: Mapping[Dot, Dot] = _NONE
) -> tuple[Delta, dict[Dot, Dot]]:
    """Give the graph another replica id, and write anew, as one delta, what peers may not have taken under the old one.

    That is what was added or written since counter `confirmed`, and samples of streams that are not durable yet. Values
    keep their stamps. What somebody else had added under the dots `forged` is removed. So are the copies that the last
    change of the id had made (`renewed`: each dot and that of its copy), unless peers have taken them. The next copies
    come of the originals, with what was written to either: so nobody grows, and others lose no writes and edges.
    Edges of others that would end nowhere are added anew, too. Returns what is made anew now. The graph must be locked.
    """
    old, store, void = graph.rid, graph.store, set(forged)
    originals = {
        copy: original
        for original, copy in renewed.items()
        if _is_lost(copy, old, confirmed) and original in store.entries and original not in void
    }
    gone = void.union(originals)

    def ends_nowhere(ends: tuple[Dot, ...]) -> bool:
        return bool(ends) and all(end in gone or (store.is_known(end) and store.find(end) is None) for end in ends)

    graph.rid, graph.counter = rid, 0
    delta = Delta()
    found = [entry for dot in store.written_dots() if (entry := store.find(dot))]
    lost = [
        entry
        for entry in found
        if entry.dot in store.entries
        and (
            entry.dot in void
            or _is_lost(entry.dot, old, confirmed)
            or ends_nowhere(entry.sources)
            or ends_nowhere(entry.destinations)
        )
    ]
    anew: dict[Dot, Dot] = {}

    def ends_of(dots: tuple[Dot, ...]) -> tuple[Dot, ...]:
        now = [originals.get(end, end) for end in dots]
        return tuple(dict.fromkeys([*now, *(anew[end] for end in now if end in anew)]))

    for entry in sorted(lost, key=lambda entry: not isinstance(entry.key, str)):  # nodes first: edges name their dots
        original = originals.get(entry.dot, entry.dot)
        dot = anew[original] = graph.new_dot()
        delta.adds.append(Add(dot, entry.key, entry.type, ends_of(entry.sources), ends_of(entry.destinations)))
        latest = dict(store.entries[original].registers)
        for name, write in entry.registers.items():
            if name not in latest or (latest[name].stamp, latest[name].writer) < (write.stamp, write.writer):
                latest[name] = write
                if original != entry.dot:
                    delta.writes.append(_again(write, original, rid, graph.new_dot()))
        delta.writes += [_again(write, dot, rid, graph.new_dot()) for write in latest.values()]
    for entry in found:
        own = [write for write in entry.registers.values() if _is_unsure(write, old, confirmed)]
        delta.writes += [_again(write, entry.dot, rid, graph.new_dot()) for write in own if entry.dot not in gone]
    delta.removed = sorted(gone)
    if delta.removed:
        graph.new_dot()
    if graph.counter:
        delta.context = [(rid, 1, graph.counter)]
    graph.join(delta, now)
    return delta, anew


def unconfirmed(graph: Graph, confirmed: int) -> Delta:
    """What was added or written here since counter `confirmed`, and is there still, as it is; the graph must be locked.

    It accounts for that alone. What was removed may not have been told to anybody.
    """
    delta = Delta()
    for entry in filter(None, map(graph.store.find, graph.store.written_dots())):
        if _is_lost(entry.dot, graph.rid, confirmed):
            delta.adds.append(Add(entry.dot, entry.key, entry.type, entry.sources, entry.destinations))
        delta.writes += [w for w in entry.registers.values() if w.dot and _is_lost(w.dot, graph.rid, confirmed)]
    dots = [add.dot for add in delta.adds] + [write.dot for write in delta.writes if write.dot]
    delta.context = list(to_ranges(dots))
    return delta


def _is_lost(dot: Dot, old: str, confirmed: int) -> bool:
    return dot[0] == old and dot[1] > confirmed


def _is_unsure(write: Write, old: str, confirmed: int) -> bool:
    if write.dot is None:
        return write.writer == old
    return _is_lost(write.dot, old, confirmed)


def _again(write: Write, owner: Dot, rid: str, dot: Dot) -> Write:
    return Write(owner, write.attribute, write.stamp, rid, dot, write.value)
