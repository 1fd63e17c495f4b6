"""Where the arm leaves the outline of a hand: a sleeve that goes on from it, or the edge of the image.

A sleeve ends in corners that look like fingertips. So does a patch of skin that the image cuts off.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from agents.hand_tracker.fingertips import Patch, Tip

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_GOES_ON = 0.03  # m, of the depth between a hand and what goes on from it
_GAP = 0.006  # m, between the outline and that: pixels at its edge are of neither colour
_AROUND = 0.06  # m about the hand in which that is looked for
_LEAST_AREA = 0.002  # m^2 of it there: less is an object in the hand
_LEAST_WIDTH = 0.015  # m, of where it begins
_BACK = 0.5  # cosine between the directions to a tip and to the wrist, above which that is none
_AGREE = 0.8  # length of the mean of the unit vectors to where it begins; at less it does so on several sides


def find_wrist(patch: Patch, middle: Array, body: Mask, depth: NDArray[np.float32], focal: float) -> Array | None:
    """Where the arm begins (2,) px; None if nothing tells, or more than one thing goes on from the hand.

    Args:
        patch: the hand.
        middle: (2,) px, of its palm.
        body: (h, w) what is above the table and near enough, but not of the colour of skin.
        depth: (h, w) m, 0 where it is not known.
        focal: px, of the camera.
    """
    metre = focal / patch.distance  # px
    margin, gap = math.ceil(_AROUND * metre), max(2, round(_GAP * metre))
    rows, columns = _window(patch, margin, depth.shape)
    inside = np.zeros(depth.shape, np.uint8)
    height, width = patch.inside.shape
    u, v = patch.corner
    inside[v : v + height, u : u + width] = patch.inside
    hand, near = inside[rows, columns], depth[rows, columns]
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * gap + 1, 2 * gap + 1))
    beside = cv2.dilate(np.where(hand > 0, near, np.float32(0.0)), kernel)
    ring = (beside > 0) & (hand == 0)
    others = body[rows, columns] & (near > 0) & (hand == 0)
    edge = _edge(rows, columns, depth.shape)
    begins = ring & (np.abs(near - beside) < _GOES_ON)
    found = [*_begins(others, begins, edge, metre), _pixels((hand > 0) & edge)]
    places = np.concatenate(found) + np.array((columns.start, rows.start))
    if len(places) < _LEAST_WIDTH * metre:
        return None
    directions = places - middle
    directions /= np.maximum(np.linalg.norm(directions, axis=1, keepdims=True), 1e-9)
    return places.mean(axis=0) if np.linalg.norm(directions.mean(axis=0)) >= _AGREE else None


def away_from(wrist: Array, middle: Array, tips: Sequence[Tip]) -> list[Tip]:
    """Those of the tips that are not beside the wrist (2,) px, seen from the middle (2,) px of the palm."""
    back = (wrist - middle) / max(float(np.linalg.norm(wrist - middle)), 1e-9)
    ways = [tip.centre - middle for tip in tips]
    return [tip for tip, way in zip(tips, ways, strict=True) if way @ back <= _BACK * np.linalg.norm(way)]


def _window(patch: Patch, margin: int, shape: tuple[int, ...]) -> tuple[slice, slice]:
    (u, v), (height, width) = patch.corner, patch.inside.shape
    rows = slice(max(v - margin, 0), min(v + height + margin, shape[0]))
    return rows, slice(max(u - margin, 0), min(u + width + margin, shape[1]))


def _begins(others: Mask, ring: Mask, edge: Mask, metre: float) -> list[Array]:
    """Pixels (n, 2) beside the hand of each thing that goes on from it far enough, or out of the image."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(others.astype(np.uint8), connectivity=4)
    leaving = set(np.unique(labels[edge]).tolist())
    least = _LEAST_AREA * metre**2
    likely = [k for k in range(1, count) if k in leaving or stats[k, cv2.CC_STAT_AREA] >= least]
    return [_pixels(ring & (labels == label)) for label in likely]


def _edge(rows: slice, columns: slice, shape: tuple[int, ...]) -> Mask:
    """(h, w) of the window, where the image ends."""
    v, u = np.arange(rows.start, rows.stop), np.arange(columns.start, columns.stop)
    ends_v, ends_u = (v == 0) | (v == shape[0] - 1), (u == 0) | (u == shape[1] - 1)
    return np.asarray(ends_v[:, None] | ends_u[None, :])


def _pixels(mask: Mask) -> Array:
    """(n, 2) px"""
    v, u = np.nonzero(mask)
    return np.column_stack([u, v]).astype(float)
