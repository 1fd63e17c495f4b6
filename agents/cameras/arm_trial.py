"""What somebody wants to know of an arm before agents use it: its joints and faults, and whether they move as told."""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping, Sequence

import msgspec
import numpy as np

from agents.drivers import ArmDriver, ArmState, Diagnosed
from dsr.clock import WALL_CLOCK

STEP = 0.05
"""rad by which each joint is moved, and back: to be seen, and too little to hit anything that is not touched already"""
_TAKES = 1.5
"""s of a motion there, or back"""
_POINTS = 75
"""Points of such a motion: one each 0.02 s"""
_SETTLES = 0.5
"""s after which the joint must be there"""
_GOOD = 0.01
"""rad by which it may be off then"""
_LOOK = 0.02
"""s between two looks, which are signs of life, too"""


class ArmFindings(msgspec.Struct, frozen=True):
    """What was seen of an arm."""

    samples: int
    """Samples that came"""
    rate_hz: float | None
    """Samples a second, by their stamps; None of less than two"""
    positions: dict[str, float]
    """rad, the last ones by joint"""
    moved: dict[str, float]
    """rad by which each joint was off after it was moved; empty if none was"""
    counts: dict[str, int]
    """What the driver counted"""
    trouble: str
    """What driver and device say is wrong; empty if nothing is"""

    @property
    def is_good(self) -> bool:
        """Whether samples came, nothing is wrong, and all that was moved arrived."""
        return self.samples > 0 and not self.trouble and all(off <= _GOOD for off in self.moved.values())


class ArmTrial:
    """Reads an arm, and moves it if that is asked for."""

    def __init__(self, driver: ArmDriver) -> None:
        self._driver = driver
        self._stamps: list[float] = []
        self._last: ArmState | None = None
        self._moved: dict[str, float] = {}
        self._fault = ""

    def watch(self, seconds: float, stop: threading.Event) -> None:
        """Read samples for so long, or until `stop`."""
        end = WALL_CLOCK.monotonic() + seconds
        while WALL_CLOCK.monotonic() < end and not stop.is_set():
            state = self._driver.state()
            if state is not None and (self._last is None or state.stamp != self._last.stamp):
                self._last = state
                self._stamps.append(state.stamp)
                self._fault = state.fault or self._fault
            WALL_CLOCK.wait(stop, _LOOK)

    def move(self, stop: threading.Event) -> None:
        """Move each joint a little and back, one after the other, and note how far off it was in between."""
        start = self._last
        if start is None:
            return
        for index, name in enumerate(start.names):
            there = list(start.positions)
            there[index] += STEP if start.positions[index] <= 0.0 else -STEP
            self._go(start.positions, there, stop)
            if stop.is_set() or self._fault:
                break
            self._moved[name] = abs(self._last.positions[index] - there[index]) if self._last else math.inf
            self._go(there, start.positions, stop)
        self._driver.stop()

    def findings(self) -> ArmFindings:
        """What was seen until now."""
        told = self._driver if isinstance(self._driver, Diagnosed) else None
        counts: Mapping[str, int] = {} if told is None else told.counts
        last = self._last
        return ArmFindings(
            samples=len(self._stamps),
            rate_hz=self._rate(),
            positions={} if last is None else dict(zip(last.names, last.positions, strict=True)),
            moved=dict(self._moved),
            counts=dict(counts),
            trouble=self._fault or ("" if told is None else told.trouble),
        )

    def _go(self, here: Sequence[float], there: Sequence[float], stop: threading.Event) -> None:
        """Along a cosine, from rest to rest."""
        times = np.linspace(0.0, _TAKES, _POINTS)
        share = 0.5 - 0.5 * np.cos(math.pi * times / _TAKES)
        rows = np.array(here) + share[:, None] * (np.array(there) - np.array(here))
        self._driver.keep_alive()
        self._driver.follow(tuple(times.tolist()), tuple(map(tuple, rows.tolist())))
        end = WALL_CLOCK.monotonic() + _TAKES + _SETTLES
        while WALL_CLOCK.monotonic() < end and not stop.is_set() and not self._fault:
            self._driver.keep_alive()
            self.watch(_LOOK, stop)

    def _rate(self) -> float | None:
        if len(self._stamps) < 2 or self._stamps[-1] <= self._stamps[0]:
            return None
        return (len(self._stamps) - 1) / (self._stamps[-1] - self._stamps[0])
