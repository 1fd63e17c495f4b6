"""Lists of transforms (`tf2_msgs/msg/TFMessage`) encoded and decoded without an object for each of their parts.

Robots send hundreds of transforms a hundred times a second; by objects it would cost five times as much or more.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from functools import lru_cache
from typing import NamedTuple

from agents.ros_bridge.errors import RosMessageError

TF_MESSAGE = "tf2_msgs/msg/TFMessage"

_LITTLE, _BIG = b"\x00\x01\x00\x00", b"\x00\x00\x00\x00"
_HEADER = len(_LITTLE)
_LAYOUTS = 4096
"""Lengths of names that are remembered: one for each pair of frames, and place in the message"""
_LEAST = 80
"""Bytes of a transform between frames of empty names"""


class StampedTransform(NamedTuple):
    """Where a frame is in its parent frame at a time."""

    sec: int
    """s since the Unix epoch, whole ones"""
    nanosec: int
    parent: str
    child: str
    pose: tuple[float, float, float, float, float, float, float]
    """parent_from_child: translation (m), then a quaternion (x, y, z, w)"""


def encode_transforms(transforms: Iterable[StampedTransform]) -> bytes:
    """A `TFMessage` in CDR. Raises `RosMessageError` for values that do not fit."""
    pieces, place, number = [], 4, 0
    try:
        for sec, nanosec, parent, child, pose in transforms:
            of_parent, of_child = parent.encode(), child.encode()
            layout = _layout(len(of_parent), len(of_child), place & 7)
            pieces.append(layout.pack(sec, nanosec, len(of_parent) + 1, of_parent, len(of_child) + 1, of_child, *pose))
            place += layout.size
            number += 1
    except (struct.error, UnicodeEncodeError, ValueError, TypeError, AttributeError) as error:
        raise RosMessageError(f"no {TF_MESSAGE} can be made of these values: {error}") from error
    return b"".join((_LITTLE, struct.pack("<I", number), *pieces))


def decode_transforms(cdr: bytes | memoryview) -> list[StampedTransform]:
    """The transforms of a `TFMessage` in CDR of either byte order.

    Raises:
        RosMessageError: for bytes that are no such message; no more is allocated than they can hold.
    """
    begin = bytes(cdr[:2])
    order = "<" if begin == _LITTLE[:2] else ">" if begin == _BIG[:2] else None
    if order is None or len(cdr) < _HEADER:
        raise RosMessageError(f"{len(cdr)} bytes are no {TF_MESSAGE}: no encapsulation that is known")
    data = bytes(cdr)
    stamp, length, pose = (_formats(order + kind).unpack_from for kind in ("iII", "I", "7d"))
    try:
        (number,) = length(data, _HEADER)
        place = _HEADER + 4
        if number * _LEAST > len(data):
            raise RosMessageError(f"{len(data)} bytes are no {TF_MESSAGE}: they cannot hold {number} transforms")
        found = []
        for _ in range(number):
            place = (place + 3) & -4
            sec, nanosec, size = stamp(data, place)
            place += 12
            parent = _text(data, place, size)
            place = (place + size + 3) & -4
            (size,) = length(data, place)
            place += 4
            child = _text(data, place, size)
            # Numbers of 8 bytes are aligned to the message behind the header of 4.
            place = ((place + size - _HEADER + 7) & -8) + _HEADER
            found.append(StampedTransform(sec, nanosec, parent, child, pose(data, place)))
            place += 56
    except (struct.error, UnicodeDecodeError) as error:
        raise RosMessageError(f"{len(data)} bytes are no {TF_MESSAGE}: {error}") from error
    return found


def _text(data: bytes, place: int, size: int) -> str:
    end = place + size - 1
    if size < 1 or end >= len(data) or data[end]:
        raise RosMessageError(f"{len(data)} bytes are no {TF_MESSAGE}: a name of {size} bytes at {place}")
    return data[place:end].decode()


@lru_cache(_LAYOUTS)
def _layout(parent: int, child: int, place: int) -> struct.Struct:
    """Of a transform between frames with names of so many bytes, which begins `place` bytes after a multiple of 8."""
    before = -place % 4
    end = place + before + 12 + parent + 1
    between = -end % 4
    end += between + 4 + child + 1
    return struct.Struct(f"<{before}xiII{parent}sx{between}xI{child}sx{-end % 8}x7d")


@lru_cache
def _formats(kind: str) -> struct.Struct:
    return struct.Struct(kind)
