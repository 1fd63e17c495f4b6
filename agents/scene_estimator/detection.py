"""Finds AprilTags (family 36h11) in a grey image, with corners of sub-pixel accuracy.

Pixel coordinates put integers at pixel centres, so that an ideal camera has cx = (width - 1) / 2.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from agents.scene_estimator.reading import DICTIONARY, MIN_CONTRAST, READ_STD, Grey, corners_near
from dsr.math3d.transforms import Array

APRILTAG_BIAS = 0.42
"""px in u and v that OpenCV's apriltag refinement adds (measured on exact renders)."""
APRILTAG_STD = 0.1
"""px, error of a corner by apriltag refinement once the bias is off; grey noise hardly matters."""
SUBPIX_STD = 0.4
"""px, error of a corner by sub-pixel refinement on tags of 20 to 30 px."""
_LEAST_PERIMETER = 0.03
"""Of the image's longer side, as OpenCV has it: what is smaller is not looked at"""
ENLARGED = 2
"""Times that an image is enlarged to find small tags: the detector wants three pixels for each of a tag's cells"""
_WHITE_MARGINS = 0.25
"""Of the tag's side, both white margins of a tag: one of its eight cells on each side."""


@dataclass(frozen=True)
class Tag:
    """A tag seen in an image."""

    marker_id: int
    corners: NDArray[np.float64]
    """(4, 2) px, from the top left one as printed, clockwise."""
    corner_std: float
    """px, standard deviation of each coordinate."""

    def moved(self, columns: int, rows: int) -> Tag:
        """The tag of a part of an image that begins at that column and row, in the whole image."""
        return replace(self, corners=self.corners + np.array([columns, rows]))


class TagDetector:
    """Detects by apriltag refinement; tags that only the sub-pixel detector finds (small ones) are added.

    The sub-pixel detector searches the image without the tags that were found, which costs a third. In an image that is
    enlarged first, the detector finds tags with sides of 12 to 20 px as well.
    """

    def __init__(self) -> None:
        self._apriltag = _detector(cv2.aruco.CORNER_REFINE_APRILTAG, aprilTagMinWhiteBlackDiff=MIN_CONTRAST)
        self._subpix = _detector(cv2.aruco.CORNER_REFINE_SUBPIX, relativeCornerRefinmentWinSize=0.5)

    def detect(self, color: NDArray[np.uint8]) -> list[Tag]:
        """Tags in an RGB image (h, w, 3), by marker id. An id that shows twice says nothing and is left out."""
        grey = grey_of(color)
        return unambiguous(self.search(grey, max(grey.shape), ENLARGED))

    def search(self, grey: Grey, longest: int, times: int = 1) -> list[Tag]:
        """All tags in a part (h, w) of an image, whose longer side has `longest` px: that tells what is too small.

        Small ones are looked for in a picture so many times as large.
        """
        settings = self._subpix.getDetectorParameters()
        settings.minMarkerPerimeterRate = _LEAST_PERIMETER * longest / max(grey.shape)
        self._subpix.setDetectorParameters(settings)
        fine = _tags(self._apriltag, grey, APRILTAG_BIAS, APRILTAG_STD)
        found = [*_small(_tags(self._subpix, _large(without(grey, fine), times), 0.0, SUBPIX_STD), times), *fine]
        again = tags_near(grey, found, np.array([tag.corners for tag in found]))
        return [tag if sharper is None else sharper for tag, sharper in zip(found, again, strict=True)]


def grey_of(color: NDArray[np.uint8]) -> Grey:
    """An RGB image (h, w, 3) in grey (h, w)."""
    return np.asarray(cv2.cvtColor(color, cv2.COLOR_RGB2GRAY), np.uint8)


def tags_near(grey: Grey, tags: list[Tag], corners: Array) -> list[Tag | None]:
    """Tags with the corners that their edges have in an image (h, w), where corners (n, 4, 2) px are expected.

    None for those that are not seen clearly there.
    """
    if not tags:
        return []
    found, shown = corners_near(grey, np.array([tag.marker_id for tag in tags]), corners)
    read = (replace(tag, corners=found[place], corner_std=READ_STD) for place, tag in enumerate(tags))
    return [tag if is_shown else None for tag, is_shown in zip(read, shown, strict=True)]


def unambiguous(found: list[Tag]) -> list[Tag]:
    """Those whose id shows only once, by id."""
    times = Counter(tag.marker_id for tag in found)
    return sorted((tag for tag in found if times[tag.marker_id] == 1), key=lambda tag: tag.marker_id)


def without(grey: Grey, tags: list[Tag]) -> Grey:
    """The image (h, w) with tags painted over, each in the grey of the margin around it."""
    if not tags:
        return grey
    painted, last = grey.copy(), np.array(grey.shape[::-1]) - 1
    corners = np.array([tag.corners for tag in tags])
    centres = corners.mean(axis=1, keepdims=True)
    inner, outer = (centres + (1.0 + share * _WHITE_MARGINS) * (corners - centres) for share in (0.4, 0.6))
    around = np.concatenate([outer, 0.5 * (outer + np.roll(outer, 1, axis=1))], axis=1)
    u, v = np.moveaxis(np.clip(np.rint(around), 0, last).astype(int), -1, 0)
    for outline, margin in zip(np.rint(inner).astype(np.int32), np.median(painted[v, u], axis=1), strict=True):
        cv2.fillConvexPoly(painted, outline, float(margin))
    return painted


def _detector(refinement: int, **settings: float) -> cv2.aruco.ArucoDetector:
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = refinement
    for name, value in settings.items():
        setattr(parameters, name, value)
    return cv2.aruco.ArucoDetector(DICTIONARY, parameters)


def _large(grey: Grey, times: int) -> Grey:
    """An image (h, w) so many times as large."""
    if times == 1:
        return grey
    return np.asarray(cv2.resize(grey, None, fx=times, fy=times, interpolation=cv2.INTER_CUBIC), np.uint8)


def _small(tags: list[Tag], times: int) -> list[Tag]:
    """Tags of an image that was so many times as large, where they are in the image itself."""
    return [replace(tag, corners=(tag.corners + 0.5) / times - 0.5) for tag in tags]


def _tags(detector: cv2.aruco.ArucoDetector, grey: Any, bias: float, std: float) -> list[Tag]:
    quads, ids, _ = detector.detectMarkers(grey)
    if ids is None:
        return []
    corners = (np.asarray(quad, dtype=np.float64).reshape(4, 2) - bias for quad in quads)
    return [Tag(int(marker), quad, std) for marker, quad in zip(ids.ravel(), corners, strict=True)]


def tag_corners(tag_size: float) -> Array:
    """(4, 3) corners in the tag frame (x right, y up, z off the face), in the detector's order, m."""
    return 0.5 * tag_size * np.array([[-1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [-1.0, -1.0, 0.0]])
