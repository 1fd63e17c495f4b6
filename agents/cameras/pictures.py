"""Pictures of OpenCV as frames: checked, in the order of colours that the memory uses."""

from __future__ import annotations

from typing import Any

import numpy as np

from agents.cameras.errors import CorruptFrameError
from dsr.images.blobs import Frame


def color_frame(picture: Any, stamp: float) -> Frame:
    """A frame of a picture (h, w, 3) of uint8, blue first, or (h, w) in grey. Raises `CorruptFrameError`."""
    import cv2

    if not isinstance(picture, np.ndarray) or picture.dtype != np.uint8 or picture.ndim not in (2, 3):
        raise CorruptFrameError("it is no image of 8 bits")
    if picture.ndim == 2:
        picture = picture[:, :, None]
    if min(picture.shape) < 1 or picture.shape[2] not in (1, 3):
        raise CorruptFrameError(f"an image of shape {picture.shape}")
    code = cv2.COLOR_GRAY2RGB if picture.shape[2] == 1 else cv2.COLOR_BGR2RGB
    return Frame(stamp, {"color": np.asarray(cv2.cvtColor(picture, code), np.uint8)}, {})
