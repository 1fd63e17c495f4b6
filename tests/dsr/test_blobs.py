"""Frames: encoded without loss, decoded without a copy, refused when malformed."""

from __future__ import annotations

import contextlib
import random

import msgspec
import numpy as np
import pytest

from dsr import Frame, WireError
from dsr.images.blobs import decode_frame, encode_frame
from tests.dsr.conftest import Net


def sample() -> Frame:
    generator = np.random.default_rng(3)
    return Frame(
        1.5,
        {
            "color": generator.integers(0, 255, (7, 5, 3), dtype=np.uint8),
            "depth": generator.random((7, 5)).astype(np.float32),
            "empty": np.zeros((0, 4), np.float64),
        },
        {"fx": 525.0, "width": 5, "name": "overhead"},
    )


def test_round_trip_without_a_copy() -> None:
    payload = encode_frame(sample())
    frame = decode_frame(payload)
    assert (frame.stamp, frame.meta) == (1.5, sample().meta)
    for name, array in sample().arrays.items():
        assert frame.arrays[name].dtype == array.dtype and np.array_equal(frame.arrays[name], array)
    assert np.shares_memory(frame.arrays["color"], np.frombuffer(payload, np.uint8))
    with pytest.raises(ValueError, match="read-only"):
        frame.arrays["depth"][0, 0] = 1.0


def test_non_contiguous_arrays_are_sent_in_order() -> None:
    image = np.arange(24, dtype=np.uint8).reshape(4, 6)[:, ::-2]
    assert np.array_equal(decode_frame(encode_frame(Frame(0.0, {"i": image}, {}))).arrays["i"], image)


def test_dtypes_that_are_not_numbers_are_refused() -> None:
    with pytest.raises(ValueError, match="dtype"):
        encode_frame(Frame(0.0, {"x": np.array(["a"])}, {}))


def test_truncated_and_mutated_frames_raise_wire_errors_only() -> None:
    payload = encode_frame(sample())
    for length in range(0, len(payload), 7):
        with pytest.raises(WireError):
            decode_frame(payload[:length])
    generator = random.Random(1)
    for _ in range(5000):
        damaged = bytearray(payload)
        damaged[generator.randrange(120)] = generator.randrange(256)
        with contextlib.suppress(WireError):
            decode_frame(bytes(damaged))


def test_readers_get_the_newest_frame_once(net: Net) -> None:
    camera, viewer = net.join("camera"), net.join("viewer")
    reader = viewer.frames("camera_overhead")
    for stamp in (1.0, 2.0, 3.0):
        camera.put_frame("camera_overhead", Frame(stamp, {}, {}))
    assert reader.latest() is None
    net.pump()
    newest = reader.latest()
    assert newest is not None and newest.stamp == 3.0 and reader.latest() is None
    camera.transport.publish(camera.keys.blob("camera_overhead"), b"garbage")
    net.pump()
    assert reader.latest() is None and reader.dropped == 1
    reader.close()


def test_an_empty_array_with_an_endless_side_is_refused() -> None:
    header = msgspec.msgpack.encode([1.0, {}, [["a", "uint8", [0, 2**62, 4], 0]]])
    with pytest.raises(WireError):
        decode_frame(len(header).to_bytes(4, "little") + header + bytes(-(4 + len(header)) % 8))
