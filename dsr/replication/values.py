"""The values of attributes in MessagePack: what an attribute may have, and nothing else.

A value of another kind than its built-in attribute has, a vector of another length, and numbers that nothing has count
as taken away. All replicas read them so, and nobody need expect text for a mass. Names that users register are not
checked: replicas may differ in what they mean.

A pose is extension type 1: little-endian doubles x y z qx qy qz qw stamp, then, if known, the 36 of the covariance row
by row.
"""

from __future__ import annotations

import math
import struct
from typing import Any

import msgspec

from dsr.crdt.delta import TOMBSTONE
from dsr.errors import WireError
from dsr.graph.schema import BUILT_IN, MAX_LENGTH, Kind, is_within_bounds
from dsr.math3d.transforms import Pose

_POSE_CODE = 1
_POSE = struct.Struct("<8d")
_POSE_COVARIANCE = struct.Struct("<44d")
_UNIT_TOLERANCE = 1e-12
"""Rounding of a unit quaternion: within it the sender's numbers are taken as they are."""
_Plain = None | bool | int | float | str | list[float] | msgspec.msgpack.Ext
_plain_decoder: msgspec.msgpack.Decoder[Any] = msgspec.msgpack.Decoder(_Plain)
_bytes_decoder = msgspec.msgpack.Decoder(bytes)


def encode_extension(value: Any) -> Any:
    """What MessagePack knows no type for. Raises `TypeError` for a value that no attribute may have."""
    if isinstance(value, Pose):
        numbers = (*value.t, *value.q, value.stamp)
        if value.cov is None:
            return msgspec.msgpack.Ext(_POSE_CODE, _POSE.pack(*numbers))
        return msgspec.msgpack.Ext(_POSE_CODE, _POSE_COVARIANCE.pack(*numbers, *value.cov))
    raise TypeError(f"{type(value).__name__} cannot be sent")


def _decode_extension(code: int, data: bytes | bytearray | memoryview) -> Pose:
    if code == _POSE_CODE and len(data) == _POSE.size:
        tx, ty, tz, x, y, z, w, stamp = _POSE.unpack(data)
        if abs(x * x + y * y + z * z + w * w - 1.0) < _UNIT_TOLERANCE and math.isfinite(tx + ty + tz + stamp):
            return Pose.unchecked((tx, ty, tz), (x, y, z, w), stamp)
        return Pose((tx, ty, tz), (x, y, z, w), stamp)
    if code == _POSE_CODE and len(data) == _POSE_COVARIANCE.size:
        numbers = _POSE_COVARIANCE.unpack(data)
        if math.isfinite(sum(numbers)):
            return Pose.of_floats(numbers[:3], numbers[3:7], numbers[7], numbers[8:])
        return Pose(numbers[:3], numbers[3:7], numbers[7], numbers[8:])
    raise WireError(f"extension {code} of {len(data)} bytes")


_SHORTEST_NUMBER = 5
"""Bytes of a float of 32 bits."""
_LONG = 1 << 10
"""Bytes of a value above which its numbers are counted before they are read."""
_LENGTHS = {0xDC: struct.Struct(">xH"), 0xDD: struct.Struct(">xI")}
"""How arrays of MessagePack that are not short tell their length, by first byte."""


def to_value(raw: msgspec.Raw) -> Any:
    """The value in MessagePack; raises `ValueError` if no attribute may have it."""
    if len(raw) > _LONG:
        _check_numbers(memoryview(raw))
    try:
        value = _plain_decoder.decode(raw)
    except msgspec.ValidationError:  # one type for both text and bytes is beyond msgspec 0.22
        value = _bytes_decoder.decode(raw)
    kind = type(value)
    if kind is msgspec.msgpack.Ext:
        return _decode_extension(value.code, value.data)
    if kind is list:
        if len(value) <= MAX_LENGTH and (math.isfinite(sum(value)) or all(map(math.isfinite, value))):
            return tuple(value)
    elif kind is str or kind is bytes:
        if len(value) <= MAX_LENGTH:
            return value
    elif kind is float:
        if math.isfinite(value):
            return value
    elif value is None:
        return TOMBSTONE
    elif kind is bool or -(1 << 63) <= value < (1 << 63):
        return value
    raise ValueError(f"a {kind.__name__} that no attribute may have")


_CLASSES: dict[Kind, type] = {
    "bool": bool, "int": int, "float": float, "str": str, "bytes": bytes, "vector": tuple, "pose": Pose,
}  # fmt: skip
_CLASS_OF = {name: _CLASSES[attribute.kind] for name, attribute in BUILT_IN.items()}
_WITH_NUMBERS = (float, tuple, Pose)
_LENGTH_OF = {name: attribute.length for name, attribute in BUILT_IN.items() if attribute.length is not None}


def fitted(attribute: str, value: Any) -> Any:
    """The value as it is read: what no such attribute has is `TOMBSTONE`, an integer is a float where one is wanted."""
    kind, wanted = value.__class__, _CLASS_OF.get(attribute)
    if wanted is None or value is TOMBSTONE:
        return value
    if kind is int and wanted is float:
        kind, value = float, float(value)
    if kind is not wanted or (kind in _WITH_NUMBERS and not is_within_bounds(value)):
        return TOMBSTONE
    length = _LENGTH_OF.get(attribute)
    return value if length is None or len(value) == length else TOMBSTONE


def _check_numbers(raw: memoryview) -> None:
    """Raise `ValueError` for a long array that holds something smaller than floats: as such it would grow."""
    length = _LENGTHS.get(raw[0])
    if length is not None and _SHORTEST_NUMBER * length.unpack_from(raw)[0] > len(raw):
        raise ValueError("an array of something else than floats")
