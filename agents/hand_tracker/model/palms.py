"""The output of MediaPipe's palm detector, read: palms with their boxes and the two places that tell their direction.

The detector answers for 2016 anchors, places of two grids over the image (W. Liu et al., "SSD: Single shot multibox
detector", ECCV 2016). Answers that overlap are one palm, their weighted mean (V. Bazarevsky et al., "BlazeFace", 2019).
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

PIXELS = 192
"""Sides of the image that the detector takes."""
ANCHORS, VALUES = 2016, 18
"""Answers of the detector, and numbers in each: a box, and seven places."""
_GRIDS = ((24, 2), (12, 6))
"""Cells along a side, and anchors in the middle of each cell; as in the graph."""
_WRIST, _MIDDLE = 0, 2
"""Of the seven places: the wrist's middle and the middle finger's knuckle."""
_SAME = 0.3
"""Intersection over union of two answers, from which they are one palm; as in the graph."""
_MOST = 100.0
"""Logit beyond which a score is as good as 0 or 1."""


class Palm(NamedTuple):
    """A palm, in sides of the square image that the detector saw, (0, 0) its upper left corner."""

    box: Array
    """(4,) left, top, right, bottom"""
    wrist: Array
    """(2,)"""
    middle: Array
    """(2,) the middle finger's knuckle"""
    score: float
    """0 to 1"""


@cache
def anchors() -> Array:
    """(2016, 2) their places, in sides of the image."""
    found = []
    for cells, times in _GRIDS:
        at = (np.arange(cells) + 0.5) / cells
        grid = np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2)
        found.append(np.repeat(grid, times, axis=0))
    return np.concatenate(found)


def read_palms(values: NDArray[np.float32], logits: NDArray[np.float32], least_score: float) -> list[Palm]:
    """The palms of the detector's answers (2016, 18) and their logits (2016,), the likeliest first."""
    scores = 1.0 / (1.0 + np.exp(-np.clip(logits.astype(np.float64), -_MOST, _MOST)))
    chosen = np.flatnonzero((scores >= least_score) & np.isfinite(values).all(axis=1))
    places = values[chosen].astype(np.float64).reshape(len(chosen), VALUES // 2, 2) / PIXELS
    middle, size = anchors()[chosen] + places[:, 0], places[:, 1]
    points = anchors()[chosen][:, None] + places[:, 2:]
    boxes = np.concatenate([middle - size / 2, middle + size / 2], axis=1)
    return _merged(boxes, points, scores[chosen])


def _merged(boxes: Array, points: Array, scores: Array) -> list[Palm]:
    """One palm for answers that overlap: their mean, weighted by their scores."""
    left = np.argsort(-scores, kind="stable")
    palms = []
    while left.size:
        same = _overlaps(boxes[left[0]], boxes[left]) >= _SAME
        same[0] = True
        these, left = left[same], left[~same]
        weights = scores[these] / scores[these].sum()
        at = np.tensordot(weights, points[these], axes=1)
        palms.append(Palm(weights @ boxes[these], at[_WRIST], at[_MIDDLE], float(scores[these[0]])))
    return palms


def _overlaps(box: Array, boxes: Array) -> Array:
    """(n,) intersection over union of a box (4,) with others (n, 4)."""
    size = np.minimum(box[2:], boxes[:, 2:]) - np.maximum(box[:2], boxes[:, :2])
    common = np.maximum(size, 0.0).prod(axis=1)
    areas = np.maximum(boxes[:, 2:] - boxes[:, :2], 0.0).prod(axis=1)
    whole = np.maximum(box[2:] - box[:2], 0.0).prod() + areas - common
    return np.asarray(common / np.maximum(whole, 1e-12))
