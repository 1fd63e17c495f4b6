"""Camera frames from a driver to the working memory."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Any

from agents.checked_frames import CheckedFrames
from agents.drivers import CameraDriver
from dsr import Frame, Memory
from dsr.vocabulary.intrinsics import INTRINSICS, Intrinsics


class CameraFeed:
    """Forwards the frames of one camera, and keeps its node's intrinsics up to date.

    Args:
        memory: where to.
        node: name of the camera's node, which is also that of the stream.
        driver: where from.
        log: for frames without intrinsics.
    """

    def __init__(self, memory: Memory, node: str, driver: CameraDriver, log: logging.Logger) -> None:
        self._memory = memory
        self.node = node
        """Name of the camera's node."""
        self._driver, self._frames = driver, CheckedFrames(driver, memory.clock, log, node)
        self._log = log
        self._described: dict[str, Any] = {}
        self._told = False
        """Whether it was told that nobody can measure in its frames"""
        self._wrong = ""
        """What is wrong with its intrinsics, in words"""

    def forward(self) -> bool:
        """Publish the newest frame, if there is a new one that can be used; returns whether there was."""
        frame = self._frames.frame()
        if frame is None:
            return False
        self._describe(frame)
        self._memory.put_frame(self.node, frame)
        return True

    @property
    def trouble(self) -> str:
        """What is wrong with the camera now, as its driver tells it, with its name; empty if nothing is."""
        told = "; ".join(filter(None, (self._frames.trouble, self._wrong)))
        return f"camera {self.node!r}: {told}" if told else ""

    @property
    def counts(self) -> Mapping[str, int]:
        """What is counted of it, by name: see `CheckedFrames`."""
        return self._frames.counts

    def close(self) -> None:
        """Release the device."""
        self._driver.close()

    def _describe(self, frame: Frame) -> None:
        """Write the intrinsics if they are not what the node says, or tell why there are none."""
        try:
            description = describe(frame)
        except ValueError as error:
            if not self._told:
                self._log.warning("camera %r: no agent can measure in its frames: %s", self.node, error)
            self._told = True
            is_wrong = any(name in frame.meta for name in INTRINSICS)  # one that tells none may be meant to
            self._wrong = f"no agent can measure in its frames: {error}" if is_wrong else ""
            return
        self._wrong = ""
        if description != self._described or self.node not in self._memory:
            self._memory.add_node(self.node, "camera", stream=self.node, **description)
            self._described = description


def describe(frame: Frame) -> dict[str, Any]:
    """Attributes of a camera that takes such frames: its intrinsics and lens.

    Raises `ValueError` without an image, or if an intrinsic value is missing or no camera has it.
    """
    images = [array for array in frame.arrays.values() if array.ndim >= 2]
    if not images:
        raise ValueError("there is no image")
    return Intrinsics.from_meta(frame.meta, images[0].shape).attributes()
