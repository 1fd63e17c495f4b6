"""`dsr top`."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from dsr import Memory, WallClock
from dsr.network.transport import Qos
from dsr.runtime.status import State, Status, encode_status


@pytest.fixture
def arm(memory: Memory) -> Iterator[None]:
    """An agent that tells its status."""
    done = threading.Event()

    def tell() -> None:
        while not done.wait(0.1):
            status = Status(
                agent="arm", rid="arm-1", pid=7, state=State.DEGRADED, rate_hz=49.9, restarts=2,
                last_error="no [gripper]", stamp=WallClock().now(),
            )  # fmt: skip
            memory.transport.publish(memory.keys.status("arm"), encode_status(status), Qos.STREAM)

    thread = threading.Thread(target=tell)
    thread.start()
    yield
    done.set()
    thread.join()


@pytest.mark.usefixtures("arm")
def test_top_shows_every_agent(cli: Callable[..., str], cli_json: Callable[..., Any]) -> None:
    (row,) = cli_json("top")
    assert (row["agent"], row["state"], row["rate_hz"], row["restarts"]) == ("arm", "degraded", 49.9, 2)
    assert 0 <= row["latency_ms"] < 10_000
    text = cli("top")
    assert "degraded" in text and "49.9" in text and "no [gripper]" in text
