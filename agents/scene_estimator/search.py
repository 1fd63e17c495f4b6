"""Finds the tags of one camera from picture to picture: it searches where the picture changed beyond its noise.

A tag in a part that looks as before is where it was: its corners stay those that were found there. Every `PERIOD` the
whole picture is searched all the same, for what single pictures do not always show.
"""

from __future__ import annotations

from collections import Counter
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from agents.scene_estimator.detection import ENLARGED, Tag, TagDetector, grey_of, tags_near, unambiguous, without
from agents.scene_estimator.reading import MIN_CONTRAST, Grey
from dsr.math3d.batches import Array

T = TypeVar("T", bound=np.generic)
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
        self._speeds: dict[int, Array] = {}
        """(4, 2) px/s, of the corners of what moved from the last picture but one to the last, by marker id"""
        self._seen: Grey | None = None
        """Each part as it was when it was looked at last"""
        self._complete = self._last = 0.0
        """s, stamps of the last picture that was searched as a whole, and of the last one"""

    def find(self, color: NDArray[np.uint8], stamp: float) -> list[Tag]:
        """Tags in an RGB image (h, w, 3), by marker id. An id that shows twice says nothing and is left out."""
        grey = grey_of(color)
        if self._seen is None or self._seen.shape != grey.shape:
            self._tags = []
        if self._seen is None or self._seen.shape != grey.shape or not 0.0 < stamp - self._complete < PERIOD:
            self._seen, self._complete = grey.copy(), stamp
            changed = None
        else:
            changed = changed_blocks(grey, self._seen)
            parts = _pixels(changed, grey.shape)
            self._seen[parts] = grey[parts]
        before, ago = {tag.marker_id: tag.corners for tag in self._tags}, stamp - self._last
        self._look(grey, changed, ago)
        self._speeds, self._last = _speeds(before, self._tags, ago), stamp
        return unambiguous(self._tags)

    def _look(self, grey: Grey, changed: NDArray[np.bool_] | None, ago: float) -> None:
        """Read the tags in what changed, `ago` s after the last picture, and search what these do not explain.

        If it is None, all is searched but the tags that are read again.
        """
        around = _boxes(self._tags) // BLOCK
        reached = np.ones(len(around), bool) if changed is None else _reach(changed, around)
        touched = [tag for tag, is_touched in zip(self._tags, reached, strict=True) if is_touched]
        again = self._read(grey, touched, ago)
        kept = [tag for tag, is_touched in zip(self._tags, reached, strict=True) if not is_touched]
        read = [tag for tag in again if tag is not None]
        lost = _boxes([tag for tag, found in zip(touched, again, strict=True) if found is None])
        self._tags = kept + read
        if changed is None:
            boxes = np.array([[0, 0, grey.shape[1], grey.shape[0]]])
        else:
            for box in _boxes(read) // BLOCK:
                _part(changed, box)[:] = False
            boxes = self._unexplained(grey, changed, lost)
        self._search(grey, boxes, lost if changed is not None else boxes)

    def _read(self, grey: Grey, tags: list[Tag], ago: float) -> list[Tag | None]:
        """The tags where they would be by their speeds; else where they were, if they are still there.

        An id that shows twice is not read again: of two tags nobody knows which went where.
        """
        if not tags:
            return []
        counts = Counter(tag.marker_id for tag in self._tags)
        alone = [place for place, tag in enumerate(tags) if counts[tag.marker_id] == 1]
        found: list[Tag | None] = [None] * len(tags)
        for place, tag in zip(alone, self._read_alone(grey, [tags[place] for place in alone], ago), strict=True):
            found[place] = tag
        return found

    def _read_alone(self, grey: Grey, tags: list[Tag], ago: float) -> list[Tag | None]:
        if not tags:
            return []
        corners = np.array([tag.corners for tag in tags])
        moves = np.array([ago * self._speeds.get(tag.marker_id, np.zeros((4, 2))) for tag in tags])
        found = tags_near(grey, tags, corners + moves)
        stopped = [place for place, tag in enumerate(found) if tag is None and moves[place].any()]
        again = tags_near(grey, [tags[place] for place in stopped], corners[stopped])
        for place, tag in zip(stopped, again, strict=True):
            found[place] = tag
        return found

    def _unexplained(self, grey: Grey, changed: NDArray[np.bool_], lost: Boxes) -> Boxes:
        """Boxes around what changed with the outlines that reach into it, and around tags that were lost.

        Outlines of tags that are known, and of what is just around these, do not count. A box that shares pixels with
        the surroundings of such a tag has all of these: a new tag may reach into them.
        """
        boxes, known = lost, _boxes(self._tags)
        if changed.any():
            near = np.asarray(cv2.dilate(changed.astype(np.uint8), np.ones((3, 3), np.uint8)), np.uint8)
            outlines = _outlines(grey)
            for box in known // BLOCK:
                _part(outlines, box)[:] = 0
            _, parts, stats, _ = cv2.connectedComponentsWithStats(near | outlines)
            stats = stats[np.unique(parts[near > 0]), :4].astype(np.int64)
            boxes = np.vstack([np.hstack([stats[:, :2] - 1, stats[:, :2] + stats[:, 2:] + 1]) * BLOCK, lost])
        whole = [np.vstack([box[None], known[_overlap(known, box)]]) for box in boxes]
        around = [np.hstack([parts[:, :2].min(axis=0), parts[:, 2:].max(axis=0)]) for parts in whole]
        return np.asarray(_apart(around).clip(0, np.tile(grey.shape[::-1], 2)), np.int64)

    def _search(self, grey: Grey, boxes: Boxes, enlarged: Boxes) -> None:
        """Find more tags in boxes, and small ones in those that share pixels with `enlarged` ones."""
        if not len(boxes):
            return
        rest = without(grey, self._tags)
        for left, upper, right, lower in boxes.tolist():
            part, box = rest[upper:lower, left:right], np.array([left, upper, right, lower])
            times = ENLARGED if _overlap(enlarged, box).any() else 1
            self._tags += [tag.moved(left, upper) for tag in self._detector.search(part, max(grey.shape), times)]


def _speeds(before: dict[int, Array], tags: list[Tag], ago: float) -> dict[int, Array]:
    """(4, 2) px/s of the corners of tags that moved from where they were `ago` s before, by marker id."""
    if not 0.0 < ago <= PERIOD:
        return {}
    lasts = ((tag, before.get(tag.marker_id, tag.corners)) for tag in tags)
    return {tag.marker_id: (tag.corners - last) / ago for tag, last in lasts if last is not tag.corners}


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


def _reach(blocks: NDArray[np.bool_], boxes: Boxes) -> NDArray[np.bool_]:
    """(n,) in which boxes (n, 4), counted in blocks, there are some of the blocks (rows, columns): summed areas."""
    before = cv2.integral(blocks.astype(np.uint8))
    left, upper, right, lower = np.clip(boxes, 0, np.tile(blocks.shape[::-1], 2)).T
    inside = before[lower, right] - before[upper, right] - before[lower, left] + before[upper, left]
    return np.asarray(inside > 0)


def _part(blocks: NDArray[T], box: NDArray[np.int64]) -> NDArray[T]:
    """Those of blocks (rows, columns) in a box (4,), counted in blocks."""
    left, upper, right, lower = np.maximum(box, 0).tolist()
    return blocks[upper:lower, left:right]


def _pixels(blocks: NDArray[np.bool_], shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """(h, w) which pixels are in blocks (rows, columns)."""
    return np.asarray(blocks.repeat(BLOCK, axis=0).repeat(BLOCK, axis=1)[: shape[0], : shape[1]])


def _overlap(boxes: Boxes, box: Boxes) -> NDArray[np.bool_]:
    """(n,) which of the boxes share pixels with one (4,)."""
    return np.asarray((boxes[:, :2] < box[2:]).all(axis=1) & (boxes[:, 2:] > box[:2]).all(axis=1))


def _apart(boxes: list[NDArray[np.int64]]) -> Boxes:
    """Boxes around those: they share no pixel with each other."""
    waiting, done = boxes, np.empty((0, 4), np.int64)
    while waiting:
        box = waiting.pop()
        near = _overlap(done, box)
        parts = np.vstack([box[None], done[near]])
        around = np.hstack([parts[:, :2].min(axis=0), parts[:, 2:].max(axis=0)])
        done = done[~near]
        if (around == box).all():
            done = np.vstack([done, box[None]])
        else:
            waiting.append(around)
    return done
