"""Wire format: golden bytes, readable by plain MessagePack, and nothing malformed gets through."""

from __future__ import annotations

import math
import random
import struct
from typing import Any

import msgpack
import msgspec
import numpy as np
import pytest

from dsr import Pose, WireError
from dsr.crdt.context import CausalContext
from dsr.crdt.delta import TOMBSTONE, Add, Delta, Write
from dsr.replication.values import encode_extension, to_value
from dsr.replication.wire import (
    Digest,
    decode_delta,
    decode_digest,
    encode_delta,
    encode_digest,
)


def sample() -> Delta:
    delta = Delta()
    delta.adds = [
        Add(("a", 1), "cube_3", "cube"),
        Add(("a", 2), ("cube_3", "table", "on"), "on", (("a", 1),), (("b", 7),)),
    ]
    pose = Pose((1, 2, 3), (0, 0, 0, 1), 4.5)
    delta.writes = [
        Write(("a", 1), "mass", 99, "a", ("a", 3), 0.25),
        Write(("a", 2), "pose", 100, "a", None, pose),
        Write(("a", 1), "note", 101, "b", ("a", 4), TOMBSTONE),
        Write(("a", 1), "area", 102, "b", ("b", 1), (0.5, 1.0)),
        Write(("a", 1), "perceived", 103, "b", ("b", 2), True),
    ]
    delta.removed = [("b", 5)]
    delta.context = [("a", 1, 4), ("b", 1, 2)]
    return delta


GOLDEN = bytes.fromhex(
    "9701"  # version
    "92a161a162"  # replicas a, b
    "92"  # adds
    "960001a6637562655f33a46375626590" + "90"
    "96000293a6637562655f33a57461626c65a26f6ea26f6e9200019201" + "07"
    "95"  # writes
    "980001a46d617373630000" + "03cb3fd0000000000000"
    "980002a4706f736564000000c74001" + struct.pack("<8d", 1, 2, 3, 0, 0, 0, 1, 4.5).hex() + "980001a46e6f746565010004c0"
    "980001a4617265616601010192cb3fe0000000000000cb3ff0000000000000"
    "980001a970657263656976656467010102c3"
    "920105"  # removed
    "96000104010102"  # context
    "c0"  # no list of live dots
)


def as_tuple(delta: Delta) -> tuple[object, ...]:
    return delta.adds, delta.writes, delta.removed, delta.context, delta.live
GOLDEN_DIGEST = "9702a161cb40290000000000009292a16192010592a162920304cf5c54494706595159cf800000000000000191a163"


def test_golden_bytes() -> None:
    assert encode_delta(sample()).hex() == GOLDEN.hex()


def test_round_trip() -> None:
    assert as_tuple(decode_delta(encode_delta(sample()))) == as_tuple(sample())
    reply = sample()
    reply.live = frozenset({("a", 1), ("b", 9)})
    assert decode_delta(encode_delta(reply)).live == reply.live


def test_replicas_of_one_process_share_what_a_long_message_tells() -> None:
    pose = Pose((1, 2, 3), (0, 0, 0, 1), 4.5, tuple(np.eye(6).ravel()))
    delta = Delta(writes=[Write(("a", n), "pose", 100, "a", None, pose) for n in range(1, 9)], context=[("a", 1, 8)])
    one, other = decode_delta(encode_delta(delta)), decode_delta(encode_delta(delta))
    assert as_tuple(one) == as_tuple(other) == as_tuple(delta)
    assert all(here is there for here, there in zip(one.writes, other.writes, strict=True))
    one.context = []
    one.writes.clear()
    one.extend_context([("b", 1, 1)])
    assert as_tuple(decode_delta(encode_delta(delta))) == as_tuple(delta)


@pytest.mark.parametrize("owner", ["a", "b", "c"])
@pytest.mark.parametrize("writer", ["a", "b"])
@pytest.mark.parametrize("dot", [None, ("a", 4), ("b", 4), ("c", 9)])
@pytest.mark.parametrize("context", [[], [("a", 4, 4)], [("b", 1, 4), ("a", 2, 3)]])
@pytest.mark.parametrize("value", [0.25, TOMBSTONE, "text"])
def test_one_write_alone_has_the_bytes_of_the_layout(
    owner: str, writer: str, dot: tuple[str, int] | None, context: list[tuple[str, int, int]], value: Any
) -> None:
    delta = Delta(writes=[Write((owner, 3), "area", 99, writer, dot, value)], context=context)
    dot_rid, dot_counter = dot or (writer, 0)
    names = list(dict.fromkeys([owner, writer, dot_rid, *(rid for rid, _, _ in context)]))
    index = names.index
    sent = None if value is TOMBSTONE else value
    row = [index(owner), 3, "area", 99, index(writer), index(dot_rid), dot_counter, sent]
    flat = [number for rid, first, last in context for number in (index(rid), first, last)]
    assert msgpack.unpackb(encode_delta(delta)) == [1, names, [], [row], [], flat, None]
    assert as_tuple(decode_delta(encode_delta(delta))) == as_tuple(delta)


def test_plain_messagepack_reads_it() -> None:
    version, replicas, adds, writes, *_ = msgpack.unpackb(encode_delta(sample()))
    assert (version, replicas, adds[0][2]) == (1, ["a", "b"], "cube_3")
    assert writes[1][7] == msgpack.ExtType(1, struct.pack("<8d", 1, 2, 3, 0, 0, 0, 1, 4.5))


def test_covariance_travels() -> None:
    covariance = [[1.0 * (row == column) for column in range(6)] for row in range(6)]
    delta = Delta()
    delta.writes = [Write(("a", 1), "pose", 1, "a", None, Pose((0, 0, 0), covariance=covariance))]
    pose = decode_delta(encode_delta(delta)).writes[0].value
    assert pose.covariance.tolist() == covariance


def test_digest_round_trip() -> None:
    seen = CausalContext([("a", 1, 5), ("b", 3, 4)])
    digest = Digest("a", 12.5, seen.summary("a"), 2**63 + 1, ("c",))
    assert decode_digest(encode_digest(digest)) == digest
    assert encode_digest(digest).hex() == GOLDEN_DIGEST


def test_a_digest_of_version_1_is_read_as_recordings_hold_it() -> None:
    seen = CausalContext([("a", 1, 5), ("b", 3, 4), ("b", 8, 9)])
    first = msgpack.packb([1, "a", 12.5, list(seen.ranges()), 7, ["c"]])
    assert decode_digest(first) == Digest("a", 12.5, seen.summary(), 7, ("c",))
    for wrong in ([3, "a", 12.5, [], 7, []], [1, "a", 12.5, [["b", 4, 3]], 7, []], [1, "a", math.nan, [], 7, []]):
        with pytest.raises(WireError):
            decode_digest(msgpack.packb(wrong))


def message(**changes: object) -> bytes:
    fields: dict[str, object] = {
        "version": 1, "replicas": ["a"], "adds": [], "writes": [], "removed": [], "context": [], "live": None,
    }  # fmt: skip
    return msgpack.packb(list({**fields, **changes}.values()))


def ext(*numbers: float) -> msgpack.ExtType:
    return msgpack.ExtType(1, struct.pack(f"<{len(numbers)}d", *numbers))


def written(value: object) -> bytes:
    return message(writes=[[0, 1, "x", 1, 0, 0, 0, value]])


def test_the_unchanged_message_is_valid() -> None:
    assert not decode_delta(message())
    assert decode_delta(written(1.5)).writes[0].value == 1.5


@pytest.mark.parametrize(
    "payload",
    [
        b"", b"\xc1", b"hello", msgpack.packb({"a": 1}), message()[:-1],
        message(version=2), message(replicas=[""]), message(replicas=["x" * 300]), message(replicas=[3]),
        message(adds=[[1, 1, "n", "cube", [], []]]), message(adds=[[0, 0, "n", "cube", [], []]]),
        message(adds=[[0, 1, ["a", "b"], "on", [0, 1], [0, 1]]]), message(adds=[[0, 1, "n", "cube", [0, 1], []]]),
        message(adds=[[0, 1, ["a", "b", "on"], "on", [], []]]), message(adds=[[0, 1, "", "cube", [], []]]),
        message(removed=[0]), message(removed=[0, 0]), message(removed=[7, 1]), message(removed=[0, -1]),
        message(context=[0, 1]), message(context=[0, 5, 4]), message(context=[0, 2, 2**54]), message(context=[0, 0, 4]),
        message(live=[0]), message(live=[9, 9]),
        written(float("nan")), written(float("inf")), written({"a": 1}), written([1.0, "x"]), written([[1.0]]),
        written([1.0, float("nan")]), written(2**63), written(msgpack.ExtType(2, b"")),
        written(ext(1, 2, 3, 0, 0, 0, 2, 0)), written(ext(1, 2, float("nan"), 0, 0, 0, 1, 0)), written(ext(1, 2)),
        message(writes=[[0, 1, "x", -1, 0, 0, 0, 1]]), message(writes=[[0, 1, "", 1, 0, 0, 0, 1]]),
        message(writes=[[0, 1, "x", 1, 5, 0, 0, 1]]), message(writes=[[0, 1, "x", 1, 0, 5, 1, 1]]),
        message(writes=[[-1, 1, "x", 1, 0, 0, 0, 1]]),
    ],
    ids=lambda payload: payload[:24].hex(),
)  # fmt: skip
def test_malformed_deltas_are_refused(payload: bytes) -> None:
    with pytest.raises(WireError):
        decode_delta(payload)


@pytest.mark.parametrize(
    "payload",
    [b"", b"\x00", message(), msgpack.packb([1, "a", 1.0, [], 0, 0, []]),
     msgpack.packb([2, "a", float("nan"), [], 0, 0, []]), msgpack.packb([2, "a", 1.0, [], -1, 0, []]),
     *(msgpack.packb([2, "a", 1.0, recent, 0, 0, []]) for recent in (
         [["a", [1, 2**54]]], [["a", [0, 2]]], [["a", []]], [["a", [1]]], [["a", [3, 2]]], [["a", [3, 5, 4, 6]]],
         [["a", [1, 2]], ["a", [1, 2]]], [["a", list(range(1, 19))]], [[f"r{n}", [1, 2]] for n in range(33)]))],
)  # fmt: skip
def test_malformed_digests_are_refused(payload: bytes) -> None:
    with pytest.raises(WireError):
        decode_digest(payload)


def test_mutated_messages_raise_nothing_else() -> None:
    generator = random.Random(5)
    originals = [encode_delta(sample()), encode_digest(Digest("a", 1.0, CausalContext([("a", 1, 3)]).summary(), 5, ()))]
    refused = 0
    for _ in range(20_000):
        payload = bytearray(generator.choice(originals))
        for _ in range(generator.randrange(1, 4)):
            payload[generator.randrange(len(payload))] = generator.randrange(256)
        for decode in (decode_delta, decode_digest):
            try:
                decode(bytes(payload))
            except WireError:
                refused += 1
    assert refused > 20_000


@pytest.mark.parametrize(
    ("place", "number", "reason"),
    [
        (8, -1e-6, "variances cannot be negative"),
        (9, 1e-3, "not symmetric"),
        (8, math.inf, "finite"),
        (8, math.nan, "finite"),
        (3, 0.5, "rotation"),
    ],
)
def test_a_pose_whose_numbers_fit_no_pose_is_refused_as_where_it_is_made(
    place: int, number: float, reason: str
) -> None:
    numbers = [1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0, 5.0, *(1e-6 * (k % 7 == 0) for k in range(36))]
    code = encode_extension(Pose()).code
    made = Pose(numbers[:3], numbers[3:7], numbers[7], tuple(numbers[8:]))
    assert to_value(msgspec.Raw(msgspec.msgpack.encode(encode_extension(made)))) == made
    numbers[place] = number
    raw = msgspec.Raw(msgspec.msgpack.encode(msgspec.msgpack.Ext(code, struct.pack("<44d", *numbers))))
    with pytest.raises(ValueError, match=reason):
        to_value(raw)
