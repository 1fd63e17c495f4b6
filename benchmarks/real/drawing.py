"""Draws what was found into images of recordings, for people to look at."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from agents.scene_estimator.detection import Tag, tag_corners
from dsr.math3d.transforms import Array, Pose
from dsr.vocabulary.intrinsics import Intrinsics

Picture = NDArray[np.uint8]
"""(h, w, 3), blue first"""
_SHIFT = 4
"""Binary digits of OpenCV's fractions of a pixel"""
_AROUND, _WIDE = 1.5, 480
"""Times a tag's width to each side, that a close-up shows, and px, about as wide as that is"""
_AXES = ((60, 60, 240), (60, 200, 60), (240, 120, 40))
"""Colours of x, y and z"""
_FOUND, _FITTED = (0, 220, 255), (255, 0, 255)
"""Yellow of what was found in the image, magenta of what a pose predicts"""


def draw_tag(picture: Picture, tag: Tag, camera_from_tag: Pose | None, side: float, lens: Intrinsics) -> None:
    """Draw a tag's corners as they were found, and of its pose outline and axes, as long as half its `side` (m)."""
    if camera_from_tag is not None:
        outline = lens.project(camera_from_tag.apply(tag_corners(side)))
        _line(picture, [*outline, outline[0]], _FITTED)
        ends = lens.project(camera_from_tag.apply(np.vstack([np.zeros(3), 0.5 * side * np.eye(3)])))
        for end, color in zip(ends[1:], _AXES, strict=True):
            _line(picture, [ends[0], end], color, 2)
    draw_points(picture, tag.corners)
    place = tuple(int(value) for value in tag.corners.max(axis=0) + 3.0)
    cv2.putText(picture, str(tag.marker_id), place, cv2.FONT_HERSHEY_SIMPLEX, 0.5, _FOUND, 1, cv2.LINE_AA)


def closeup(picture: Picture, tag: Tag, lens: Intrinsics) -> tuple[Picture, Tag, Intrinsics]:
    """The part of a picture around a tag, enlarged, with the tag and the lens as they are there."""
    middle, reach = tag.corners.mean(axis=0), _AROUND * float(np.ptp(tag.corners, axis=0).max())
    left, top = np.maximum(np.floor(middle - reach), 0).astype(int).tolist()
    right, bottom = np.ceil(middle + reach).astype(int).tolist()
    times = max(1, round(_WIDE / (right - left)))
    part = picture[top:bottom, left:right]
    enlarged = cv2.resize(part, None, fx=times, fy=times, interpolation=cv2.INTER_CUBIC)
    corners = (tag.corners - (left, top) + 0.5) * times - 0.5
    cx, cy = (lens.cx - left + 0.5) * times - 0.5, (lens.cy - top + 0.5) * times - 0.5
    height, width = enlarged.shape[:2]
    there = Intrinsics(lens.fx * times, lens.fy * times, cx, cy, width, height, lens.distortion)
    return np.asarray(enlarged, np.uint8), replace(tag, corners=corners), there


def draw_outline(picture: Picture, found: Array, fitted: Array) -> None:
    """Draw outermost pixels (n, 2) as dots where they were found, and the outline (m, 2) px of what was fitted."""
    columns, rows = np.round(found).astype(int).T
    picture[rows, columns] = _FOUND
    _line(picture, [*fitted, fitted[0]], _FITTED)


def draw_points(picture: Picture, found: Array, fitted: Array | None = None) -> None:
    """Draw points (n, 2) px as circles where they were found, and as crosses where a pose predicts them."""
    for point in found[np.isfinite(found).all(axis=1)]:
        centre = tuple(int(value) for value in np.round(point * 2**_SHIFT))
        cv2.circle(picture, centre, 4 << _SHIFT, _FOUND, 1, cv2.LINE_AA, _SHIFT)
    for point in np.empty((0, 2)) if fitted is None else fitted[np.isfinite(fitted).all(axis=1)]:
        for arm in ((3.0, 0.0), (0.0, 3.0)):
            _line(picture, [point - arm, point + arm], _FITTED)


def _line(picture: Picture, points: list[Array], color: tuple[int, int, int], thickness: int = 1) -> None:
    if np.isfinite(points).all():
        ends = np.round(np.array(points) * 2**_SHIFT).astype(np.int32)
        cv2.polylines(picture, [ends], False, color, thickness, cv2.LINE_AA, _SHIFT)
