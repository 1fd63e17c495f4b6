"""Fixtures of the tests with emulated servos."""

from __future__ import annotations

import threading

import pytest
from dynamixel_sdk import port_handler

from agents.dynamixel import DynamixelArm
from agents.dynamixel.arm import PERIOD
from dsr.clock import ManualClock

PATIENCE = 20.0
"""s that a busy machine may take for a cycle of the driver"""


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """The SDK waits up to a second for an answer, as the emulator's thread may wait for a processor; else 34 ms."""
    monkeypatch.setattr(port_handler, "LATENCY_TIMER", 500)


@pytest.fixture
def unhurried(monkeypatch: pytest.MonkeyPatch) -> None:
    """A driver by the clock of the wall goes on where a busy machine is slow, and has time to arrive."""
    monkeypatch.setattr("agents.cameras.arm_trial._SETTLES", 2.0)
    for number in ("DEADMAN", "STALLED"):
        monkeypatch.setattr(f"agents.dynamixel.arm.{number}", 2.0)


class SteppedClock(ManualClock):
    """A clock of one driver, whose thread does one cycle for each step of the test: a busy machine changes nothing."""

    def __init__(self) -> None:
        super().__init__()
        self._turn = threading.Condition()
        self._waits = self._may_go = False

    def wait(self, event: threading.Event, timeout: float) -> bool:
        """In the driver's thread: the cycle is done; the next one begins with the next step."""
        with self._turn:
            self._waits = True
            self._turn.notify_all()
            while not (self._may_go or event.is_set()):
                self._turn.wait(0.01)
            self._may_go = False
        return event.is_set()

    def step(self) -> None:
        """Let the driver do its next cycle, a period later."""
        self.settle()
        with self._turn:
            self.advance(PERIOD)
            self._waits, self._may_go = False, True
            self._turn.notify_all()
        self.settle()

    def settle(self) -> None:
        """Wait until the present cycle is done."""
        with self._turn:
            assert self._turn.wait_for(lambda: self._waits, PATIENCE), "the driver's thread does nothing"


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> SteppedClock:
    """The clock of the next driver."""
    made = SteppedClock()
    monkeypatch.setattr(DynamixelArm, "clock", made)
    return made
