"""Splits a delta into messages of bounded length, each of which accounts only for its own content.

A delta that fits into one message travels as it is. Of a longer one, each message accounts for the dots of its own
additions and writes. The other dots of the delta, those of removals and of writes that later ones replaced, stay holes
that the synchroniser's repair closes: whoever lost one of the messages must not believe that it has seen all.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import chain

from dsr.crdt.context import to_ranges
from dsr.crdt.delta import Add, Delta, Write
from dsr.replication.wire import MAX_STRUCTURE, encode_delta

MAX_PARCEL = MAX_STRUCTURE
"""Bytes; a single longer change travels in a longer message."""


def parcels(delta: Delta) -> Iterable[bytes]:
    """Split `delta` into messages, in an order in which additions come before the writes to them."""
    payload = encode_delta(delta)
    if len(payload) <= MAX_PARCEL or len(delta) <= 1:
        return (payload,)
    return chain.from_iterable(map(parcels, _parts(delta, len(payload) // MAX_PARCEL + 1)))


def _parts(delta: Delta, count: int) -> Iterator[Delta]:
    """At least `count` parts with nearly as many changes each, if there are as many.

    Changes come in the order in which they were made, so that each part leaves few gaps between the dots.
    """
    size = max(1, len(delta) // count)
    durable: list[Add | Write] = [*delta.adds, *(write for write in delta.writes if write.dot)]
    durable.sort(key=lambda change: change.dot or ("", 0))
    changes = [*durable, *(write for write in delta.writes if not write.dot)]
    for first in range(0, len(changes), size):
        part = changes[first : first + size]
        adds = [change for change in part if isinstance(change, Add)]
        writes = [change for change in part if isinstance(change, Write)]
        yield Delta(adds, writes, context=list(to_ranges(change.dot for change in part if change.dot)))
    for first in range(0, len(delta.removed), size):
        yield Delta(removed=delta.removed[first : first + size])
