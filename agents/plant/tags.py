"""Pictures of AprilTags and of the faces that carry them."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from dsr.vocabulary.tags import TAG_RATIO

_CELL = 16  # px; a tag of the family 36h11 is 8 x 8 cells, border included
_DICTIONARY = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)

Image = NDArray[np.uint8]


def tag_image(marker_id: int) -> Image:
    """(128, 128) grey picture of a tag of the family 36h11, its black border at the edge."""
    return np.asarray(cv2.aruco.generateImageMarker(_DICTIONARY, marker_id, 8 * _CELL), dtype=np.uint8)


def tagged_face(marker_id: int, width: float, height: float) -> Image:
    """Grey picture of a white face of `width` x `height` m with a tag of `TAG_RATIO` in its middle."""
    tag = tag_image(marker_id)
    short = min(width, height)
    shape = [round(len(tag) / TAG_RATIO * side / short) for side in (height, width)]
    face = np.full(shape, 255, np.uint8)
    row, column = ((side - len(tag)) // 2 for side in shape)
    face[row : row + len(tag), column : column + len(tag)] = tag
    return face
