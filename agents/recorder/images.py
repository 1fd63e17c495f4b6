"""Camera frames packed for recordings: colour as JPEG, depth as 16-bit PNG, a tenth of the size; or without loss.

OpenCV is imported when an image is there: who reads a recording without images, or without looking at them, does
without that library.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.packed_images import unpacked
from dsr.errors import WireError
from dsr.images.blobs import Frame

DEPTH_UNIT = 1e-4
"""m, resolution of a packed depth image; 6.55 m and more become unknown (0)"""
_SMALLEST_UNIT = float(np.finfo(np.float32).tiny)
_LARGEST_UNIT = float(np.finfo(np.float32).max) / (1 << 16)
"""m; with these, all depths are numbers that float32 holds"""
_LONGEST_SIDE = 65_500  # px, that a JPEG can have
_PNG_LEVEL = 4
"""Of compression, 0 to 9; with one filter for all rows a fifth smaller than the fastest level, in the same time."""

Image = NDArray[Any]


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
    for name in ("color.jpeg", "color.png"):
        if name in arrays:
            arrays["color"] = _as_color(_decode(name, arrays.pop(name), np.uint8, 3))
    if "depth.png" in arrays:
        unit = _unit(meta.pop("depth_unit", DEPTH_UNIT))
        arrays["depth"] = _decode("depth.png", arrays.pop("depth.png"), np.uint16, 2) * np.float32(unit)
    return Frame(frame.stamp, arrays, meta)


def _unit(told: float | str) -> float:
    """The resolution of a packed depth image, m. Raises `WireError` for what is none."""
    if isinstance(told, str) or not _SMALLEST_UNIT <= told <= _LARGEST_UNIT:
        raise WireError(f"depth_unit {told!r:.40}: expected a length in m")
    return told


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


def _decode(name: str, data: Image, dtype: type, axes: int) -> Image:
    """The image in `data`. Raises `WireError` for none, and for one of another layout than `pack` makes."""
    packed = np.ascontiguousarray(data) if data.dtype == np.uint8 else np.empty(0, np.uint8)
    try:
        image = unpacked(packed.tobytes())
    except WireError as error:
        raise WireError(f"array {name!r}: {error}") from error
    if not _is_image(image, dtype, axes):
        raise WireError(f"array {name!r} is an image of shape {image.shape} and {image.dtype}")
    return image
