"""Messages of tf read by the layout of earlier ones, against the decoder that knows of none."""

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.ros_bridge.errors import RosMessageError
from agents.ros_bridge.messages.tf_batches import TfBatch, TfDecoder
from agents.ros_bridge.messages.transforms import StampedTransform, decode_transforms, encode_transforms
from tests.agents.ros_bridge.test_transform_messages import NAMES

WRITER = b"writer"
FRAMES = st.lists(st.tuples(NAMES, NAMES), min_size=8, max_size=20)
SEEDS = st.integers(0, 2**32)


def message(frames: list[tuple[str, str]], seed: int) -> bytes:
    """One with other numbers for each seed."""
    chance = random.Random(seed)
    return encode_transforms(
        StampedTransform(
            chance.randrange(-(2**31), 2**31), chance.randrange(2**32), parent, child,
            tuple(chance.uniform(-9.0, 9.0) for _ in range(7)),  # type: ignore[arg-type]
        )
        for parent, child in frames
    )  # fmt: skip


def content(batch: TfBatch) -> list[tuple[tuple[str, str], float, tuple[float, ...]]]:
    numbers = [tuple(seven) for seven in batch.numbers]
    return list(zip(batch.names, batch.stamps, numbers, strict=True))


def expected(cdr: bytes) -> list[tuple[tuple[str, str], float, tuple[float, ...]]]:
    return [((one.parent, one.child), one.sec + one.nanosec * 1e-9, one.pose) for one in decode_transforms(cdr)]


@given(FRAMES, FRAMES, SEEDS)
def test_what_follows_is_read_as_if_it_came_alone(
    frames: list[tuple[str, str]], others: list[tuple[str, str]], seed: int
) -> None:
    decoder = TfDecoder()
    for number, names in enumerate((frames, frames, others, others[:3], frames, frames)):
        cdr = message(names, seed + number)
        assert content(decoder.decode(memoryview(cdr), WRITER)) == expected(cdr)


@given(FRAMES, SEEDS, st.integers(0, 1500), st.binary(max_size=8))
def test_a_broken_message_is_refused_or_read_as_if_it_came_alone(
    frames: list[tuple[str, str]], seed: int, place: int, other: bytes
) -> None:
    decoder = TfDecoder()
    cdr = message(frames, seed)
    decoder.decode(cdr, WRITER)
    broken = cdr[:place] + other + cdr[place + len(other) :]
    try:
        right = repr(expected(broken))  # as text, for not a number is unlike itself
    except RosMessageError:
        with pytest.raises(RosMessageError):
            decoder.decode(broken, WRITER)
    else:
        assert repr(content(decoder.decode(broken, WRITER))) == right


def test_bytes_in_between_may_be_anything() -> None:
    frames = [("world", f"link_{number}") for number in range(10)]
    cdr = bytearray(message(frames, 1))
    decoder = TfDecoder()
    decoder.decode(bytes(cdr), WRITER)
    place = cdr.index(b"world\0") + len(b"world\0")
    assert cdr[place : place + 2] == b"\0\0"
    cdr[place : place + 2] = b"ab"
    assert decoder.decode(bytes(cdr), WRITER).names is decoder.decode(bytes(cdr), WRITER).names
    assert content(decoder.decode(bytes(cdr), WRITER)) == expected(bytes(cdr))


def test_publishers_that_are_made_up_do_not_fill_the_memory() -> None:
    frames = [("world", f"link_{number}") for number in range(10)]
    decoder = TfDecoder()
    for number in range(1000):
        decoder.decode(message(frames, number), number.to_bytes(16, "little"))
    assert len(decoder._layouts) == 256


def test_long_names_do_not_fill_the_memory() -> None:
    decoder = TfDecoder()
    for length in range(20):
        name = "w" * (100_000 + length)
        decoder.decode(message([(name, f"link_{number}") for number in range(8)], length), WRITER)
    assert 1 <= len(decoder._layouts) <= 5 and decoder._bytes == sum(size for _, size in decoder._layouts) <= 1 << 22
    decoder.decode(message([("w" * 1_000_000, f"link_{number}") for number in range(8)], 1), WRITER)
    assert decoder._bytes <= 1 << 22, "one that is larger than all that may be remembered is not"
