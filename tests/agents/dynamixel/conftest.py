"""Fixtures of the tests with emulated servos."""

from __future__ import annotations

import pytest
from dynamixel_sdk import port_handler


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """The SDK waits up to a second for an answer, as the emulator's thread may wait for a processor; else 34 ms."""
    monkeypatch.setattr(port_handler, "LATENCY_TIMER", 500)
