"""`tf2_msgs/TFMessage` to and from CDR without an object for each field: tf is what a robot sends most of."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from typing import NamedTuple

from agents.ros_bridge.errors import RosMessageError
from agents.ros_bridge.mapping.stamps import split
from dsr.math3d.quaternions import Quaternion, Vector3
from dsr.math3d.transforms import Pose

TF = "tf2_msgs/msg/TFMessage"
_LEAST = 76
"""bytes of a transform: none is shorter, so no message holds more of them than its length allows"""
_ORDERS = {b"\x00\x00": ">", b"\x00\x01": "<"}
"""Byte order by the first two bytes of the encapsulation header, of plain CDR"""
_LONGEST_NAME = 4096
"""bytes of a frame's name"""


class Transform(NamedTuple):
    """One transform of a message: where the child frame is in the parent's."""

    parent: str
    child: str
    stamp: float
    """s; 0 if the message says so"""
    translation: Vector3
    """m"""
    rotation: Quaternion
    """x, y, z, w"""

    def pose(self, stamp: float) -> Pose:
        """parent_from_child at another stamp (s). Raises `RosMessageError` for numbers that are no transform."""
        try:
            return Pose(self.translation, self.rotation, stamp)
        except ValueError as error:
            raise RosMessageError(f"transform {self.parent!r} -> {self.child!r}: {error}") from error


def read_tf(cdr: bytes | memoryview) -> list[Transform]:
    """Read the transforms of a message. Raises `RosMessageError` for bytes that are none, whatever lengths they claim."""
    view = bytes(cdr)
    order = _ORDERS.get(view[:2])
    if order is None:
        raise RosMessageError(f"a TFMessage begins with {view[:4].hex()}: no plain CDR")
    body = view[4:]
    word, words, numbers = struct.Struct(f"{order}I"), struct.Struct(f"{order}iII"), struct.Struct(f"{order}7d")
    try:
        (count,) = word.unpack_from(body, 0)
        if count * _LEAST > len(body) + _LEAST:
            raise RosMessageError(f"a TFMessage of {len(body)} bytes claims {count} transforms")
        at, found = 4, []
        for _ in range(count):
            at += -at & 3
            sec, nanosec, length = words.unpack_from(body, at)
            parent, at = _text(body, at + 12, length), at + 12 + length
            at += -at & 3
            (length,) = word.unpack_from(body, at)
            child, at = _text(body, at + 4, length), at + 4 + length
            at += -at & 7
            x, y, z, qx, qy, qz, qw = numbers.unpack_from(body, at)
            at += 56
            found.append(Transform(parent, child, sec + nanosec * 1e-9, (x, y, z), (qx, qy, qz, qw)))
    except struct.error as error:
        raise RosMessageError(f"a TFMessage of {len(view)} bytes is cut off: {error}") from error
    return found


def encode_tf(transforms: Iterable[tuple[str, str, float, Pose]]) -> bytes:
    """A message of (parent, child, stamp in s, parent_from_child). Raises `RosMessageError` for a stamp beyond ROS."""
    parts: list[bytes] = []
    size, count = 4, 0
    for parent, child, stamp, pose in transforms:
        sec, nanosec = split(stamp)
        first, second = parent.encode(), child.encode()
        head = -size & 3
        size += head + 12 + len(first) + 1
        middle = -size & 3
        size += middle + 4 + len(second) + 1
        tail = -size & 7
        size += tail + 56
        parts += [
            b"\0" * head, _WORDS.pack(sec, nanosec, len(first) + 1), first, b"\0" * (1 + middle),
            _WORD.pack(len(second) + 1), second, b"\0" * (1 + tail), _NUMBERS.pack(*pose.t, *pose.q),
        ]  # fmt: skip
        count += 1
    return b"".join((b"\0\x01\0\0", _WORD.pack(count), *parts))


_WORD, _WORDS, _NUMBERS = struct.Struct("<I"), struct.Struct("<iII"), struct.Struct("<7d")


def _text(body: bytes, at: int, length: int) -> str:
    """A name with its closing zero, within the body."""
    if not 1 <= length <= _LONGEST_NAME or at + length > len(body) or body[at + length - 1]:
        raise RosMessageError(f"a frame's name of {length} bytes at {at} in a TFMessage of {len(body)} bytes")
    try:
        return body[at : at + length - 1].decode()
    except UnicodeDecodeError as error:
        raise RosMessageError(f"a frame's name in a TFMessage: {error}") from error


def same(one: Pose, other: Pose) -> bool:
    """Whether two transforms are the same but for rounding: one of them is the other, sent once more."""
    metres, radians = one.distance(other)
    return metres <= _ROUNDING and radians <= _ROUNDING


_ROUNDING = 1e-6
"""m and rad by which a transform may change when somebody passes it on as numbers of single precision"""
