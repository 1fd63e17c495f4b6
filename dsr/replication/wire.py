"""The versioned encoding of messages between replicas: MessagePack, so that any language can read it.

Delta:   [version, replica ids, adds, writes, removed, context, live]
  add      [replica, counter, key, type, sources, destinations]   key: name, or [source, destination, type]
  write    [owner replica, owner counter, attribute, stamp, writer, dot replica, dot counter, value]
           dot counter 0: a stream sample; a value of nil: the attribute was taken away
  removed  [replica, counter, ...] flat; context [replica, first, last, ...] flat; live as removed, or nil
Digest:  [version 2, replica id, now, recent, hash, fingerprint, [replicas whose clock is ahead]]
  recent   [[replica id, first, last, ...], ...]: what was seen of those that changed last; hash: of the whole context
Replicas are indexes into the list of replica ids; see `values.py` for values.

Rules for changing this file: a reader must refuse what it does not understand, so every change of the
layout increments its version; the golden bytes in tests/dsr/test_wire.py change only together with it.

What arrives costs time and memory in proportion to its length, whatever is in it: nothing is built that no message may
hold. So lists say how long they may be, values are skipped first and then read by their kind, and no error shows them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from functools import lru_cache
from typing import Annotated, Any

import msgspec

from dsr.crdt.context import CausalContext, Dot, DotRange, apart
from dsr.crdt.delta import MAX_ENDS, TOMBSTONE, Add, Delta, Key, Write
from dsr.crdt.hlc import MAX_STAMP
from dsr.crdt.pieces import size_of
from dsr.crdt.summary import LISTED, LISTED_RANGES, Summary
from dsr.graph.schema import is_own_name
from dsr.network.decoding import decoded
from dsr.replication.values import encode_extension, fitted, to_value

VERSION = 1
"""Version of the format of deltas, replies and requests."""
DIGEST_VERSION = 2
"""Version of the format of digests: those of version 1 held the whole context."""
MAX_NAME = 256
_MAX_COUNTER = 1 << 53
MAX_MESSAGE = 1 << 24
"""Bytes of a message: one value of the greatest length fits. What is larger travels in several."""
MAX_STRUCTURE = 1 << 20
"""Bytes of a message without its values: what lists of changes and dots may take."""
MAX_ADD = 3 * MAX_STRUCTURE // 8
"""Bytes of one addition, which an answer holds beside much else. The most ends with the longest ids take 336 kB."""

MOST_NAMED = 32
"""Replicas that one message names to people, or for votes about clocks: those known longest. Readers keep them."""

_SHORT = 1 << 10
"""Bytes of a message that is read about as soon as it is looked up."""
_MOST_KEPT = MAX_STRUCTURE // 8
"""Bytes of the longest message that is kept for other replicas of the process: percepts of 200 objects and more"""
_KEPT = 8
"""Messages that are kept, while the threads of other replicas come to them."""

_FEW_ENDS = MAX_ADD // (4 * MAX_NAME + 32)
"""Creation dots that fit into one addition, however long their replica ids are."""

Natural = Annotated[int, msgspec.Meta(ge=0)]
_Counter = Annotated[int, msgspec.Meta(ge=1, le=_MAX_COUNTER)]
CounterOrZero = Annotated[int, msgspec.Meta(ge=0, le=_MAX_COUNTER)]
_Hash = Annotated[int, msgspec.Meta(ge=0)]
_Stamp = Annotated[int, msgspec.Meta(ge=0, le=MAX_STAMP)]
Name = Annotated[str, msgspec.Meta(min_length=1, max_length=MAX_NAME)]
Names = Annotated[list[Name], msgspec.Meta(max_length=MOST_NAMED)]


SentAdd = tuple[int, int, Key, str, list[int], list[int]]
"""The fields of an `AddRow`; a tuple is made in a third of the time."""
SentWrite = tuple[int, int, str, int, int, int, int, Any]
"""The fields of a `WriteRow`."""


class AddRow(msgspec.Struct, array_like=True, gc=False):
    """An addition in a message."""

    replica: Natural
    counter: _Counter
    key: str | tuple[str, str, str]  # a union of constrained strings and tuples is beyond msgspec 0.22
    type: Name
    sources: list[Natural]
    destinations: list[Natural]


class WriteRow(msgspec.Struct, array_like=True, gc=False):
    """A write in a message as it is read, its value still in bytes."""

    replica: Natural
    counter: _Counter
    attribute: Name
    stamp: _Stamp
    writer: Natural
    dot_replica: Natural
    dot_counter: CounterOrZero
    value: msgspec.Raw


class _KeptDelta(msgspec.Struct, array_like=True, gc=False):
    """A delta as it is read from a file: as long as the file."""

    version: int
    replicas: list[Name]
    adds: list[AddRow]
    writes: list[WriteRow]
    removed: list[Natural]
    context: list[Natural]
    live: list[Natural] | None


MOST_CHANGES = msgspec.Meta(max_length=MAX_STRUCTURE // 8)
"""Each takes 8 bytes or more."""
MOST_NUMBERS = msgspec.Meta(max_length=MAX_STRUCTURE)


class _SentDelta(_KeptDelta, array_like=True, gc=False):
    """A delta as it is read from the network."""

    replicas: Annotated[list[Name], MOST_CHANGES]
    adds: Annotated[list[AddRow], MOST_CHANGES]
    writes: Annotated[list[WriteRow], MOST_CHANGES]
    removed: Annotated[list[Natural], MOST_NUMBERS]
    context: Annotated[list[Natural], MOST_NUMBERS]
    live: Annotated[list[Natural], MOST_NUMBERS] | None


class _Listed(msgspec.Struct, array_like=True, gc=False):
    replica: Name
    counters: Annotated[list[_Counter], msgspec.Meta(min_length=2, max_length=2 * LISTED_RANGES)]


class _Digest(msgspec.Struct, array_like=True, gc=False):
    version: int
    replica: Name
    now: float
    recent: Annotated[list[_Listed], msgspec.Meta(max_length=LISTED)]
    hash: _Hash
    fingerprint: int
    ahead: Names


class _FirstDigest(msgspec.Struct, array_like=True, gc=False):
    """A digest of version 1, as recordings hold them: all that was seen, in full."""

    version: int
    replica: Name
    now: float
    context: list[tuple[Name, _Counter, _Counter]]
    fingerprint: int
    ahead: Names


class _Head(msgspec.Struct, array_like=True, gc=False):
    version: int


class Digest(msgspec.Struct, frozen=True):
    """A short description of a replica's content, with its opinion of its peers' clocks."""

    replica: str
    now: float
    """Physical time of the sender, s."""
    seen: Summary
    fingerprint: int
    ahead: tuple[str, ...]
    """Replicas whose physical clock the sender saw too far in its future."""


encoder = msgspec.msgpack.Encoder(enc_hook=encode_extension)
_sent_decoder = msgspec.msgpack.Decoder(_SentDelta)
_kept_decoder = msgspec.msgpack.Decoder(_KeptDelta)
_digest_decoder = msgspec.msgpack.Decoder(_Digest)
_first_digest_decoder = msgspec.msgpack.Decoder(_FirstDigest)
_head_decoder = msgspec.msgpack.Decoder(_Head)


class Indexes(dict[str, int]):
    """Replica ids in order of first use, and their indexes."""

    def __missing__(self, rid: str) -> int:
        self[rid] = index = len(self)
        return index

    def flat(self, dots: Iterable[Dot]) -> list[int]:
        """Dots as pairs of an index and a counter, one after the other."""
        return [number for rid, counter in dots for number in (self[rid], counter)]

    def flat_ranges(self, ranges: Iterable[DotRange]) -> list[int]:
        """Write ranges as triples of numbers: index of the replica, first and last counter."""
        return [number for rid, first, last in ranges for number in (self[rid], first, last)]


def encode_delta(delta: Delta) -> bytes:
    """A delta or synchronisation reply as bytes."""
    if len(delta.writes) == 1 and not delta.adds and not delta.removed and delta.live is None:
        return _encode_one(delta.writes[0], delta.context)
    index = Indexes()
    adds = add_rows(index, delta.adds)
    writes = write_rows(index, delta.writes)
    removed = index.flat(delta.removed)
    context = index.flat_ranges(delta.context)
    live = None if delta.live is None else index.flat(sorted(delta.live))
    return encoder.encode((VERSION, list(index), adds, writes, removed, context, live))


def _encode_one(write: Write, context: list[DotRange]) -> bytes:
    """A delta of one write alone, as nearly all are: the same bytes, sooner."""
    (rid, counter), writer, value = write.owner, write.writer, write.value
    dot_rid, dot_counter = write.dot or (writer, 0)
    names = [rid] if rid == writer else [rid, writer]
    if dot_rid not in names:
        names.append(dot_rid)
    flat: list[int] = []
    for owner, first, last in context:
        if owner not in names:
            names.append(owner)
        flat += (names.index(owner), first, last)
    if value is TOMBSTONE:
        value = None
    row = 0, counter, write.attribute, write.stamp, names.index(writer), names.index(dot_rid), dot_counter, value
    return encoder.encode((VERSION, names, (), (row,), (), flat, None))


def add_rows(index: Indexes, adds: Iterable[Add]) -> list[SentAdd]:
    """Additions as they are sent."""
    return [
        (index[a.dot[0]], a.dot[1], a.key, a.type, index.flat(a.sources), index.flat(a.destinations)) for a in adds
    ]


def write_rows(index: Indexes, writes: Iterable[Write]) -> list[SentWrite]:
    """Writes as they are sent."""
    rows = []
    for write in writes:
        (rid, counter), value, writer = write.owner, write.value, write.writer
        dot_rid, dot_counter = write.dot or (writer, 0)
        if value is TOMBSTONE:
            value = None
        rows.append(
            (index[rid], counter, write.attribute, write.stamp, index[writer], index[dot_rid], dot_counter, value)
        )
    return rows


def decode_delta(payload: bytes) -> Delta:
    """The delta in `payload`, which came over the network. Raises `WireError` unless all of it is valid.

    Replicas of one process that get the same message share its additions and writes.
    """
    is_shared = _SHORT < len(payload) <= _MOST_KEPT
    return decoded(payload, f"delta of {len(payload)} bytes", _read_shared if is_shared else _read_sent)


def decode_kept(payload: bytes) -> Delta:
    """The delta or snapshot in `payload`, which was read from a file; it may be of any length. Raises `WireError`."""
    return decoded(payload, f"delta of {len(payload)} bytes", _read_kept)


def _read_kept(payload: bytes) -> Delta:
    """What nobody takes from the network is left out: an older version may have kept it."""
    message = _kept_decoder.decode(payload)
    rows = [row for row in message.adds if _is_of_its_type(row)]
    message.adds = [row for row in rows if _has_room(message.replicas, row)]
    return _to_delta(message)


def _read_shared(payload: bytes) -> Delta:
    """As `_read_sent`, at the cost of a copy of its lists if a replica of this process has just read the same."""
    read = _read_once(payload)
    lists = [*read.adds], [*read.writes], [*read.removed], [*read.context]
    return Delta(*lists, read.live, read.examined, read.misfits)


def _read_sent(payload: bytes) -> Delta:
    if len(payload) <= MAX_STRUCTURE:
        return _to_delta(_sent_decoder.decode(payload))
    check_length(payload)
    message = _sent_decoder.decode(payload)
    check_structure(payload, message.writes)
    return _to_delta(message)


_read_once = lru_cache(maxsize=_KEPT)(_read_sent)


def check_length(payload: bytes) -> None:
    """Raise `ValueError` for a message longer than any may be."""
    if len(payload) > MAX_MESSAGE:
        raise ValueError(f"more than {MAX_MESSAGE} bytes")


def check_structure(payload: bytes, writes: list[WriteRow]) -> None:
    """Raise `ValueError` for a long message that is not long for its values."""
    if len(payload) > MAX_STRUCTURE and len(payload) - sum(len(write.value) for write in writes) > MAX_STRUCTURE:
        raise ValueError(f"more than {MAX_STRUCTURE} bytes beside the values")


def _check_version(version: int, ours: int = VERSION) -> None:
    if version != ours:
        raise ValueError(f"version {version}, this is version {ours}")


def _to_delta(message: _KeptDelta) -> Delta:
    _check_version(message.version)
    names = message.replicas
    if len(message.writes) == 1 and not message.adds and not message.removed and message.live is None:
        return _to_one(names, message.writes[0], message.context)
    delta = Delta(to_adds(names, message.adds), to_writes(names, message.writes))
    delta.misfits = _misfits(delta.writes, message.writes)
    if message.removed:
        delta.removed = to_dots(names, message.removed)
    delta.context = to_ranges(names, message.context)
    delta.live = None if message.live is None else frozenset(to_dots(names, message.live))
    return delta


def _to_one(names: list[str], row: WriteRow, context: list[int]) -> Delta:
    """A delta of one write alone, as nearly all are, sooner."""
    dot = (names[row.dot_replica], row.dot_counter) if row.dot_counter else None
    owner, writer = (names[row.replica], row.counter), names[row.writer]
    value = fitted(row.attribute, to_value(row.value))
    delta = Delta([], [Write(owner, row.attribute, row.stamp, writer, dot, value)], [], to_ranges(names, context))
    if value is TOMBSTONE:
        delta.misfits = _misfits(delta.writes, [row])
    return delta


def _misfits(writes: list[Write], rows: list[WriteRow]) -> int:
    """How many values are no values of their attributes: those that were not taken away when they were sent."""
    gone = [row for write, row in zip(writes, rows, strict=True) if write.value is TOMBSTONE]
    return sum(to_value(row.value) is not TOMBSTONE for row in gone)


def to_adds(names: list[str], rows: list[AddRow]) -> list[Add]:
    """Additions from the `rows` of a message; `names` are its replica ids, to which the rows' indexes refer.

    Raises `ValueError` or `IndexError` for a row that is not valid.
    """
    adds = []
    for row in rows:
        if len(row.sources) + len(row.destinations) > 2 * _FEW_ENDS and not _has_room(names, row):
            raise ValueError(f"an edge with ends of more than {MAX_ADD} bytes")
        ends = (tuple(to_dots(names, row.sources)), tuple(to_dots(names, row.destinations))) if row.sources else ()
        adds.append(Add((names[row.replica], row.counter), _to_key(row), row.type, *ends))
    return adds


def to_writes(names: list[str], rows: list[WriteRow]) -> list[Write]:
    """Writes from the `rows` of a message; `names` are its replica ids, to which the rows' indexes refer.

    Raises `ValueError` or `IndexError` for a row that is not valid, and what msgspec raises for their values.
    """
    writes = []
    replica, counter, owner = -1, 0, ("", 0)
    for row in rows:
        if row.counter != counter or row.replica != replica:  # else written to the element of the row before
            replica, counter = row.replica, row.counter
            owner = names[replica], counter
        dot = (names[row.dot_replica], row.dot_counter) if row.dot_counter else None
        value = fitted(row.attribute, to_value(row.value))
        writes.append(Write(owner, row.attribute, row.stamp, names[row.writer], dot, value))
    return writes


def _to_key(add: AddRow) -> Key:
    key = add.key
    if type(key) is str:
        if not _is_name(key):
            raise ValueError(f"a node's name of {len(key)} characters")
        if not _is_of_its_type(add):
            raise ValueError("a node about the graph itself whose name and type do not fit")
        if add.sources or add.destinations:
            raise ValueError("a node with endpoints")
        return key
    if not (_is_name(key[0]) and _is_name(key[1]) and _is_name(key[2])):
        raise ValueError(f"an edge's key with a name of none or more than {MAX_NAME} characters")
    if not _is_of_its_type(add):
        raise ValueError("an edge of another type than its key tells")
    if not 0 < len(add.sources) <= 2 * MAX_ENDS or not 0 < len(add.destinations) <= 2 * MAX_ENDS:
        raise ValueError(f"an edge without creation dots at both ends, or with more than {MAX_ENDS}")
    return key


def _is_of_its_type(add: AddRow) -> bool:
    """Whether key and type fit: rights are told by the type, and what is seen by the key."""
    key = add.key
    return is_own_name(key, add.type) if type(key) is str else key[2] == add.type


def _has_room(names: list[str], add: AddRow) -> bool:
    """Whether an answer has room for an addition, which may name many replicas."""
    numbers = add.sources + add.destinations
    return sum(size_of(names[index]) for index in {*numbers[::2]}) + 7 * len(numbers) <= MAX_ADD


def _is_name(value: str) -> bool:
    return 0 < len(value) <= MAX_NAME


def _positive(counter: int) -> int:
    if counter < 1:
        raise ValueError(f"counter {counter}: counters start at 1")
    return counter


def to_dots(names: list[str], flat: list[int]) -> list[Dot]:
    """Dots from the numbers of a message (`flat`); `names` are its replica ids, to which indexes refer.

    Raises `ValueError` or `IndexError` for a number that is not valid.
    """
    if len(flat) == 2:
        return [(names[flat[0]], _positive(flat[1]))]
    if len(flat) % 2:
        raise ValueError("dots are pairs of a replica's index and a counter")
    counters = flat[1::2]
    _positive(min(counters, default=1))
    return list(zip(map(names.__getitem__, flat[::2]), counters, strict=True))


def to_ranges(names: list[str], flat: list[int]) -> list[DotRange]:
    """Ranges from the numbers of a message (`flat`); `names` are its replica ids, to which indexes refer.

    Raises `ValueError` or `IndexError` for a number that is not valid.
    """
    if len(flat) == 3:
        return [_checked_range(names[flat[0]], flat[1], flat[2])]
    if len(flat) % 3:
        raise ValueError("a context is triples of a replica's index, first and last counter")
    ranges = [_checked_range(names[flat[i]], flat[i + 1], flat[i + 2]) for i in range(0, len(flat), 3)]
    return apart(ranges) if len(ranges) > 1 else ranges


def _checked_range(rid: str, first: int, last: int) -> DotRange:
    if not 1 <= first <= last <= _MAX_COUNTER:
        raise ValueError(f"dots {first} to {last}")
    return rid, first, last


def encode_digest(digest: Digest) -> bytes:
    """A digest as bytes."""
    recent = [_Listed(rid, [counter for dots in ranges for counter in dots]) for rid, ranges in digest.seen.recent]
    ahead = list(digest.ahead)
    return encoder.encode(
        _Digest(DIGEST_VERSION, digest.replica, digest.now, recent, digest.seen.hash, digest.fingerprint, ahead)
    )


def decode_digest(payload: bytes) -> Digest:
    """The digest in `payload`. Raises `WireError` unless all of it is valid."""
    return decoded(payload, f"digest of {len(payload)} bytes", _read_digest)


def _read_digest(payload: bytes) -> Digest:
    if len(payload) > MAX_STRUCTURE:
        raise ValueError(f"more than {MAX_STRUCTURE} bytes")
    is_first = _head_decoder.decode(payload).version == 1
    return _to_digest((_first_digest_decoder if is_first else _digest_decoder).decode(payload))


def _to_digest(message: _Digest | _FirstDigest) -> Digest:
    if not math.isfinite(message.now):
        raise ValueError(f"time {message.now}")
    if isinstance(message, _FirstDigest):
        seen = to_context(message.context).summary()
    else:
        _check_version(message.version, DIGEST_VERSION)
        recent = tuple((listed.replica, _pairs(listed.counters)) for listed in message.recent)
        if len({rid for rid, _ in recent}) < len(recent):
            raise ValueError("a replica is listed twice")
        seen = Summary(recent, message.hash)
    return Digest(message.replica, message.now, seen, message.fingerprint, tuple(message.ahead))


def _pairs(counters: list[int]) -> tuple[tuple[int, int], ...]:
    if len(counters) == 2 and counters[0] <= counters[1]:  # nearly always
        return ((counters[0], counters[1]),)
    if len(counters) % 2 or any(a > b for a, b in itertools.pairwise(counters)):
        raise ValueError("ranges of counters are pairs, in order")
    return tuple(zip(counters[::2], counters[1::2], strict=True))


def to_context(ranges: list[tuple[str, int, int]]) -> CausalContext:
    """A context as it was received; raises `ValueError`."""
    return CausalContext(sorted([_checked_range(*dots) for dots in ranges]))
