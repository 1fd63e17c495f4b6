"""Draws triangles into a picture, all at once: for bodies that are no union of convex parts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dsr.vocabulary.intrinsics import Intrinsics

Array = NDArray[np.float64]
Edges = tuple[int, int, int, int]

_AT_ONCE = 2_000_000  # pairs of a triangle and a pixel, which bounds the memory
_THIN = 1e-15  # of a triangle seen from its edge


def draw_triangles(corners: Array, intrinsics: Intrinsics, limit: Edges, nearest: float) -> tuple[Edges, Array] | None:
    """The window (left, top, right, bottom) that triangles take in a picture, and 1 / depth in it; 0 where none is.

    Args:
        corners: (n, 3, 3) m, in the frame of the view; what of them is nearer than `nearest` is left out.
        intrinsics: of the picture.
        limit: columns and rows (left, top, right, bottom) beyond which nothing is drawn.
        nearest: m along the axis.

    Returns:
        None if nothing of them is within the limit.
    """
    corners = corners[(corners[..., 2] > nearest).any(axis=1)]
    first, last = _around(corners, intrinsics, nearest)
    low = np.clip(np.ceil(first), limit[:2], limit[2:]).astype(np.int64)
    high = np.clip(np.floor(last) + 1, limit[:2], limit[2:]).astype(np.int64)
    shown = (low < high).all(axis=1)
    if not shown.any():
        return None
    corners, low, high = corners[shown], low[shown], high[shown]
    (left, top), (right, bottom) = low.min(axis=0).tolist(), high.max(axis=0).tolist()
    inverse_depth = np.zeros((bottom - top) * (right - left))
    counts = (high - low).prod(axis=1)
    ends = np.cumsum(counts)
    begin = 0
    while begin < len(counts):
        before = ends[begin - 1] if begin else 0
        end = max(begin + 1, int(np.searchsorted(ends, before + _AT_ONCE, side="right")))
        part = slice(begin, end)
        _draw(
            corners[part], low[part], high[part], counts[part], intrinsics, nearest, (left, top, right), inverse_depth
        )
        begin = end
    return (left, top, right, bottom), inverse_depth.reshape(bottom - top, right - left)


def _around(corners: Array, intrinsics: Intrinsics, nearest: float) -> tuple[Array, Array]:
    """Least and greatest pixel (n, 2) of what of triangles is beyond `nearest`; each has a corner there."""
    ahead = corners[..., 2] > nearest
    if ahead.all():
        pixels = intrinsics.project(corners)
        return pixels.min(axis=1), pixels.max(axis=1)
    pixels = intrinsics.project(np.where(ahead[..., None], corners, 1.0))
    first = np.where(ahead[..., None], pixels, np.inf).min(axis=1)
    last = np.where(ahead[..., None], pixels, -np.inf).max(axis=1)
    crossing = np.flatnonzero(~ahead.all(axis=1))
    cuts = intrinsics.project(_cuts(corners[crossing], ahead[crossing], nearest))
    first[crossing] = np.minimum(first[crossing], cuts.min(axis=1))
    last[crossing] = np.maximum(last[crossing], cuts.max(axis=1))
    return first, last


def _cuts(corners: Array, ahead: NDArray[np.bool_], nearest: float) -> Array:
    """(n, 2, 3) m, where the edges of triangles meet the plane at `nearest`, which all of them cross."""
    alone = np.argmax(ahead == (ahead.sum(axis=1) == 1)[:, None], axis=1)  # the corner that has a side for itself
    rows = np.arange(len(corners))[:, None]
    tip, others = corners[rows, alone[:, None]], corners[rows, (alone[:, None] + (1, 2)) % 3]
    share = (nearest - tip[..., 2:]) / (others[..., 2:] - tip[..., 2:])
    cuts: Array = tip + share * (others - tip)
    cuts[..., 2] = nearest
    return cuts


def _draw(
    corners: Array,
    low: NDArray[np.int64],
    high: NDArray[np.int64],
    counts: NDArray[np.int64],
    intrinsics: Intrinsics,
    nearest: float,
    origin: tuple[int, int, int],
    inverse_depth: Array,
) -> None:
    """Draw some triangles into the flat array `inverse_depth`, whose window has the edges (left, top, right).

    A ray meets a triangle if it is a sum of multiples, none of them negative, of the three corners: wherever they are.
    """
    triangle = np.repeat(np.arange(len(counts)), counts)
    number = np.arange(len(triangle)) - np.repeat(np.cumsum(counts) - counts, counts)
    width = (high - low)[triangle, 0]
    u, v = low[triangle, 0] + number % width, low[triangle, 1] + number // width
    rays = intrinsics.rays(np.column_stack([u, v]))
    sides = np.cross(np.roll(corners, -1, axis=1), np.roll(corners, -2, axis=1))  # side k is opposite to corner k
    volume = np.einsum("nj,nj->n", corners[:, 0], sides[:, 0])
    flat = np.abs(volume) < _THIN
    normal = sides.sum(axis=1) / np.where(flat, 1.0, volume)[:, None]  # times a ray: 1 / depth
    inside = ~flat[triangle]
    signs = np.sign(volume)[triangle]
    for side in range(3):
        inside &= np.einsum("nj,nj->n", sides[triangle, side], rays) * signs >= 0.0
    hit = np.flatnonzero(inside)
    near = np.einsum("nj,nj->n", normal[triangle[hit]], rays[hit])
    beyond = near < 1.0 / nearest
    hit, near = hit[beyond], near[beyond]
    left, top, right = origin
    np.maximum.at(inverse_depth, (v[hit] - top) * (right - left) + u[hit] - left, near)
