"""Devices of a simulated robot that fail when they are told to: for fault injection, one run at a time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from agents.drivers import ArmState
from agents.plant.driver import PlantArm
from dsr.clock import Clock
from dsr.images.blobs import Frame
from dsr.network.keys import Keys
from dsr.network.transport import Transport

Lie = Callable[[ArmState], ArmState]


class LyingArm(PlantArm):
    """The driver of the simulated arm; `lie` changes each sample before anybody sees it."""

    lie: Lie | None = None

    def state(self) -> ArmState | None:
        """The newest sample, as it is told."""
        state, lie = super().state(), type(self).lie
        return state if state is None or lie is None else lie(state)


class BlinkingCamera:
    """A camera at 10 Hz that sees nothing, until `blind`."""

    clock: Clock
    blind = False

    def __init__(self, bus: Transport, keys: Keys, name: str) -> None:
        self._next = 0.0

    def frame(self) -> Frame | None:
        """The newest frame, if it is due."""
        now = type(self).clock.now()
        if type(self).blind or now < self._next:
            return None
        self._next = now + 0.1 - 1e-6
        arrays: dict[str, Any] = {"color": np.zeros((4, 4, 3), np.uint8), "depth": np.ones((4, 4), np.float32)}
        return Frame(now, arrays, {"fx": 4.0, "fy": 4.0, "cx": 1.5, "cy": 1.5})

    def close(self) -> None:
        """Nothing is to be released."""
