"""Images as JPEG or PNG: how large one says that it is, and its pixels, if those are not too many.

OpenCV is imported when an image is there: it takes long to load, and most frames have no packed image.
"""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dsr.config.extras import MissingExtraError, missing_extra
from dsr.errors import WireError

MOST_PIXELS = 1 << 26
"""Pixels that an image may have to be unpacked, or drawn: 8192 by 8192."""
_PNG, _JPEG = b"\x89PNG\r\n\x1a\n", b"\xff\xd8"
_PNG_SIZE = struct.Struct(">8s4x4sII")
_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""Markers of JPEG that are followed by the size of the image: ITU-T T.81, table B.1."""
_SEGMENTS = frozenset(range(0xC0, 0xFF)) - frozenset(range(0xD0, 0xDA))
"""Markers of JPEG that are followed by a length, as far as they may come before the size: likewise."""
_FILLING = 0xFF
"""Any number of these bytes may come before a marker of JPEG."""


def check_opencv() -> None:
    """Raise `MissingExtraError`, which says how to install it, if there is no OpenCV to pack images with."""
    try:
        import cv2  # noqa: F401
    except ModuleNotFoundError as error:
        raise MissingExtraError(f"camera images need OpenCV: {missing_extra(error)}") from error


def encoded_size(data: bytes) -> tuple[int, int] | None:
    """(width, height) in px that a PNG or JPEG claims, without unpacking it; None if it is neither.

    A JPEG with anything but segments before its size is none. Decoders skip what else is there, and find another size.
    """
    if data.startswith(_PNG):
        _, kind, width, height = _PNG_SIZE.unpack_from(data) if len(data) >= _PNG_SIZE.size else (b"", b"", 0, 0)
        return (width, height) if kind == b"IHDR" else None
    at = len(_JPEG) if data.startswith(_JPEG) else len(data)
    while at + 9 <= len(data) and data[at] == _FILLING:
        marker, length = data[at + 1], int.from_bytes(data[at + 2 : at + 4], "big")
        if marker in _FRAMES:
            height, width = struct.unpack_from(">HH", data, at + 5)
            return width, height
        if marker == _FILLING:
            at += 1
        elif marker in _SEGMENTS and length >= 2:
            at += 2 + length
        else:
            return None
    return None


def unpacked(data: bytes) -> NDArray[Any]:
    """The pixels of a JPEG or PNG, (h, w) or (h, w, channels) with blue first.

    Raises:
        WireError: for anything else; what claims to be huge is not unpacked.
        MissingExtraError: without OpenCV.
    """
    check_opencv()
    import cv2

    size = encoded_size(data)
    if size is None or size[0] * size[1] > MOST_PIXELS:
        raise WireError(f"packed data of {len(data)} bytes: no JPEG or PNG of at most {MOST_PIXELS} pixels")
    try:
        array = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise WireError(f"packed data of {len(data)} bytes: {error}") from error
    if array is None:
        raise WireError(f"packed data of {len(data)} bytes is no image")
    found: NDArray[Any] = array
    return found
