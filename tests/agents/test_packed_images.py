"""A packed image is as large as its decoder finds it, or it is none."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.packed_images import encoded_size, unpacked
from dsr.errors import WireError

COLOR = np.zeros((60, 80, 3), np.uint8)
SMALL = b"\xff\xc0\x00\x11\x08\x00\x01\x00\x01\x03" + bytes(8)
"""A segment that tells a size of one pixel"""


def packed(ending: str) -> bytes:
    return bytes(cv2.imencode(ending, COLOR)[1])


@pytest.mark.parametrize("ending", [".jpg", ".png"])
def test_the_size_is_that_of_the_image(ending: str) -> None:
    assert encoded_size(packed(ending)) == (80, 60) and unpacked(packed(ending)).shape == COLOR.shape


def hidden(marker: bytes) -> bytes:
    """A JPEG with a second size, where only who takes `marker` for the beginning of a segment looks for it."""
    jpeg = packed(".jpg")
    return jpeg[:2] + marker + b"\xff\xe0" + (2 + len(SMALL)).to_bytes(2, "big") + SMALL + jpeg[2:]


@pytest.mark.parametrize("marker", [b"", b"\xff", b"\xff\x00", b"\xff\x01", b"\xff\xd0", b"\x00"])
def test_no_jpeg_has_another_size_than_its_decoder_finds(marker: bytes) -> None:
    """Who passes over `\\xff\\x00` as over a segment reads a made-up size, and unpacks gigabytes."""
    shape = cv2.imdecode(np.frombuffer(hidden(marker), np.uint8), cv2.IMREAD_UNCHANGED)
    assert encoded_size(hidden(marker)) in (None, None if shape is None else shape.shape[1::-1])
    sized = b"\xff\xd8" + marker + (len(SMALL) + 2).to_bytes(2, "big") + bytes(2) + SMALL + packed(".jpg")[2:]
    assert encoded_size(sized) is None


@settings(max_examples=200)
@given(st.binary(max_size=100).map(lambda rest: b"\xff\xd8\xff" + rest) | st.binary(max_size=60))
def test_any_bytes_are_refused_or_have_a_size(data: bytes) -> None:
    size = encoded_size(data)
    assert size is None or min(size) >= 0
    with pytest.raises(WireError):
        unpacked(data)
