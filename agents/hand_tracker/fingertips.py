"""The middle of the palm and the fingertips in the outline of a hand.

A fingertip is a place of the outline that is pointed (k-curvature: the angle between the vectors to the points a fixed
way before and after it), as thin as a finger, and away from the middle of the palm, which is the mean of where nearly
the largest circles fit into the outline.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MOST_TIPS = 5
_INWARDS = 0.7  # fingertip radii from the outline to the centre: smoothing and depth eat the rest
_WAY = 2.5  # fingertip radii, along the outline to the points between which the angle is measured
_SHARPEST = np.radians(78)  # greater angles are no tip
_BACKWARDS = -0.2  # of the direction to a tip along the sum of all
_APART = 1.8  # fingertip radii, between the tips of two fingers
_THINNEST, _THICKEST = 0.45, 1.5  # of a fingertip's radius, of the circles that fit in behind a tip
_BEHIND = 2.0  # fingertip radii, how far into the finger its thickness is looked for
_NEARLY = 0.9  # of the largest circle: a palm is longer than wide, and the very largest one lies at either end of it
_OFF_PALM = 1.25  # palm radii, from its middle


class Patch(NamedTuple):
    """A connected piece of the image that may be a hand."""

    corner: tuple[int, int]
    """px, u and v of the upper left pixel of `inside`"""
    inside: NDArray[np.bool_]
    """Mask (h, w) of the patch's pixels in its window of the image."""
    distance: float
    """m, its median depth"""


class Tip(NamedTuple):
    """A fingertip in the image."""

    centre: Array
    """Centre (2,) of the fingertip in the image, px."""
    inwards: Array
    """(2,) unit vector into the finger"""


def fingertips(patch: Patch, focal: float, radius: float) -> tuple[Array, list[Tip]]:
    """The middle of the palm (2,) px, and up to five fingertips, the most pointed first.

    Args:
        patch: the hand.
        focal: px, of the camera.
        radius: m, of a fingertip.
    """
    tip_radius = radius * focal / patch.distance
    padded = np.pad(patch.inside.astype(np.uint8), 1)
    thickness = cv2.distanceTransform(padded, cv2.DIST_L2, 5)
    palm_radius = float(thickness.max())
    middle = np.argwhere(thickness >= _NEARLY * palm_radius).mean(axis=0)[::-1]
    outline = _outline(padded)
    corner = np.array(patch.corner, dtype=float) - 1.0
    found: list[Tip] = []
    if len(outline) > 4 * _WAY * tip_radius:
        for tip, inwards in _pointed(outline, tip_radius):
            far = np.linalg.norm(tip - middle) > _OFF_PALM * palm_radius
            centre = tip + _INWARDS * tip_radius * inwards
            apart = all(np.linalg.norm(centre - other.centre) > _APART * tip_radius for other in found)
            if far and apart and _is_thin(thickness, tip, inwards, tip_radius):
                found.append(Tip(centre, inwards))
    tips = _on_one_side(found, middle)[:MOST_TIPS]
    return middle + corner, [tip._replace(centre=tip.centre + corner) for tip in tips]


def _on_one_side(tips: list[Tip], middle: Array) -> list[Tip]:
    """Without those on the other side of the palm than most are, such as the edges of a sleeve."""
    directions = np.array([tip.centre - middle for tip in tips]).reshape(-1, 2)
    directions /= np.maximum(np.linalg.norm(directions, axis=1, keepdims=True), 1e-9)
    mean = directions.sum(axis=0)
    return [tip for tip, direction in zip(tips, directions, strict=True) if direction @ mean >= _BACKWARDS]


def _outline(padded: NDArray[np.uint8]) -> Array:
    """(n, 2) the outermost contour, one point a pixel, smoothed over five of them."""
    contours, _ = cv2.findContours(padded, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    points = max(contours, key=len).reshape(-1, 2).astype(float)
    if len(points) < 5:
        return points
    return np.asarray(np.mean([np.roll(points, shift, axis=0) for shift in range(-2, 3)], axis=0))


def _pointed(outline: Array, tip_radius: float) -> list[tuple[Array, Array]]:
    """Places (2,) where the outline is pointed, sharpest first, with the unit direction (2,) into the finger."""
    way = max(3, round(_WAY * tip_radius / _step(outline)))
    before, after = np.roll(outline, way, axis=0) - outline, np.roll(outline, -way, axis=0) - outline
    angles = _angles(before, after)
    sign = np.sign(_area(outline))
    convex = sign * (after[:, 0] * before[:, 1] - after[:, 1] * before[:, 0]) > 0
    candidates = np.flatnonzero(convex & (angles < _SHARPEST))
    taken = np.zeros(len(outline), bool)
    found = []
    for index in candidates[np.argsort(angles[candidates], kind="stable")]:
        if not taken[index]:
            taken[np.arange(index - way, index + way + 1) % len(outline)] = True
            axis = before[index] + after[index]
            found.append((outline[index], axis / max(float(np.linalg.norm(axis)), 1e-9)))
    return found


def _is_thin(thickness: NDArray[Any], tip: Array, inwards: Array, tip_radius: float) -> bool:
    """Whether what is behind a tip is as thin as a finger."""
    way = np.linspace(0.5, _BEHIND, 6)[:, None] * tip_radius
    pixels = np.round(tip + way * inwards).astype(int)
    height, width = thickness.shape
    pixels = np.clip(pixels, 0, (width - 1, height - 1))
    thickest = float(thickness[pixels[:, 1], pixels[:, 0]].max())
    return _THINNEST * tip_radius < thickest < _THICKEST * tip_radius


def _angles(a: Array, b: Array) -> Array:
    norms = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
    return np.asarray(np.arccos(np.clip((a * b).sum(axis=1) / np.maximum(norms, 1e-9), -1.0, 1.0)))


def _area(outline: Array) -> float:
    """Signed, of the polygon."""
    x, y = outline.T
    return float(0.5 * (x * np.roll(y, -1) - y * np.roll(x, -1)).sum())


def _step(outline: Array) -> float:
    """px, between neighbouring points."""
    return max(float(np.linalg.norm(np.roll(outline, -1, axis=0) - outline, axis=1).mean()), 0.5)
