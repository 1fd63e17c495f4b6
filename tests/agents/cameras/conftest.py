"""A camera that misbehaves as it is told, and what waits for what a thread does."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from agents.cameras.reader import CameraReader, Wait
from dsr.clock import WALL_CLOCK
from dsr.images.blobs import Frame

PATIENCE = 20.0
"""s until a thread has surely done something, also on a busy machine"""


def eventually(holds: Callable[[], object]) -> None:
    """Wait until something holds."""
    end = WALL_CLOCK.monotonic() + PATIENCE
    while not holds():
        assert WALL_CLOCK.monotonic() < end, "it never came about"
        WALL_CLOCK.wait(threading.Event(), 0.002)


def picture(number: int, shape: tuple[int, ...] = (48, 64, 3)) -> np.ndarray:
    """An image that is another one for each number."""
    return np.full(shape, 40 + number % 200, np.uint8)


def noisy(number: int) -> Frame:
    """A frame that differs from all others."""
    return Frame(float(number), {"color": picture(number)}, {})


class FakeDevice:
    """A device that does what is next in `script`: gives a frame, raises an error, or tells that nothing came."""

    def __init__(self) -> None:
        self.script: deque[Frame | Exception | None] = deque()
        self.refuses: Exception | None = None
        """What opening it raises"""
        self.opened = self.closed = 0
        self.is_open = False

    def open(self) -> None:
        self.opened += 1
        if self.refuses is not None:
            raise self.refuses
        self.is_open = True

    def read(self, wait: Wait) -> Frame | None:
        assert self.is_open
        if not self.script:
            wait(0.002)
            return None
        step = self.script.popleft()
        if isinstance(step, Exception):
            raise step
        return step

    def close(self) -> None:
        self.closed += 1
        self.is_open = False


@pytest.fixture
def device() -> FakeDevice:
    return FakeDevice()


@pytest.fixture
def read(device: FakeDevice) -> Iterator[Callable[..., CameraReader]]:
    """Makes a reader of the device, which is closed at the end."""
    made: list[CameraReader] = []

    def make(**options: object) -> CameraReader:
        made.append(CameraReader("cam", device, **{"first_pause": 0.01, **options}))  # type: ignore[arg-type]
        return made[-1]

    yield make
    for reader in made:
        reader.close()
