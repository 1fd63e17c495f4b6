"""The versioned encoding of messages between replicas: MessagePack, so that any language can read it.

Delta:   [version, replica ids, adds, writes, removed, context, live]
  add      [replica, counter, key, type, sources, destinations]   key: name, or [source, destination, type]
  write    [owner replica, owner counter, attribute, stamp, writer, dot replica, dot counter, value]
           dot counter 0: a stream sample; a value of nil: the attribute was taken away
  removed  [replica, counter, ...] flat; context [replica, first, last, ...] flat; live as removed, or nil
Digest:  [version 2, replica id, now, recent, hash, fingerprint, [replicas whose clock is ahead]]
  recent   [[replica id, first, last, ...], ...]: what was seen of those that changed last; hash: of the whole context
Request: [version, replica id, now, context, fingerprint, []]    context: [[replica id, first, last], ...]
Replicas are indexes into the list of replica ids. A pose is extension type 1: little-endian doubles
x y z qx qy qz qw stamp, then, if known, the 36 of the covariance row by row.

Rules for changing this file: a reader must refuse what it does not understand, so every change of the
layout increments its version; the golden bytes in tests/dsr/test_wire.py change only together with it.
"""

from __future__ import annotations

import itertools
import math
import struct
from collections.abc import Iterable
from typing import Annotated, Any

import msgspec

from dsr.crdt.context import CausalContext, Dot, DotRange
from dsr.crdt.delta import TOMBSTONE, Add, Delta, Key, Write
from dsr.crdt.summary import LISTED, LISTED_RANGES, Summary
from dsr.decoding import decoded
from dsr.errors import WireError
from dsr.schema import MAX_LENGTH
from dsr.transforms import Pose

VERSION = 1
"""Of deltas, replies and requests."""
DIGEST_VERSION = 2
"""Of digests: those of version 1 held the whole context."""
_POSE_CODE = 1
_POSE = struct.Struct("<8d")
_POSE_COVARIANCE = struct.Struct("<44d")
_UNIT_TOLERANCE = 1e-12
"""Rounding of a unit quaternion: within it the sender's numbers are taken as they are."""
MAX_NAME = 256
_MAX_COUNTER = 1 << 53
MAX_MESSAGE = 1 << 28
"""Bytes of a delta or digest; a graph of a million nodes fits."""

_Natural = Annotated[int, msgspec.Meta(ge=0)]
_Counter = Annotated[int, msgspec.Meta(ge=1, le=_MAX_COUNTER)]
_CounterOrZero = Annotated[int, msgspec.Meta(ge=0, le=_MAX_COUNTER)]
_Hash = Annotated[int, msgspec.Meta(ge=0)]
_Stamp = Annotated[int, msgspec.Meta(ge=0, le=(1 << 63) - 1)]
_Name = Annotated[str, msgspec.Meta(min_length=1, max_length=MAX_NAME)]


class _Add(msgspec.Struct, array_like=True, gc=False):
    replica: _Natural
    counter: _Counter
    key: Any  # a union of constrained strings and tuples is beyond msgspec 0.22
    type: _Name
    sources: list[_Natural]
    destinations: list[_Natural]


class _Write(msgspec.Struct, array_like=True, gc=False):
    replica: _Natural
    counter: _Counter
    attribute: _Name
    stamp: _Stamp
    writer: _Natural
    dot_replica: _Natural
    dot_counter: _CounterOrZero
    value: Any


class _Delta(msgspec.Struct, array_like=True, gc=False):
    version: int
    replicas: list[_Name]
    adds: list[_Add]
    writes: list[_Write]
    removed: list[_Natural]
    context: list[_Natural]
    live: list[_Natural] | None


class _Listed(msgspec.Struct, array_like=True, gc=False):
    replica: _Name
    counters: Annotated[list[_Counter], msgspec.Meta(min_length=2, max_length=2 * LISTED_RANGES)]


class _Digest(msgspec.Struct, array_like=True, gc=False):
    version: int
    replica: _Name
    now: float
    recent: Annotated[list[_Listed], msgspec.Meta(max_length=LISTED)]
    hash: _Hash
    fingerprint: int
    ahead: list[_Name]


class _Request(msgspec.Struct, array_like=True, gc=False):
    version: int
    replica: _Name
    now: float
    context: list[tuple[_Name, _Counter, _Counter]]
    fingerprint: int
    ahead: list[_Name]


class Digest(msgspec.Struct, frozen=True):
    """What a replica has seen and what it thinks of its peers' clocks."""

    replica: str
    now: float
    """Physical time of the sender, s."""
    seen: Summary
    fingerprint: int
    ahead: tuple[str, ...]
    """Replicas whose physical clock the sender saw too far in its future."""


class Request(msgspec.Struct, frozen=True):
    """Who asks for what it lacks, and all that it has seen."""

    replica: str
    context: CausalContext


def _encode_extension(value: Any) -> Any:
    if isinstance(value, Pose):
        numbers = (*value.t, *value.q, value.stamp)
        if value.cov is None:
            return msgspec.msgpack.Ext(_POSE_CODE, _POSE.pack(*numbers))
        return msgspec.msgpack.Ext(_POSE_CODE, _POSE_COVARIANCE.pack(*numbers, *value.cov))
    raise TypeError(f"{type(value).__name__} cannot be sent")


def _decode_extension(code: int, data: memoryview) -> Pose:
    if code == _POSE_CODE and len(data) == _POSE.size:
        tx, ty, tz, x, y, z, w, stamp = _POSE.unpack(data)
        if abs(x * x + y * y + z * z + w * w - 1.0) < _UNIT_TOLERANCE and math.isfinite(tx + ty + tz + stamp):
            return Pose.unchecked((tx, ty, tz), (x, y, z, w), stamp)
        return Pose((tx, ty, tz), (x, y, z, w), stamp)
    if code == _POSE_CODE and len(data) == _POSE_COVARIANCE.size:
        numbers = _POSE_COVARIANCE.unpack(data)
        return Pose(numbers[:3], numbers[3:7], numbers[7], numbers[8:])
    raise WireError(f"extension {code} of {len(data)} bytes")


_encoder = msgspec.msgpack.Encoder(enc_hook=_encode_extension)
_delta_decoder = msgspec.msgpack.Decoder(_Delta, ext_hook=_decode_extension)
_digest_decoder = msgspec.msgpack.Decoder(_Digest)
_request_decoder = msgspec.msgpack.Decoder(_Request)


class _Indexes(dict[str, int]):
    """Replica ids in order of first use, and their indexes."""

    def __missing__(self, rid: str) -> int:
        self[rid] = index = len(self)
        return index

    def flat(self, dots: Iterable[Dot]) -> list[int]:
        return [number for rid, counter in dots for number in (self[rid], counter)]


def encode_delta(delta: Delta) -> bytes:
    """A delta or synchronisation reply as bytes."""
    index = _Indexes()
    adds = [_Add(index[a.dot[0]], a.dot[1], a.key, a.type, index.flat(a.sources), index.flat(a.destinations))
            for a in delta.adds]  # fmt: skip
    writes = [_encode_write(index, write) for write in delta.writes]
    removed = index.flat(delta.removed)
    context = [number for rid, first, last in delta.context for number in (index[rid], first, last)]
    live = None if delta.live is None else index.flat(sorted(delta.live))
    return _encoder.encode(_Delta(VERSION, list(index), adds, writes, removed, context, live))


def _encode_write(index: _Indexes, write: Write) -> _Write:
    rid, counter = write.owner
    dot_rid, dot_counter = write.dot or (write.writer, 0)
    value = None if write.value is TOMBSTONE else write.value
    return _Write(
        index[rid], counter, write.attribute, write.stamp, index[write.writer], index[dot_rid], dot_counter, value
    )


def decode_delta(payload: bytes) -> Delta:
    """The delta in `payload`. Raises `WireError` unless all of it is valid."""
    return decoded(payload, f"delta of {len(payload)} bytes", _read_delta)


def _read_delta(payload: bytes) -> Delta:
    _check_length(payload)
    message = _delta_decoder.decode(payload)
    _check_version(message.version)
    return _to_delta(message)


def _check_length(payload: bytes) -> None:
    if len(payload) > MAX_MESSAGE:
        raise ValueError(f"more than {MAX_MESSAGE} bytes")


def _check_version(version: int, ours: int = VERSION) -> None:
    if version != ours:
        raise ValueError(f"version {version}, this is version {ours}")


def _to_delta(message: _Delta) -> Delta:
    names = message.replicas
    delta = Delta()
    for a in message.adds:
        ends = (tuple(_dots(names, a.sources)), tuple(_dots(names, a.destinations))) if a.sources else ()
        delta.adds.append(Add((names[a.replica], a.counter), _to_key(a), a.type, *ends))
    delta.writes = [_to_write(names, write) for write in message.writes]
    delta.removed = _dots(names, message.removed)
    delta.context = _ranges(names, message.context)
    delta.live = None if message.live is None else frozenset(_dots(names, message.live))
    return delta


def _to_key(add: _Add) -> Key:
    key = add.key
    if _is_name(key):
        if add.sources or add.destinations:
            raise ValueError(f"node {key!r} with endpoints")
        return str(key)
    if type(key) is not list or len(key) != 3 or not (_is_name(key[0]) and _is_name(key[1]) and _is_name(key[2])):
        raise ValueError(f"key {key!r:.80}: expected a name or three names of at most {MAX_NAME} characters")
    if not add.sources or not add.destinations:
        raise ValueError(f"edge {key!r:.80}: expected creation dots at both ends")
    return key[0], key[1], key[2]


def _is_name(value: Any) -> bool:
    return type(value) is str and 0 < len(value) <= MAX_NAME


def _to_write(names: list[str], write: _Write) -> Write:
    writer = names[write.writer]
    dot = (names[write.dot_replica], write.dot_counter) if write.dot_counter else None
    value = write.value if type(write.value) in _PLAIN else _to_value(write.value)
    return Write((names[write.replica], write.counter), write.attribute, write.stamp, writer, dot, value)


_PLAIN = frozenset((Pose, bool))


def _to_value(value: Any) -> Any:
    kind = type(value)
    if kind in (str, bytes) and len(value) <= MAX_LENGTH:
        return value
    if value is None:
        return TOMBSTONE
    if kind is float and math.isfinite(value):
        return value
    if kind is int and -(1 << 63) <= value < (1 << 63):
        return value
    if kind is list and len(value) <= MAX_LENGTH and all(type(n) is float and math.isfinite(n) for n in value):
        return tuple(value)
    raise ValueError(f"a value of type {kind.__name__} that no attribute may have: {value!r:.80}")


def _positive(counter: int) -> int:
    if counter < 1:
        raise ValueError(f"counter {counter}: counters start at 1")
    return counter


def _dots(names: list[str], flat: list[int]) -> list[Dot]:
    if len(flat) == 2:
        return [(names[flat[0]], _positive(flat[1]))]
    if len(flat) % 2:
        raise ValueError("dots are pairs of a replica's index and a counter")
    counters = flat[1::2]
    _positive(min(counters, default=1))
    return list(zip(map(names.__getitem__, flat[::2]), counters, strict=True))


def _ranges(names: list[str], flat: list[int]) -> list[DotRange]:
    if len(flat) % 3:
        raise ValueError("a context is triples of a replica's index, first and last counter")
    return [_checked_range(names[flat[i]], flat[i + 1], flat[i + 2]) for i in range(0, len(flat), 3)]


def _checked_range(rid: str, first: int, last: int) -> DotRange:
    if not 1 <= first <= last <= _MAX_COUNTER:
        raise ValueError(f"dots {first} to {last} of {rid!r}")
    return rid, first, last


def encode_digest(digest: Digest) -> bytes:
    """A digest as bytes."""
    recent = [_Listed(rid, [counter for dots in ranges for counter in dots]) for rid, ranges in digest.seen.recent]
    ahead = list(digest.ahead)
    return _encoder.encode(
        _Digest(DIGEST_VERSION, digest.replica, digest.now, recent, digest.seen.hash, digest.fingerprint, ahead)
    )


def decode_digest(payload: bytes) -> Digest:
    """The digest in `payload`. Raises `WireError` unless all of it is valid."""
    return decoded(payload, f"digest of {len(payload)} bytes", _read_digest)


def _read_digest(payload: bytes) -> Digest:
    _check_length(payload)
    message = _digest_decoder.decode(payload)
    _check_version(message.version, DIGEST_VERSION)
    if not math.isfinite(message.now):
        raise ValueError(f"time {message.now}")
    recent = tuple((listed.replica, _pairs(listed.counters)) for listed in message.recent)
    if len({rid for rid, _ in recent}) < len(recent):
        raise ValueError("a replica is listed twice")
    return Digest(
        message.replica, message.now, Summary(recent, message.hash), message.fingerprint, tuple(message.ahead)
    )


def _pairs(counters: list[int]) -> tuple[tuple[int, int], ...]:
    if len(counters) % 2 or any(a > b for a, b in itertools.pairwise(counters)):
        raise ValueError("ranges of counters are pairs, in order")
    return tuple(zip(counters[::2], counters[1::2], strict=True))


def encode_request(request: Request) -> bytes:
    """A request as bytes."""
    context = list(request.context.ranges())
    return _encoder.encode(_Request(VERSION, request.replica, 0.0, context, 0, []))


def decode_request(payload: bytes) -> Request:
    """The request in `payload`. Raises `WireError` unless all of it is valid."""
    return decoded(payload, f"request of {len(payload)} bytes", _read_request)


def _read_request(payload: bytes) -> Request:
    _check_length(payload)
    message = _request_decoder.decode(payload)
    _check_version(message.version)
    return Request(message.replica, CausalContext(_checked_range(*dots) for dots in message.context))
