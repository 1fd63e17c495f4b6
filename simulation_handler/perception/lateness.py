"""How late cameras tell what they see: by that, what they have not told yet is no sign that something is not seen."""

from __future__ import annotations

from collections import deque
from statistics import median

from dsr.perception.scales import CONFIRM_FRAMES, PRESENT, RECENT_PERCEPTS


class Lateness:
    """The seconds by which the newest percepts of each camera are usually older than what shows the present.

    The newest percept of a camera is oldest just before the next one comes. The median of the last such ages counts:
    a camera that is covered for a while, or fails, is not late.
    """

    def __init__(self) -> None:
        self._heard: dict[str, float] = {}
        self._newest: dict[str, float] = {}
        self._ages: dict[str, deque[float]] = {}

    def hear(self, camera: str, stamp: float) -> None:
        """Take note of a percept of time `stamp` (s)."""
        self._heard[camera] = max(stamp, self._heard.get(camera, stamp))

    def update(self, now: float) -> dict[str, float]:
        """Take in what was heard until time `now` (s); return by how much each camera is late (s), if it is."""
        for camera, stamp in self._heard.items():
            before = self._newest.get(camera)
            if before is not None and stamp > before:
                self._ages.setdefault(camera, deque(maxlen=RECENT_PERCEPTS)).append(now - before)
            self._newest[camera] = stamp if before is None else max(stamp, before)
        self._heard.clear()
        usual = {camera: median(ages) for camera, ages in self._ages.items() if len(ages) >= CONFIRM_FRAMES}
        return {camera: age - PRESENT for camera, age in usual.items() if age > PRESENT}
