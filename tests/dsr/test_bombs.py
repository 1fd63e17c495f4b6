"""What is sent to exhaust who reads it: reading costs memory in proportion to the message, and it is refused."""

from __future__ import annotations

import struct
import tracemalloc
from collections.abc import Iterator
from contextlib import nullcontext

import msgpack
import pytest

from dsr.errors import WireError
from dsr.graph.schema import MAX_LENGTH
from dsr.replication.piece_wire import decode_piece, decode_request
from dsr.replication.wire import MAX_MESSAGE, MAX_STRUCTURE, MOST_NAMED, decode_delta, decode_digest
from tests.dsr.test_wire import message, written

SIZE = 1 << 20
"""Bytes of each bomb, or about."""
FACTOR = 12
"""Bytes of memory that may be taken for each byte of a message that is refused."""


def array(count: int, element: bytes) -> bytes:
    """An array in MessagePack."""
    return b"\xdd" + struct.pack(">I", count) + count * element


def with_raw(place: bytes, payload: bytes) -> bytes:
    """A message in which one text is replaced by MessagePack."""
    packed = msgpack.packb("BOMB")
    assert place.count(packed) == 1
    return place.replace(packed, payload)


def value(payload: bytes) -> bytes:
    return with_raw(written("BOMB"), payload)


def bombs() -> Iterator[tuple[str, bytes]]:
    empty = array(SIZE, b"\x90")
    key = message(adds=[[0, 1, "BOMB", "cube", [], []]])
    yield "value: empty arrays", value(empty)
    yield "value: empty arrays after a number", value(array(SIZE, b"\x90").replace(b"\x90", b"\xcb" + 8 * b"\0", 1))
    yield "value: numbers of one byte", value(array(SIZE, b"\x01"))
    yield "value: empty maps", value(array(SIZE, b"\x80"))
    yield "value: a map", value(b"\xdf" + struct.pack(">I", SIZE // 2) + SIZE // 2 * b"\x01\x90")
    yield "value: nested arrays", value(SIZE * b"\x91" + b"\xc0")
    yield "value: nested maps", value(SIZE // 2 * b"\x81\x01" + b"\xc0")
    yield "value: more numbers than a value has", value(array(MAX_LENGTH + 1, b"\xca" + 4 * b"\0"))
    yield "value: numbers that are not there", value(b"\xdd\xff\xff\xff\xff")
    yield "value: a giant extension", value(b"\xc9" + struct.pack(">I", SIZE) + b"\x01" + SIZE * b"\0")
    yield "key: empty arrays", with_raw(key, empty)
    yield "key: empty texts", with_raw(key, array(SIZE, b"\xa0"))
    yield "key: long text", with_raw(key, msgpack.packb(SIZE * "x"))
    yield "beside: texts", message(replicas=SIZE * ["a"])
    yield "beside: additions", message(adds=SIZE // 4 * [[0, 1, "a", "b", [], []]])
    yield "beside: writes", message(writes=SIZE // 4 * [[0, 1, "a", 0, 0, 0, 0, None]])
    yield "beside: removed", message(removed=(SIZE + 2) * [1])
    yield "beside: context", message(context=(SIZE + 2) * [1])
    yield "beside: sources", message(adds=[[0, 1, ["a", "b", "c"], "on", SIZE * [0, 1], [0, 1]]])
    yield "longer than any message", written("x") + MAX_MESSAGE * b"\0"


@pytest.mark.parametrize(("payload"), [pytest.param(payload, id=name) for name, payload in bombs()])
def test_a_bomb_is_refused_at_a_small_cost(payload: bytes) -> None:
    tracemalloc.start()
    try:
        with pytest.raises(WireError) as caught:
            decode_delta(payload)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < FACTOR * len(payload) + 10_000
    assert len(str(caught.value)) < 300, "what others sent is shown"


def test_a_piece_or_a_request_is_no_bomb() -> None:
    piece = [1, ["a"], [], [], [], [], None, ["", 0, ""], None, True, []]
    assert not decode_piece(msgpack.packb(piece)).adds
    for place in (1, 2, 3, 4, 5, 6, 10):
        bomb = msgpack.packb([*piece[:place], SIZE * [["BOMB"]], *piece[place + 1 :]])
        with pytest.raises(WireError):
            decode_piece(bomb)
    written = msgpack.packb([*piece[:3], [[0, 1, "x", 0, 0, 0, 0, "BOMB"]], *piece[4:]])
    with pytest.raises(WireError):
        decode_piece(with_raw(written, array(SIZE, b"\x90")))
    with pytest.raises(WireError):
        decode_request(msgpack.packb([1, "a", SIZE * [["a", 1, 2]], ["", 0, ""], False]))


def test_a_digest_is_no_bomb() -> None:
    payload = msgpack.packb([1, "a", 1.0, [["a", 1, 2]] * MAX_STRUCTURE, 0, []])
    with pytest.raises(WireError):
        decode_digest(payload)
    with pytest.raises(WireError):
        decode_digest(msgpack.packb([1, "a", 1.0, [], 0, MAX_STRUCTURE * ["a"]]))


@pytest.mark.parametrize("longest", ["x" * MAX_LENGTH, b"x" * MAX_LENGTH, [0.5] * MAX_LENGTH])
def test_the_longest_values_pass(longest: object) -> None:
    write = decode_delta(written(longest)).writes[0]
    assert write.value == (tuple(longest) if isinstance(longest, list) else longest)


def test_small_floats_of_other_languages_pass() -> None:
    assert decode_delta(value(array(3, b"\xca" + struct.pack(">f", 0.5)))).writes[0].value == (0.5, 0.5, 0.5)


def test_no_message_names_more_replicas_than_an_honest_one() -> None:
    """Who reads keeps these names of each peer: of a digest of 1 MB that would be 11 MB."""
    names = [f"r{number}" for number in range(MOST_NAMED + 1)]
    for named, fits in ((names[1:], True), (names, False)):
        piece = msgpack.packb([1, [], [], [], [], [], None, ["", 0, ""], None, False, named])
        first, second = (msgpack.packb([*head, named]) for head in ([1, "a", 0.0, [], 0], [2, "a", 0.0, [], 1, 0]))
        for decode, payload in ((decode_piece, piece), (decode_digest, first), (decode_digest, second)):
            with nullcontext() if fits else pytest.raises(WireError):
                decode(payload)
