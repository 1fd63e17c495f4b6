"""How a camera does: what it counts, what is wrong now, and what of that is told in the log; without threads."""

from __future__ import annotations

import logging
import math
from collections import Counter

import numpy as np
from numpy.typing import NDArray

from agents.drivers import SILENCE
from dsr.images.blobs import Frame

FROZEN = 2.0
"""s of one and the same picture after which a camera counts as frozen: the noise of a sensor changes each picture"""
_LEAST_SAME = 5
"""Pictures that must be the same: with fewer, a slow camera may not have taken a new one"""
_BLACK_AFTER = 1.0
"""s of black pictures after which that is told: a flash or a shutter makes single ones"""
_BLACK = 16
"""Of 255, below which a pixel is black: 16 is the black of video signals (ITU-R BT.601)"""
_EVERY = 8
"""Each of so many rows and columns is looked at: 4800 pixels of 640 x 480"""


_PICTURES_ARE = {"corrupt": "corrupt", "black": "black", "another size": "of another size"}


class CameraCondition:
    """Judges each picture, and remembers what is wrong. Who calls it says what time it is.

    Args:
        name: of the camera, for people.
        log: where each change for the worse and for the better is told once.
        silence: s without a usable picture after which the camera counts as gone.
        frozen: s of the same picture after which it counts as frozen; 0 where pictures may be the same.
        counts: to go on with.
    """

    def __init__(
        self, name: str, log: logging.Logger, silence: float = SILENCE, frozen: float = FROZEN,
        counts: Counter[str] | None = None,
    ) -> None:  # fmt: skip
        self.counts: Counter[str] = Counter() if counts is None else counts
        """What went wrong since the start, by name."""
        self.silence = silence
        self._name, self._log, self._frozen_after = name, log, frozen
        self._gone = ""
        self._gone_since: float | None = None
        """s, when the last usable picture came before it went"""
        self._heard = -math.inf
        """s, when the last usable picture came, or the camera was first opened"""
        self._look: NDArray[np.uint8] | None = None
        self._same_since, self._same = -math.inf, 0
        self._black_since: float | None = None
        self._troubles: dict[str, str] = {}
        """What is wrong with pictures that come, in words, by kind"""

    def begin(self, now: float) -> None:
        """Note that the camera is asked from `now` (s) on."""
        self._heard = now

    def trouble(self, now: float) -> str:
        """What is wrong at `now` (s), in words; empty if nothing is."""
        if self._gone:
            return self._gone
        if now - self._heard > self.silence:
            return f"no picture for {now - self._heard:.0f} s"
        return "; ".join(tuple(self._troubles.values()))

    def is_silent(self, now: float) -> bool:
        """Whether no usable picture has come for so long that the device should be opened again."""
        return now - self._heard > self.silence

    def lost(self, reason: str, now: float) -> None:
        """Note that the camera is gone, told once until it is back."""
        if not self._gone:
            self._gone_since = self._heard if math.isfinite(self._heard) else now
            self.counts["lost"] += 1
        if reason != self._gone:
            self._log.warning("camera %s is gone: %s; it is tried again and again", self._name, reason)
        self._gone = reason
        self._black_since = None
        self._troubles.clear()

    def corrupt(self, reason: str) -> None:
        """Note a picture that cannot be used."""
        self.tell("corrupt", f"pictures are dropped that cannot be used: {reason}")
        self.counts["corrupt"] += 1

    def tell(self, kind: str, text: str) -> None:
        """Note that something is wrong with the pictures that come, told once until it is well again."""
        if kind not in self._troubles:
            self._log.warning("camera %s: %s", self._name, text)
        self._troubles[kind] = text

    def well(self, kind: str) -> None:
        """Note that this is well again."""
        if self._troubles.pop(kind, ""):
            self._log.info("camera %s: no picture is %s any more", self._name, _PICTURES_ARE[kind])

    def takes(self, frame: Frame, now: float) -> bool:
        """Whether a picture that came at `now` (s) is new and goes on: not one of a frozen camera."""
        color = frame.arrays["color"]
        look = color[::_EVERY, ::_EVERY].copy()
        is_black = bool((look < _BLACK).all())
        if not is_black and self._is_frozen(look, now):
            self.counts["frozen"] += 1
            return False
        self._judge_black(is_black, now)
        self.well("corrupt")
        self._heard = now
        self._back(now)
        return True

    def frozen_for(self, now: float) -> float:
        """Seconds for which the camera has shown the same picture, if that is too long; else 0."""
        return now - self._same_since if self._counts_as_frozen(now) else 0.0

    def _is_frozen(self, look: NDArray[np.uint8], now: float) -> bool:
        if self._look is None or not np.array_equal(look, self._look):
            self._look, self._same_since, self._same = look, now, 0
            return False
        self._same += 1
        return self._counts_as_frozen(now)

    def _counts_as_frozen(self, now: float) -> bool:
        long = self._frozen_after > 0.0 and now - self._same_since >= self._frozen_after
        return long and self._same >= _LEAST_SAME

    def _judge_black(self, is_black: bool, now: float) -> None:
        if not is_black:
            self._black_since = None
            self.well("black")
            return
        self.counts["black"] += 1
        self._black_since = now if self._black_since is None else self._black_since
        if now - self._black_since >= _BLACK_AFTER:
            self.tell("black", "its pictures are black: is the lens covered, or the light off?")

    def _back(self, now: float) -> None:
        if self._gone and self._gone_since is not None:
            self._log.warning("camera %s is back after %.1f s", self._name, now - self._gone_since)
        self._gone, self._gone_since = "", None
