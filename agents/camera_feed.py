"""Camera frames from a driver to the working memory."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Any

from agents.drivers import CameraDriver, Diagnosed
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
        self._driver = driver
        self._log = log
        self._described: dict[str, Any] = {}
        self._complained = False

    def forward(self) -> bool:
        """Publish the newest frame, if there is a new one; returns whether there was."""
        frame = self._driver.frame()
        if frame is None:
            return False
        self._describe(frame)
        self._memory.put_frame(self.node, frame)
        return True

    @property
    def trouble(self) -> str:
        """What is wrong with the camera now, as its driver tells it, with its name; empty if nothing is."""
        told = self._driver.trouble if isinstance(self._driver, Diagnosed) else ""
        return f"camera {self.node!r}: {told}" if told else ""

    @property
    def counts(self) -> Mapping[str, int]:
        """What its driver counts, by name."""
        return self._driver.counts if isinstance(self._driver, Diagnosed) else {}

    def close(self) -> None:
        """Release the device."""
        self._driver.close()

    def _describe(self, frame: Frame) -> None:
        """Write the intrinsics if they are not what the node says."""
        description = describe(frame)
        if description is None:
            if not self._complained:
                lacking = ", ".join(INTRINSICS[:4])
                self._log.warning("camera %r: frames lack an image or some of %s", self.node, lacking)
            self._complained = True
        elif description != self._described or self.node not in self._memory:
            self._memory.add_node(self.node, "camera", stream=self.node, **description)
            self._described = description


def describe(frame: Frame) -> dict[str, Any] | None:
    """Attributes of a camera that takes such frames: its intrinsics and lens; None if not all are known."""
    images = [array for array in frame.arrays.values() if array.ndim >= 2]
    try:
        return Intrinsics.from_meta(frame.meta, images[0].shape).attributes() if images else None
    except ValueError:
        return None
