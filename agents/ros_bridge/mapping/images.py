"""`sensor_msgs/Image` and `CompressedImage`, and the arrays of a frame: colour as RGB bytes, depth in metres."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.packed_images import unpacked
from agents.ros_bridge.errors import RosMessageError
from agents.ros_bridge.mapping.stamps import to_header
from agents.ros_bridge.messages.types import RosTypes
from dsr.config.extras import MissingExtraError
from dsr.errors import WireError

IMAGE = "sensor_msgs/msg/Image"
COMPRESSED = "sensor_msgs/msg/CompressedImage"
Color = NDArray[np.uint8]
Depth = NDArray[np.float32]

_MILLIMETRE = np.float32(1e-3)
_FORMATS: dict[str, tuple[str, int]] = {
    "rgb8": ("u1", 3), "bgr8": ("u1", 3), "rgba8": ("u1", 4), "bgra8": ("u1", 4), "mono8": ("u1", 1),
    "8uc1": ("u1", 1), "8uc3": ("u1", 3), "8uc4": ("u1", 4), "mono16": ("u2", 1), "16uc1": ("u2", 1),
    "32fc1": ("f4", 1), "rgb16": ("u2", 3), "bgr16": ("u2", 3),
    "yuv422": ("u1", 2), "uyvy": ("u1", 2), "yuv422_yuy2": ("u1", 2), "yuyv": ("u1", 2),
}  # fmt: skip
"""Number format and channels by encoding, in small letters"""
_BLUE_FIRST = ("bgr8", "bgra8", "bgr16", "8uc3", "8uc4")
"""Encodings with blue first; OpenCV's plain ones have it so by custom."""
_LUMA_FIRST = ("yuv422_yuy2", "yuyv")
_PAIRS = 1 << 15
"""Pairs of pixels that are converted at once: few enough for the cache, and for memory"""
_DEPTH_HEADER = struct.Struct("<iff")
"""Of `compressedDepth`: format, then the two constants of a depth that is coded as its inverse"""


def pixels(message: Any) -> NDArray[Any]:
    """The pixels of an Image as they are, (h, w) or (h, w, channels), in the machine's byte order.

    The array is a view into the message where that is possible. Raises `RosMessageError` for an unknown encoding, or
    sizes that do not fit the data.
    """
    encoding = message.encoding.lower()
    if encoding not in _FORMATS:
        raise RosMessageError(f"images encoded as {message.encoding[:40]!r} are not known; {', '.join(_FORMATS)} are")
    number, channels = _FORMATS[encoding]
    dtype = np.dtype((">" if message.is_bigendian else "<") + number)
    height, width, step = message.height, message.width, message.step
    row = width * channels * dtype.itemsize
    data = np.asarray(message.data, np.uint8)
    if min(height, width) < 1 or step < row or data.size < (height - 1) * step + row:
        raise RosMessageError(f"an Image of {width} x {height} {encoding}, step {step}, has {data.size} bytes")
    strides = (step, channels * dtype.itemsize, dtype.itemsize)
    array: NDArray[Any] = np.ndarray((height, width, channels), dtype, np.ascontiguousarray(data), 0, strides)
    array = array[:, :, 0] if channels == 1 else array
    return array if dtype.isnative else array.astype(dtype.newbyteorder("="))


def read_color(message: Any) -> Color:
    """(h, w, 3) RGB of an Image; grey becomes equal channels. Raises `RosMessageError` as `pixels`, and for depth."""
    encoding, array = message.encoding.lower(), pixels(message)
    if array.dtype == np.float32:
        raise RosMessageError(f"an Image encoded as {encoding} has no colour")
    if array.dtype == np.uint16:
        array = (array >> 8).astype(np.uint8)
    if array.ndim == 2:
        return np.repeat(array[:, :, None], 3, axis=2)
    if array.shape[2] == 2:
        return _from_yuv(array, luma=0 if encoding in _LUMA_FIRST else 1)
    return np.ascontiguousarray(array[:, :, 2::-1] if encoding in _BLUE_FIRST else array[:, :, :3])


def read_depth(message: Any) -> Depth:
    """(h, w) m of an Image of millimetres (16UC1) or metres (32FC1), 0 where unknown. Raises `RosMessageError`."""
    return _metres(pixels(message), message.encoding)


def to_image(types: RosTypes, stamp: float, frame: str, array: NDArray[Any]) -> Any:
    """An Image of colour (h, w, 3) uint8 RGB, grey (h, w) uint8, or depth (h, w) float32 m or uint16 mm.

    Raises:
        RosMessageError: for any other array.
    """
    encodings = {("uint8", 3): "rgb8", ("uint8", 2): "mono8", ("float32", 2): "32FC1", ("uint16", 2): "16UC1"}
    encoding = encodings.get((array.dtype.name, array.ndim))
    if encoding is None or (array.ndim == 3 and array.shape[2] != 3):
        raise RosMessageError(f"an array {array.shape} {array.dtype}: no colour, grey or depth image")
    height, width = array.shape[:2]
    data = np.ascontiguousarray(array)
    return types.new(
        IMAGE, header=to_header(types, stamp, frame), height=height, width=width, encoding=encoding,
        step=data.nbytes // max(height, 1), data=data.reshape(-1).view(np.uint8),
    )  # fmt: skip


def to_compressed(types: RosTypes, stamp: float, frame: str, data: NDArray[np.uint8], format: str) -> Any:
    """A CompressedImage of a file's bytes; `format` is `jpeg` or `png`."""
    return types.new(COMPRESSED, header=to_header(types, stamp, frame), format=format, data=data)


def read_compressed_color(message: Any) -> Color:
    """(h, w, 3) RGB of a CompressedImage, JPEG or PNG. Raises `RosMessageError`."""
    array = _unpacked(_bytes(message))
    if array.dtype == np.uint16:
        array = (array >> 8).astype(np.uint8)
    if array.ndim == 2:
        return np.repeat(array[:, :, None], 3, axis=2)
    return np.ascontiguousarray(array[:, :, 2::-1])


def read_compressed_depth(message: Any) -> Depth:
    """(h, w) m of a CompressedImage of depth: a 16 bit PNG of mm, or `compressedDepth` of image_transport.

    Raises:
        RosMessageError: also for RVL, which is not bridged.
    """
    encoding, _, way = message.format.partition(";")
    data = _bytes(message)
    if "compressedDepth" not in way:
        return _metres(_unpacked(data), "16UC1")
    if "rvl" in way.lower():
        raise RosMessageError("depth compressed as RVL is not bridged; let the camera publish PNG or plain images")
    if len(data) <= _DEPTH_HEADER.size:
        raise RosMessageError(f"compressed depth of {len(data)} bytes")
    _, a, b = _DEPTH_HEADER.unpack_from(data)
    coded = _unpacked(data[_DEPTH_HEADER.size :])
    if encoding.strip().lower() != "32fc1":
        return _metres(coded, "16UC1")
    if coded.ndim != 2:
        raise RosMessageError(f"compressed depth with {coded.shape[2]} channels")
    with np.errstate(divide="ignore", invalid="ignore"):
        return _metres(np.float32(a) / (coded.astype(np.float32) - np.float32(b)) * (coded > 0), "32FC1")


def _metres(array: NDArray[Any], encoding: str) -> Depth:
    if array.ndim != 2 or array.dtype not in (np.uint16, np.float32):
        raise RosMessageError(f"an Image encoded as {encoding[:40]!r} is no depth image; expected 16UC1 or 32FC1")
    if array.dtype == np.uint16:
        return array.astype(np.float32) * _MILLIMETRE
    return np.where(np.isfinite(array) & (array > 0.0), array, np.float32(0.0))


def _from_yuv(array: NDArray[np.uint8], luma: int) -> Color:
    """RGB of pairs of pixels that share their chroma (ITU-R BT.601, as OpenCV does)."""
    height, width, _ = array.shape
    if width % 2:
        raise RosMessageError(f"a YUV image {width} px wide: expected an even number")
    pairs = array.reshape(-1, 2, 2)
    rgb = np.empty((len(pairs), 2, 3), np.uint8)
    for begin in range(0, len(pairs), _PAIRS):
        _convert(pairs[begin : begin + _PAIRS], luma, rgb[begin : begin + _PAIRS])
    return rgb.reshape(height, width, 3)


def _convert(pairs: NDArray[np.uint8], luma: int, rgb: NDArray[np.uint8]) -> None:
    """RGB (n, 2, 3) of pairs of pixels (n, 2, 2), each with its luma and one of the two values of their chroma."""
    y = np.float32(1.164) * (pairs[:, :, luma].astype(np.float32) - np.float32(16.0))
    u, v = (pairs[:, place : place + 1, 1 - luma].astype(np.float32) - np.float32(128.0) for place in (0, 1))
    for channel, by_u, by_v in ((0, 0.0, 1.596), (1, -0.391, -0.813), (2, 2.018, 0.0)):
        value = y + np.float32(by_u) * u + np.float32(by_v) * v + np.float32(0.5)
        np.clip(value, 0.0, 255.0, out=rgb[:, :, channel], casting="unsafe")


def _bytes(message: Any) -> bytes:
    return np.asarray(message.data, np.uint8).tobytes()


def _unpacked(data: bytes) -> NDArray[Any]:
    """The pixels of a JPEG or PNG, blue first. Raises `RosMessageError`; what claims to be huge is not unpacked."""
    try:
        array = unpacked(data)
    except MissingExtraError as error:
        raise RosMessageError(f"compressed images cannot be read: {error}") from error
    except WireError as error:
        raise RosMessageError(str(error)) from error
    if array.dtype not in (np.uint8, np.uint16) or (array.ndim == 3 and array.shape[2] not in (3, 4)):
        raise RosMessageError(f"compressed data of {len(data)} bytes: no image")
    return array
