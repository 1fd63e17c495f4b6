"""Camera frames as streams of binary blobs: a small header, then raw buffers.

Layout of an encoded frame: 4 bytes little-endian header length, a MessagePack header
`[stamp, meta, [[name, dtype, shape, offset], ...]]`, then the arrays' bytes, each padded to 8 bytes.
"""

from __future__ import annotations

import math
import struct
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from dsr.errors import WireError
from dsr.network.decoding import decoded

_DTYPES = {"uint8", "uint16", "int32", "float32", "float64"}
_LENGTH = struct.Struct("<I")
_MAX_HEADER = 1 << 16
_ALIGN = 8
_MOST_AXES = 4  # of an array


class Frame(msgspec.Struct, frozen=True):
    """Arrays that belong to one instant, for example the colour and depth images of a camera."""

    stamp: float
    """s, when the shutter was open"""
    arrays: dict[str, NDArray[Any]]
    """Images and other arrays by name.

    Those of a received frame are read-only, and may lie in memory shared with its sender.
    """
    meta: dict[str, float | int | str]
    """Scalars, for a camera the intrinsics `fx fy cx cy` in px."""


class _Header(msgspec.Struct, array_like=True, frozen=True):
    stamp: float
    meta: dict[str, float | int | str]
    arrays: list[tuple[str, str, list[int], int]]


_encoder = msgspec.msgpack.Encoder()
_decoder = msgspec.msgpack.Decoder(_Header)


def encode_frame(frame: Frame) -> bytes:
    """The frame as one byte string; the arrays are copied once."""
    return b"".join(frame_chunks(frame))


def frame_chunks(frame: Frame) -> list[bytes | memoryview]:
    """The pieces of the encoded frame; arrays that are contiguous are not copied.

    Raises `ValueError` or `TypeError` for what no receiver could decode.
    """
    entries: list[tuple[str, str, list[int], int]] = []
    chunks: list[bytes | memoryview] = []
    offset = 0
    for name, array in frame.arrays.items():
        if array.dtype.name not in _DTYPES:
            raise ValueError(f"array {name!r} has dtype {array.dtype.name}; expected one of {sorted(_DTYPES)}")
        if array.ndim > _MOST_AXES:
            raise ValueError(f"array {name!r} has {array.ndim} axes; expected {_MOST_AXES} at most")
        padding = -array.nbytes % _ALIGN
        entries.append((name, array.dtype.name, list(array.shape), offset))
        chunks += [np.ascontiguousarray(array).reshape(-1).view(np.uint8).data, b"\0" * padding]
        offset += array.nbytes + padding
    header = _encoder.encode(_Header(frame.stamp, frame.meta, entries))
    _check(header)
    padding = _body_start(len(header)) - _LENGTH.size - len(header)
    return [_LENGTH.pack(len(header)), header, b"\0" * padding, *chunks]


def _check(header: bytes) -> None:
    """Raise `ValueError` for a header that no receiver takes: what is in a frame is whatever a driver puts there."""
    if len(header) > _MAX_HEADER:
        raise ValueError(f"a frame header of {len(header)} bytes; expected {_MAX_HEADER} at most")
    try:
        _decoder.decode(header)
    except msgspec.ValidationError as error:
        raise ValueError(f"frame header: {error}") from error


def decode_frame(payload: bytes | memoryview) -> Frame:
    """The frame of an encoded byte string; its arrays are views into `payload`. Raises `WireError`."""
    view = memoryview(payload)
    if len(view) < _LENGTH.size:
        raise WireError(f"a frame of {len(view)} bytes has no header")
    (length,) = _LENGTH.unpack_from(view)
    body = _body_start(length)
    if length > _MAX_HEADER or body > len(view):
        raise WireError(f"a frame of {len(view)} bytes claims a header of {length} bytes")
    copied = bytes(view[_LENGTH.size : _LENGTH.size + length])  # its writer may change shared memory meanwhile
    header = decoded(copied, "frame header", _decoder.decode)
    if not math.isfinite(header.stamp):
        raise WireError("frame header: the stamp is not finite")
    return Frame(header.stamp, {entry[0]: _array(view[body:], *entry) for entry in header.arrays}, header.meta)


def _body_start(header_length: int) -> int:
    return -(-(_LENGTH.size + header_length) // _ALIGN) * _ALIGN


def _array(body: memoryview, name: str, dtype: str, shape: list[int], offset: int) -> NDArray[Any]:
    if dtype not in _DTYPES or len(shape) > _MOST_AXES or any(n < 0 for n in shape):
        raise WireError(f"frame array {name!r}: dtype {dtype!r}, shape {shape}")
    size = math.prod(shape) * np.dtype(dtype).itemsize
    if offset < 0 or offset + size > len(body):
        raise WireError(f"frame array {name!r} needs {size} bytes at {offset}, the frame holds {len(body)}")
    try:
        array = np.frombuffer(body[offset : offset + size], dtype=dtype).reshape(shape)
    except ValueError as error:  # an empty array with a side beyond all bounds
        raise WireError(f"frame array {name!r} of shape {shape}: {error}") from error
    array.flags.writeable = False
    return array
