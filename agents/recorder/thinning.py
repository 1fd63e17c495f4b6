"""Thins out camera images: fewer while nothing moves in the picture, each compressed, none twice."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.inbox import Message
from agents.recorder.images import is_color, pack
from dsr.errors import WireError
from dsr.images.blobs import Frame, decode_frame, encode_frame

_BLOCK = 8
"""px, side of the squares of which the means are compared: what moves by a pixel at an edge shows, noise does not"""
_MOVED = 8
"""Grey levels of 255 by which the mean of some square differs if something moved; sensor noise changes it by 3."""
_ROUNDING = 1e-6
"""s by which an image may be early."""

Means = NDArray[np.uint8]


class Image(NamedTuple):
    """A large message as it arrived; it may lie in memory that its writer shares."""

    stamp: float
    """Time (s) when it arrived"""
    key: str
    payload: bytes | memoryview


class _Kept(NamedTuple):
    """The image of a stream that was kept last."""

    at: float
    """s, when"""
    stamp: float
    """s, of the frame; NaN if it was none"""
    means: Means | None
    """Of the squares of its colour image; None if it has none."""


class ImageThinner:
    """Holds the newest image of each stream until it is due, and compresses it then.

    Args:
        frames_hz: images a second and stream, at most; 0 for none.
        still_hz: the same while the picture does not change.
        quality: of JPEG, 1 to 100; None keeps every bit.
    """

    def __init__(self, frames_hz: float, still_hz: float, quality: int | None) -> None:
        self._period = _period(frames_hz)
        self._still_period = _period(min(frames_hz, still_hz))
        self._quality = quality
        self._newest: dict[str, Image] = {}
        self._kept: dict[str, _Kept] = {}

    def put(self, image: Image) -> None:
        """Take an image; the one before it in its stream is dropped unless it was due."""
        if math.isfinite(self._period):
            self._newest[image.key] = image

    def begin_again(self) -> None:
        """Let the next image of each stream be due as soon as any: reading may begin here."""
        self._kept = {key: kept._replace(means=None) for key, kept in self._kept.items()}

    def due(self, now: float) -> list[Message]:
        """The images that are due at `now` (s), compressed; one that is no frame stays as it is."""
        found = []
        for key, image in list(self._newest.items()):
            kept = self._kept.get(key)
            if kept is not None and now - kept.at < self._period - _ROUNDING:
                continue
            try:
                frame = decode_frame(image.payload)
            except WireError:
                frame = None
            means = None if frame is None else _means(frame)
            if kept is not None and frame is not None and not self._is_news(kept, frame.stamp, means, now):
                continue
            del self._newest[key]
            self._kept[key] = _Kept(now, math.nan if frame is None else frame.stamp, means)
            packed = bytes(image.payload) if frame is None else encode_frame(pack(frame, self._quality))
            found.append(Message(image.stamp, key, packed))
        return found

    def _is_news(self, kept: _Kept, stamp: float, means: Means | None, now: float) -> bool:
        if stamp == kept.stamp:
            return False
        return now - kept.at >= self._still_period - _ROUNDING or _differ(kept.means, means)


def _period(hz: float) -> float:
    return 1.0 / hz if hz > 0.0 else math.inf


def _means(frame: Frame) -> Means | None:
    image = frame.arrays.get("color")
    if image is None or not is_color(image) or min(image.shape[:2]) < _BLOCK:
        return None
    import cv2

    height, width = image.shape[:2]
    means = cv2.resize(image, (width // _BLOCK, height // _BLOCK), interpolation=cv2.INTER_AREA)
    return np.asarray(means, np.uint8)


def _differ(before: Means | None, after: Means | None) -> bool:
    """Whether two pictures differ by more than noise; those of which nothing is known do."""
    if before is None or after is None or before.shape != after.shape:
        return True
    import cv2

    return int(cv2.absdiff(before, after).max()) > _MOVED
