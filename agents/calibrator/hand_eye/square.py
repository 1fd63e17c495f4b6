"""Finds a light square in a dark frame in a grey image: its inner corners, by lines along the four edges.

The frame may have gaps, as where a lamp shines on black tape: an edge is told by most of its length.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from dsr.math3d.transforms import Array

_BLOCKS = (0.02, 0.05, 0.1)
"""Sides of the neighbourhoods that the frame must be darker than, over the diagonal of the image"""
_DARKER = 10
"""Grey levels by which the frame is darker than its neighbourhood, at least"""
_GAPS = (1, 7, 15)
"""px, gaps of the frame that are closed"""
_LEAST_SIDE = 0.05
"""Length of a side over the diagonal of the image, at least"""
_BENT = 0.02
"""Distance of an outline from a quadrilateral over its length, at most"""
_SAMPLES = 80
"""Places along each side where the edge is looked for; not at the ends, where corners are round"""
_ENDS = 0.06
_REACH = 0.025
"""Distance from a rough side over its length, within which the edge is looked for"""
_LEAST_STEP = 12.0
"""Grey levels from the square to its frame, at least"""
_TOLD = 0.6
"""Share of the places along a side where an edge must be, on one line"""
_STRAIGHT = 1.5
"""px from its line that a place of an edge is, at most"""
_PASSES = 3
_LINE_TRIES = 8
_STEP = 0.25
"""px between two looks along a line across an edge"""


def find_square(grey: NDArray[np.uint8]) -> Array | None:
    """(4, 2) px corners, clockwise as they are seen, of the largest such square; None if none shows."""
    smooth = cv2.GaussianBlur(grey, (0, 0), 1.0).astype(np.float64)
    best: Array | None = None
    for rough in _candidates(grey):
        area = cv2.contourArea(rough.astype(np.float32))
        if best is not None and area <= 1.02 * cv2.contourArea(best.astype(np.float32)):
            continue
        fine = _refined(smooth, rough)
        if fine is not None:
            best = fine
    return best


def _candidates(grey: NDArray[np.uint8]) -> Iterator[Array]:
    """(4, 2) rough corners, clockwise, of light quadrilaterals that a dark line surrounds."""
    height, width = grey.shape
    diagonal = math.hypot(width, height)
    for share in _BLOCKS:
        block = 2 * round(0.5 * share * diagonal) + 3
        dark = cv2.adaptiveThreshold(grey, 255, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY_INV, block, _DARKER)
        for gap in _GAPS:
            closed = cv2.morphologyEx(dark, cv2.MORPH_CLOSE, np.ones((gap, gap), np.uint8))
            contours, _ = cv2.findContours(255 - closed, cv2.RETR_LIST, cv2.CHAIN_APPROX_SIMPLE)
            for contour in contours:
                length = cv2.arcLength(contour, True)
                if length < 4.0 * _LEAST_SIDE * diagonal:
                    continue
                quad = cv2.approxPolyDP(cv2.convexHull(contour), _BENT * length, True).reshape(-1, 2).astype(np.float64)
                if len(quad) != 4 or cv2.contourArea(contour) < 0.8 * cv2.contourArea(quad.astype(np.float32)):
                    continue
                at_border = (quad <= 2.0) | (quad >= np.array([width, height]) - 3.0)
                sides = np.linalg.norm(np.roll(quad, -1, axis=0) - quad, axis=1)
                if not at_border.any() and sides.min() > _LEAST_SIDE * diagonal:
                    yield _clockwise(quad)


def _clockwise(quad: Array) -> Array:
    """The same corners in the order in which they are passed clockwise, y pointing down."""
    x, y = (quad - quad.mean(axis=0)).T
    return np.asarray(quad[np.argsort(np.arctan2(y, x))])


def _refined(grey: Array, rough: Array) -> Array | None:
    """Corners where lines along the four edges meet; None if a side has no edge from light within to dark outside."""
    quad = rough
    for _ in range(_PASSES):
        lines = []
        for start, end in zip(quad, np.roll(quad, -1, axis=0), strict=True):
            line = _edge(grey, start, end)
            if line is None:
                return None
            lines.append(line)
        corners = [np.cross(lines[side - 1], lines[side]) for side in range(4)]
        if min(abs(corner[2]) for corner in corners) < 1e-9:
            return None
        quad = np.array([corner[:2] / corner[2] for corner in corners], np.float64)
    inside = (quad >= 0.0) & (quad <= np.array(grey.shape[::-1]) - 1.0)
    return np.asarray(quad) if bool(inside.all()) and cv2.isContourConvex(quad.astype(np.float32)) else None


def _edge(grey: Array, start: Array, end: Array) -> Array | None:
    """(3,) the line a x + b y + c = 0 of the first step from light to dark outwards, of a side that goes clockwise."""
    length = float(np.linalg.norm(end - start))
    along = (end - start) / max(length, 1e-9)
    outwards = np.array([along[1], -along[0]])
    reach = max(_REACH * length, 3.0)
    across = np.arange(-reach, reach + _STEP, _STEP)
    places = start + np.linspace(_ENDS, 1.0 - _ENDS, _SAMPLES)[:, None] * (end - start)
    points = places[:, None] + across[None, :, None] * outwards
    profile = cv2.remap(
        grey.astype(np.float32), points[..., 0].astype(np.float32), points[..., 1].astype(np.float32), cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )  # fmt: skip
    width = round(1.0 / _STEP)
    steps = profile[:, : -2 * width] - profile[:, 2 * width :]  # how much darker it is two pixels further out
    contrast = np.percentile(steps.max(axis=1), 70)
    strong = steps > max(0.5 * contrast, _LEAST_STEP)
    told = strong.any(axis=1)
    if told.sum() < _TOLD * _SAMPLES:
        return None
    found = []
    for row in np.flatnonzero(told):
        first = int(strong[row].argmax())
        window = slice(first, min(first + 3 * width, steps.shape[1]))
        weights = np.maximum(steps[row, window], 0.0) ** 2
        at = float((weights * np.arange(window.start, window.stop)).sum() / weights.sum())
        found.append(places[row] + (across[0] + _STEP * (at + width)) * outwards)
    return _line(np.array(found))


def _line(points: Array) -> Array | None:
    """(3,) the line that most points (n, 2) are on, fitted to these; None if too few are."""
    best = np.zeros(len(points), dtype=bool)
    for index in range(_LINE_TRIES):
        first = index * len(points) // (2 * _LINE_TRIES)
        pair = points[[first, first + len(points) // 2]]
        on = _away(_through(pair), points) < _STRAIGHT
        best = on if on.sum() > best.sum() else best
    if best.sum() < _TOLD * _SAMPLES:
        return None
    line = _through(points[best])
    return _through(points[_away(line, points) < _STRAIGHT])


def _through(points: Array) -> Array:
    """(3,) the line through points (n, 2) by total least squares."""
    middle = points.mean(axis=0)
    normal = np.linalg.svd(points - middle)[2][-1]
    return np.array([normal[0], normal[1], -float(normal @ middle)])


def _away(line: Array, points: Array) -> Array:
    return np.asarray(np.abs(points @ line[:2] + line[2]))
