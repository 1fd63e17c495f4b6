"""Camera frames packed for recordings: colour as JPEG, depth as 16-bit PNG, a tenth of the size; or without loss.

OpenCV is imported when an image is there: who reads a recording without images, or without looking at them, does
without that library.
"""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dsr.config.extras import MissingExtraError, missing_extra
from dsr.errors import WireError
from dsr.images.blobs import Frame

DEPTH_UNIT = 1e-4
"""m, resolution of a packed depth image; 6.55 m and more become unknown (0)"""
MOST_PIXELS = 1 << 26
"""Pixels that an image may have to be unpacked: 8192 by 8192."""
_PNG_SIZE = struct.Struct(">8s4x4sII")
_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""Markers of JPEG that are followed by the size of the image: ITU-T T.81, table B.1."""
_PACKED = frozenset({"color.jpeg", "color.png", "depth.png"})
_LONGEST_SIDE = 65_500  # px, that a JPEG can have
_PNG_LEVEL = 4
"""Of compression, 0 to 9; with one filter for all rows a fifth smaller than the fastest level, in the same time."""

Image = NDArray[Any]


def check_opencv() -> None:
    """Raise `MissingExtraError`, which says how to install it, if there is no OpenCV to pack images with."""
    try:
        import cv2  # noqa: F401
    except ModuleNotFoundError as error:
        raise MissingExtraError(f"camera images need OpenCV: {missing_extra(error)}") from error


def pack(frame: Frame, quality: int | None) -> Frame:
    """`frame` with its `color` and `depth` images compressed; `quality` is that of the JPEG, 1 to 100.

    Without a quality nothing is lost: colour becomes a PNG, and depth stays as it is. Other arrays, and images of
    another layout than a camera driver's, always stay as they are.
    """
    arrays: dict[str, Image] = {}
    meta = dict(frame.meta)
    for name, image in frame.arrays.items():
        if name == "color" and is_color(image):
            arrays |= _pack_color(image, quality)
        elif name == "depth" and quality is not None and _is_image(image, np.float32, 2):
            arrays["depth.png"] = _png(_to_units(image))
            meta["depth_unit"] = DEPTH_UNIT
        else:
            arrays[name] = image
    return Frame(frame.stamp, arrays, meta)


def unpack(frame: Frame) -> Frame:
    """The frame as its camera published it, up to the losses of the compression.

    Raises:
        WireError: if an image cannot be unpacked.
        MissingExtraError: if there are images, and no OpenCV.
    """
    arrays = dict(frame.arrays)
    meta = dict(frame.meta)
    if arrays.keys() & _PACKED:
        check_opencv()
    for name in ("color.jpeg", "color.png"):
        if name in arrays:
            arrays["color"] = _as_color(_decode(name, arrays.pop(name)))
    if "depth.png" in arrays:
        unit = np.float32(meta.pop("depth_unit", DEPTH_UNIT))
        arrays["depth"] = _decode("depth.png", arrays.pop("depth.png")).astype(np.float32) * unit
    return Frame(frame.stamp, arrays, meta)


def is_color(array: Image) -> bool:
    """Whether an array is a colour image (height, width, 3) as camera drivers publish it."""
    return _is_image(array, np.uint8, 3)


def _is_image(array: Image, dtype: type, axes: int) -> bool:
    has_layout = array.dtype == dtype and array.ndim == axes and (axes == 2 or array.shape[2] == 3)
    return has_layout and array.size > 0 and max(array.shape) <= _LONGEST_SIDE


def _to_units(depth: Image) -> Image:
    units = np.rint(np.nan_to_num(depth, nan=0.0, posinf=0.0, neginf=0.0) / DEPTH_UNIT)
    return np.where((units > 0) & (units < 1 << 16), units, 0).astype(np.uint16)


def _as_color(bgr: Image) -> Image:
    import cv2

    return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB))


def _pack_color(image: Image, quality: int | None) -> dict[str, Image]:
    """The bytes of a packed colour image, by the name of its format."""
    import cv2

    bgr = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    if quality is None:
        return {"color.png": _png(bgr)}
    _, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return {"color.jpeg": data.ravel()}


def _png(image: Image) -> Image:
    import cv2

    options = [cv2.IMWRITE_PNG_COMPRESSION, _PNG_LEVEL, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_UP]
    _, data = cv2.imencode(".png", image, options)
    return data.ravel()


def _decode(name: str, data: Image) -> Image:
    packed = np.ascontiguousarray(data) if data.dtype == np.uint8 else np.empty(0, np.uint8)
    pixels = _pixels(packed.tobytes())
    if pixels > MOST_PIXELS:
        raise WireError(f"array {name!r} is an image of {pixels} pixels; at most {MOST_PIXELS} are unpacked")
    import cv2

    image = cv2.imdecode(packed, cv2.IMREAD_UNCHANGED) if pixels else None
    if image is None:
        raise WireError(f"array {name!r} of {data.size} values is no image")
    return image


def _pixels(data: bytes) -> int:
    """How many pixels a PNG or JPEG says that it has; 0 for anything else."""
    if len(data) >= _PNG_SIZE.size and data.startswith(_PNG):
        _, kind, width, height = _PNG_SIZE.unpack_from(data)
        return int(width * height) if kind == b"IHDR" else 0
    position = 2 if data.startswith(b"\xff\xd8") else len(data)
    while position + 9 <= len(data) and data[position] == 0xFF:
        if data[position + 1] in _JPEG_FRAMES:
            height, width = struct.unpack_from(">HH", data, position + 5)
            return int(width * height)
        position += 2 + int.from_bytes(data[position + 2 : position + 4], "big")
    return 0
