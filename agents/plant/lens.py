"""What a lens makes of the picture of an ideal camera."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from agents.plant.renderer import RenderedPicture
from dsr.vocabulary.intrinsics import Intrinsics

Places = NDArray[np.float32]


def through_lens(picture: RenderedPicture, intrinsics: Intrinsics) -> RenderedPicture:
    """The picture of `intrinsics.pinhole()` as a camera with such intrinsics takes it.

    Colours are interpolated. Depths and bodies are those of the nearest pixel: between two surfaces is none.
    Where the lens shows nothing the picture is black, without depth, and without a body (-1).
    """
    if intrinsics.distortion is None:
        return picture
    columns, rows = _places(intrinsics)
    depth = cv2.remap(picture.depth, columns, rows, cv2.INTER_NEAREST)
    bodies = picture.bodies
    if bodies is not None:
        seen = cv2.remap(bodies.astype(np.float32), columns, rows, cv2.INTER_NEAREST, borderValue=-1)
        bodies = seen.astype(np.int32)
    color = cv2.remap(picture.color, columns, rows, cv2.INTER_LINEAR)
    return RenderedPicture(np.asarray(color, np.uint8), np.asarray(depth, np.float32), bodies)


@lru_cache(maxsize=4)
def _places(intrinsics: Intrinsics) -> tuple[Places, Places]:
    """Where each pixel looks for its column and row in the ideal picture, px; outside where the lens shows nothing."""
    ideal, (x, y) = intrinsics.pinhole(), intrinsics.slopes()
    columns, rows = x * np.float32(ideal.fx) + np.float32(ideal.cx), y * np.float32(ideal.fy) + np.float32(ideal.cy)
    return np.nan_to_num(columns, nan=-2.0).astype(np.float32), np.nan_to_num(rows, nan=-2.0).astype(np.float32)
