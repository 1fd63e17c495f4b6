"""Reads tags again from where they are about, without a search: their edges give the corners, their cells the bits.

Across each edge, black goes over to white. Where it does is told by how much of a short line across the edge is white,
which no symmetric blur changes. A straight line through these places is the edge, and two edges meet in a corner.
All edges of all tags are looked at at once. What is not read clearly is left to a search.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from dsr.math3d.batches import Array

Grey = NDArray[np.uint8]
"""(h, w) grey levels"""
DICTIONARY = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
MIN_CONTRAST = 20
"""Grey levels between black and white; OpenCV's default of 5 finds edges in sensor noise, at 25 times the cost."""

READ_STD = 0.05
"""px, error of a corner where edges meet that were read: 0.03 to 0.06 in sharp renders (benchmarks/corners.py)"""

_CELLS = 8
"""Of a tag's side: six bits between two black cells of its border"""
_PLACES = 16
"""Along an edge, at which it is looked for"""
_TAPS = 9
"""Grey levels across an edge, at each place"""
_CELLS_ACROSS = 0.75
"""Cells to both sides of an edge that are looked at: beyond are other bits, and what is beside the white margin"""
_REACH = 2.5
"""px, the same at most: more would add noise, less would cut a blurred edge"""
_LOOKS = 5
"""At an edge from ever nearer; two or three do"""
_SETTLED = 0.05
"""px, half the error that a detector's corners have: what corners move by in the last look"""
_STRAIGHT = 0.25
"""px, root mean square of what places miss a straight edge by; noise makes it 0.1 to 0.2, a finger before it more"""

_ALONG = (1.0 + (np.arange(_PLACES) + 0.5) / _PLACES * (_CELLS - 2)) / _CELLS  # without the cells of the corners
_FROM_MIDDLE = _ALONG - 0.5
_ACROSS = np.linspace(-1.0, 1.0, _TAPS)
_CENTRES = (np.arange(_CELLS) + 0.5) / _CELLS


class _Edges(NamedTuple):
    """The four edges of n tags, each beginning at the corner of its number."""

    corners: Array
    """(n, 4, 2) px, where edges meet"""
    black: Array
    """(n, 4) grey level inside"""
    white: Array
    """(n, 4) grey level outside"""
    bent: Array
    """(n, 4) px, root mean square of what places along the edge miss it by"""


def corners_near(grey: Grey, marker_ids: NDArray[np.int64], corners: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Corners (n, 4, 2) px of the tags that are about there, and which of them (n,) show their bits and all edges.

    Args:
        grey: (h, w) the image.
        marker_ids: (n,) of the tags that are expected.
        corners: (n, 4, 2) px, where they are expected, to about half a cell and 2 px.
    """
    image = grey.astype(np.float32)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        edges, settled = _settled_edges(image, corners)
        clear = settled & (edges.white - edges.black >= MIN_CONTRAST).all(axis=1)
        clear &= (edges.bent <= _STRAIGHT).all(axis=1) & _is_inside(edges.corners, grey.shape)
        shown = np.zeros(len(clear), bool)
        shown[clear] = _shows(image, marker_ids[clear], _Edges(*(values[clear] for values in edges)))
    return edges.corners, shown


def _settled_edges(image: NDArray[np.float32], corners: Array) -> tuple[_Edges, NDArray[np.bool_]]:
    """The edges about corners (n, 4, 2) px, and of which tags (n,) another look would hardly move them."""
    edges = _edges(image, corners)
    moving = np.flatnonzero(~_are_near(edges.corners, corners))
    for _ in range(_LOOKS - 1):
        if not len(moving):
            break
        finer = _edges(image, edges.corners[moving])
        still = ~_are_near(finer.corners, edges.corners[moving])
        for values, new in zip(edges, finer, strict=True):
            values[moving] = new
        moving = moving[still]
    settled = np.ones(len(corners), bool)
    settled[moving] = False
    return edges, settled


def _are_near(corners: Array, others: Array) -> NDArray[np.bool_]:
    """(n,) whether corners (n, 4, 2) px are those of the last look; not if there is none."""
    return np.asarray(np.abs(corners - others).max(axis=(1, 2)) <= _SETTLED)


def _edges(image: NDArray[np.float32], corners: Array) -> _Edges:
    """The edges next to those between corners (n, 4, 2) px."""
    along = np.roll(corners, -1, axis=1) - corners
    lengths = np.linalg.norm(along, axis=2)
    outward = np.stack([along[..., 1], -along[..., 0]], axis=2) / lengths[..., None]
    reaches = np.minimum(_CELLS_ACROSS / _CELLS * lengths.min(axis=1), _REACH)[:, None]
    places = corners[:, :, None] + _ALONG[:, None] * along[:, :, None]
    across = (reaches * _ACROSS)[:, None, None, :, None] * outward[:, :, None, None]
    seen = _sampled(image, places[:, :, :, None] + across)
    black, white = seen[..., :2].mean(axis=(2, 3)), seen[..., -2:].mean(axis=(2, 3))
    mean = (seen.sum(axis=3) - 0.5 * (seen[..., 0] + seen[..., -1])) / (_TAPS - 1)
    off = reaches[..., None] * (1.0 - 2.0 * (mean - black[..., None]) / (white - black)[..., None])
    middle, slope = off.mean(axis=2), off @ _FROM_MIDDLE / (_FROM_MIDDLE @ _FROM_MIDDLE)
    bent = off - middle[..., None] - slope[..., None] * _FROM_MIDDLE
    first = corners + outward * (middle - 0.5 * slope)[..., None]
    direction = along + outward * slope[..., None]
    return _Edges(crossings(first, direction), black, white, np.sqrt((bent**2).mean(axis=2)))


def crossings(points: Array, directions: Array) -> Array:
    """(n, 4, 2) where lines (n, 4, 2) cross those before them."""
    points_before, before = np.roll(points, 1, axis=1), np.roll(directions, 1, axis=1)
    gap = points - points_before
    ways = _cross(gap, directions) / _cross(before, directions)
    return np.asarray(points_before + ways[..., None] * before)


def _cross(one: Array, other: Array) -> Array:
    return np.asarray(one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0])


def _is_inside(corners: Array, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """(n,) whether all edges between corners (n, 4, 2) px are in an image (h, w), as far as they are blurred."""
    blurred, last = 0.5 * _REACH, np.array([shape[1] - 1, shape[0] - 1])
    return np.asarray(((corners >= blurred) & (corners <= last - blurred)).all(axis=(1, 2)))


def _shows(image: NDArray[np.float32], marker_ids: NDArray[np.int64], edges: _Edges) -> NDArray[np.bool_]:
    """(n,) whether all cells within the edges are as black and white as those of the tags."""
    seen = _sampled(image, _cells(edges.corners))
    middle = 0.5 * (edges.black + edges.white).mean(axis=1)
    expected = np.array([_pattern(marker) for marker in marker_ids.tolist()], bool).reshape(-1, _CELLS, _CELLS)
    return np.asarray(((seen > middle[:, None, None]) == expected).all(axis=(1, 2)))


def _cells(corners: Array) -> Array:
    """(n, rows, columns, 2) px, centres of the cells of tags."""
    column, row = np.meshgrid(_CENTRES, _CENTRES)
    at = np.stack([column.ravel(), row.ravel(), np.ones(_CELLS**2)], axis=1) @ homographies(corners).mT
    return np.asarray(at[..., :2] / at[..., 2:]).reshape(-1, _CELLS, _CELLS, 2)


def homographies(corners: Array) -> Array:
    """(n, 3, 3) from column, row and 1 in squares of side 1 to where they are seen, by corners (n, 4, 2).

    P. Heckbert, "Fundamentals of texture mapping and image warping", 1989.
    """
    first, second, third, fourth = (corners[:, corner] for corner in range(4))
    skewed, one, other = first - second + third - fourth, second - third, fourth - third
    area = _cross(one, other)
    result = np.ones((len(corners), 3, 3))
    result[:, 2, 0], result[:, 2, 1] = _cross(skewed, other) / area, _cross(one, skewed) / area
    result[:, :2, 0] = second - first + result[:, 2, :1] * second
    result[:, :2, 1] = fourth - first + result[:, 2, 1:2] * fourth
    result[:, :2, 2] = first
    return result


def _sampled(image: NDArray[np.float32], places: Array) -> Array:
    """(...) grey levels at places (..., 2) px, between pixels as well."""
    if not places.size:
        return np.zeros(places.shape[:-1])
    at = places.reshape(len(places), -1, 2).astype(np.float32)
    u, v = np.ascontiguousarray(at[..., 0]), np.ascontiguousarray(at[..., 1])
    seen = cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(seen, np.float64).reshape(places.shape[:-1])


@lru_cache(maxsize=1024)
def _pattern(marker_id: int) -> NDArray[np.bool_]:
    """(rows, columns) which cells of the tag are white."""
    return np.asarray(DICTIONARY.generateImageMarker(marker_id, _CELLS) > 0)
