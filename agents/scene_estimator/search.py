"""Finds the tags of one camera from picture to picture: it searches where the picture changed beyond its noise.

A tag in a part that looks as before is where it was: its corners stay those that were found there. Every `PERIOD` the
whole picture is searched all the same, for what single pictures do not always show.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from agents.scene_estimator.detection import MIN_CONTRAST, Grey, Tag, TagDetector, grey_of, unambiguous

Boxes = NDArray[np.int64]
"""(n, 4) px: left, upper, right and lower ends; right and lower ones are outside"""

PERIOD = 1.0
"""s after which the whole picture is searched: a tag that is found in one of two pictures is found in 2 s"""
BLOCK = 8
"""px, side of the squares that change as a whole: one edge of a tag that moves in it stands out from the noise"""
_BEYOND_NOISE = 2.2
"""Mean square of a block over that of noise: less than one block in a million has more by noise alone (chi^2, 64)"""
_NOISIEST = 5.0
"""Grey levels, a quarter of the least contrast of tags: no larger standard deviation is told from a picture.

By `_BEYOND_NOISE`, noise of more than 7 grey levels is change.
"""
_MARGIN = 0.25
"""Of a tag's extent, around it: its white margin, and as much beside that for a search"""


class TagSearch:
    """The tags in the pictures of one camera."""

    def __init__(self) -> None:
        self._detector = TagDetector()
        self._tags: list[Tag] = []
        self._seen: Grey | None = None
        """Each part as it was when it was searched last"""
        self._complete = 0.0
        """s, stamp of the last picture that was searched as a whole"""

    def find(self, color: NDArray[np.uint8], stamp: float) -> list[Tag]:
        """Tags in an RGB image (h, w, 3), by marker id. An id that shows twice says nothing and is left out."""
        grey = grey_of(color)
        if self._seen is None or self._seen.shape != grey.shape or not 0.0 < stamp - self._complete < PERIOD:
            self._seen, self._complete, self._tags = grey.copy(), stamp, []
            boxes = np.array([[0, 0, grey.shape[1], grey.shape[0]]])
        else:
            boxes = self._changed(self._seen, grey)
        self._search(grey, boxes)
        return unambiguous(self._tags)

    def _changed(self, seen: Grey, grey: Grey) -> Boxes:
        """Boxes around what changed with the outlines that reach into it, and around all tags there."""
        changed = changed_blocks(grey, seen)
        if not changed.any():
            return np.empty((0, 4), np.int64)
        near = np.asarray(cv2.dilate(changed.astype(np.uint8), np.ones((3, 3), np.uint8)), np.uint8)
        _, parts, stats, _ = cv2.connectedComponentsWithStats(near | _outlines(grey))
        stats = stats[np.unique(parts[near > 0]), :4].astype(np.int64)
        corners = np.hstack([stats[:, :2] - 1, stats[:, :2] + stats[:, 2:] + 1]) * BLOCK
        ends = np.tile(grey.shape[::-1], 2)
        return np.asarray(_apart(corners, _boxes(self._tags)).clip(0, ends), np.int64)

    def _search(self, grey: Grey, boxes: Boxes) -> None:
        """Find the tags in boxes anew."""
        assert self._seen is not None
        searched = np.array([_overlap(boxes, box).any() for box in _boxes(self._tags)], bool)
        tags = [tag for tag, anew in zip(self._tags, searched, strict=True) if not anew]
        for left, upper, right, lower in boxes.tolist():
            part = grey[upper:lower, left:right]
            self._seen[upper:lower, left:right] = part
            tags += [tag.moved(left, upper) for tag in self._detector.search(part, max(grey.shape))]
        self._tags = tags


def changed_blocks(one: Grey, other: Grey) -> NDArray[np.bool_]:
    """(rows, columns) the blocks in which pictures (h, w) of one place differ beyond their noise.

    Most of a picture is as before, and tells the noise. If it is not, the noise is `_NOISIEST` at most.
    """
    height, width = one.shape
    off = cv2.subtract(one, other, dtype=cv2.CV_32F)
    squares = cv2.copyMakeBorder(cv2.multiply(off, off), 0, -height % BLOCK, 0, -width % BLOCK, cv2.BORDER_REPLICATE)
    size = squares.shape[1] // BLOCK, squares.shape[0] // BLOCK
    means = np.asarray(cv2.resize(squares, size, interpolation=cv2.INTER_AREA), np.float32)
    differ = means[means > 0.0]
    noise = min(float(np.median(differ)), 2.0 * _NOISIEST**2) if differ.size else 0.0
    return np.asarray(means > _BEYOND_NOISE * noise)


def _outlines(grey: Grey) -> NDArray[np.uint8]:
    """(rows, columns) 1 for blocks with contrast in or just beside them: the outline of a tag is one part of these."""
    height, width = grey.shape
    padded = cv2.copyMakeBorder(grey, 0, -height % BLOCK, 0, -width % BLOCK, cv2.BORDER_REPLICATE)
    contrast = cv2.morphologyEx(padded, cv2.MORPH_GRADIENT, np.ones((2 * BLOCK, 2 * BLOCK), np.uint8))
    return np.asarray(contrast[BLOCK // 2 :: BLOCK, BLOCK // 2 :: BLOCK] >= MIN_CONTRAST, np.uint8)


def _boxes(tags: list[Tag]) -> Boxes:
    """Around tags and their margins, of whole blocks."""
    corners = np.array([tag.corners for tag in tags], np.float64).reshape(-1, 4, 2)
    low, high = corners.min(axis=1), corners.max(axis=1)
    margin = _MARGIN * (high - low)
    ends = np.hstack([np.floor((low - margin) / BLOCK), np.ceil((high + margin) / BLOCK)])
    return np.asarray(BLOCK * ends, np.int64)


def _overlap(boxes: Boxes, box: Boxes) -> NDArray[np.bool_]:
    """(n,) which of the boxes share pixels with one (4,)."""
    return np.asarray((boxes[:, :2] < box[2:]).all(axis=1) & (boxes[:, 2:] > box[:2]).all(axis=1))


def _apart(boxes: Boxes, whole: Boxes) -> Boxes:
    """Boxes around those: they share no pixel with each other, and have all of what they share with some of `whole`."""
    waiting, done = list(boxes), np.empty((0, 4), np.int64)
    while waiting:
        box = waiting.pop()
        near = _overlap(done, box)
        parts = np.vstack([box[None], done[near], whole[_overlap(whole, box)]])
        around = np.hstack([parts[:, :2].min(axis=0), parts[:, 2:].max(axis=0)])
        done = done[~near]
        if (around == box).all():
            done = np.vstack([done, box[None]])
        else:
            waiting.append(around)
    return done
