"""`apriltag_msgs/AprilTagDetectionArray`, and corners of tags as the scene estimator takes them."""

from __future__ import annotations

from typing import Any

from agents.drivers import TagCorners
from dsr.vocabulary.tags import COUNT

APRILTAGS = "apriltag_msgs/msg/AprilTagDetectionArray"
_FAMILIES = ("tag36h11", "36h11")
_ORDER = (1, 0, 3, 2)
"""The AprilTag library's corners in the order of OpenCV, which prints the same tag turned by 180 degrees (tried)"""
_CENTRE = 0.5
"""px, where the AprilTag library has the centre of the first pixel"""
CORNER_STD = 0.2
"""px, error of each coordinate of a corner that the AprilTag library found by its refined edges"""
_FARTHEST = 1e5
"""px, of a corner: beyond any image; also not a number is none"""
_MOST = 2
"""Wrong bits up to which a tag is taken: of so many the family corrects more, and takes noise for tags"""


def read_apriltags(message: Any) -> list[TagCorners]:
    """The tags of family 36h11 of a message, each with its corners; others, and an id seen twice, are left out."""
    found: dict[int, list[TagCorners]] = {}
    for detection in message.detections:
        known = detection.family in _FAMILIES and 0 <= detection.id < COUNT and detection.hamming <= _MOST
        corners = [(float(detection.corners[i].x) - _CENTRE, float(detection.corners[i].y) - _CENTRE) for i in _ORDER]
        if known and all(abs(value) <= _FARTHEST for corner in corners for value in corner):
            a, b, c, d = corners
            found.setdefault(detection.id, []).append(TagCorners(detection.id, (a, b, c, d), CORNER_STD))
    return [tags[0] for _, tags in sorted(found.items()) if len(tags) == 1]
