"""Takes the frames of a camera's driver, whatever that does: it may raise anything, and give what is no frame."""

from __future__ import annotations

import logging
import math
from collections import Counter
from collections.abc import Mapping

from agents.drivers import SILENCE, CameraDriver, Diagnosed
from dsr.clock import Clock
from dsr.images.blobs import Frame, frame_chunks


class CheckedFrames:
    """The frames of a driver that agents can use. Others are dropped and counted, and nothing is raised.

    A frame that is stamped before the last one is dropped, too: what moved would seem to go back. If only such ones
    come for `SILENCE`, the clock was set back, and they count.

    Args:
        driver: of the camera.
        clock: of the time since the last frame.
        log: where the first one of each kind that is dropped is told.
        name: of the camera, for people.
    """

    def __init__(self, driver: CameraDriver, clock: Clock, log: logging.Logger, name: str) -> None:
        self._driver, self._clock, self._log, self._name = driver, clock, log, name
        self._counts: Counter[str] = Counter()
        self._trouble = ""
        self._last = -math.inf
        """s, stamp of the last frame"""
        self._came = -math.inf
        """s, when that was taken, of the monotonic clock"""

    def frame(self) -> Frame | None:
        """The newest frame if it was not returned before and can be used, else None."""
        try:
            frame = self._driver.frame()
        except Exception as error:  # of somebody else's driver: the agent lives on
            self._drop("failed", f"its driver failed: {type(error).__name__}: {error}")
            return None
        return frame if frame is not None and self._takes(frame) else None

    def _takes(self, frame: Frame) -> bool:
        try:
            _check(frame)
        except Exception as error:  # whatever is in what is no frame
            self._drop("malformed", f"its driver gives what is no frame: {error}")
            return False
        now = self._clock.monotonic()
        if frame.stamp < self._last and now - self._came < SILENCE:
            self._drop("out of order", f"a picture is stamped {self._last - frame.stamp:.3f} s before another")
            return False
        self._last, self._came, self._trouble = frame.stamp, now, ""
        return True

    @property
    def trouble(self) -> str:
        """What is wrong with the camera now, in words; empty if nothing is."""
        try:
            told = self._driver.trouble if isinstance(self._driver, Diagnosed) else ""
            return "; ".join(filter(None, (told, self._trouble)))
        except Exception as error:  # as of `frame`
            return f"its driver failed: {type(error).__name__}: {error}"

    @property
    def counts(self) -> Mapping[str, int]:
        """By name what the driver counts, how often it `failed`, and frames `malformed` or `out of order`."""
        try:
            told = self._driver.counts if isinstance(self._driver, Diagnosed) else {}
            return Counter(told) + self._counts
        except Exception:  # `trouble` tells of it
            return self._counts

    def _drop(self, what: str, said: str) -> None:
        if not self._counts[what]:
            self._log.warning("camera %s: %s (told once, then counted)", self._name, said)
        self._counts[what] += 1
        self._trouble = said


def _check(frame: Frame) -> None:
    """Raise something if nobody could send it."""
    if not isinstance(frame, Frame):
        raise TypeError(f"a {type(frame).__name__}")
    if not math.isfinite(frame.stamp):
        raise ValueError(f"stamped {frame.stamp}")
    frame_chunks(frame)
