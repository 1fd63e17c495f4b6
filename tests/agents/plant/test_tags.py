"""The faces of tagged objects: a detector finds their tags."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from agents.plant.tags import tagged_face
from dsr.vocabulary.tags import TAG_RATIO

DICTIONARY = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)


@pytest.mark.parametrize(("width", "height"), [(0.04, 0.04), (0.04, 0.08), (0.10, 0.04)])
def test_tag_is_found_in_the_middle_with_its_share_of_the_shorter_side(width: float, height: float) -> None:
    face = np.pad(tagged_face(7, width, height), 50, constant_values=120)
    corners, ids, _ = cv2.aruco.ArucoDetector(DICTIONARY).detectMarkers(face)
    assert ids.ravel().tolist() == [7]
    low, high = corners[0][0].min(axis=0), corners[0][0].max(axis=0)
    assert (high - low + 1) / (min(face.shape) - 100) == pytest.approx(TAG_RATIO, abs=0.01)
    assert (low + high) / 2 == pytest.approx((np.array(face.shape[::-1]) - 1) / 2, abs=0.6)


def test_first_corner_is_the_upper_left_one() -> None:
    """The order of corners tells which way the object is turned: x right and y up on its +z face."""
    face = np.pad(tagged_face(3, 0.04, 0.04), 50, constant_values=120)
    corners, _, _ = cv2.aruco.ArucoDetector(DICTIONARY).detectMarkers(face)
    offsets = corners[0][0] - corners[0][0].mean(axis=0)
    assert np.sign(offsets).tolist() == [[-1, -1], [1, -1], [1, 1], [-1, 1]]
