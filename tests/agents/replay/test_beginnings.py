"""Agents run anew begin when they began in the recording, and tick in step with that."""

from __future__ import annotations

from pathlib import Path

import pytest

from agents.recorder.index import RecordingIndex
from agents.recorder.mcap_file import RecordedMessage, RecordingWriter
from agents.replay.beginnings import beginnings
from dsr.crdt.delta import Delta, Write
from dsr.replication.wire import encode_delta
from dsr.runtime.status import State, Status, encode_status

RATES = {"x": 20.0}


def status(state: State) -> bytes:
    return encode_status(Status(agent="x", rid="x-1", pid=1, state=state))


def wrote(stamp: float) -> bytes:
    delta = Delta()
    delta.writes = [Write(("y-1", 1), "mass", round(stamp * 1e6) << 10, "x-1", ("x-1", 1), 1.0)]
    return encode_delta(delta)


@pytest.mark.parametrize(
    ("records", "expected"),
    [
        ([], 0.0),
        ([(0.0, "status/x", status(State.READY)), (0.3, "d/x-1", wrote(100.3))], 0.0),
        ([(0.9, "status/x", status(State.READY)), (2.0, "rt/x-1", wrote(100.32))], 0.02),
        ([(0.6, "status/x", status(State.STARTING)), (1.1, "status/x", status(State.READY))], 1.05),
        (
            [(0.6, "status/x", status(State.STARTING)), (1.1, "status/x", status(State.READY)),
             (1.31, "d/x-1", wrote(101.31))],
            1.06,
        ),
        ([(0.6, "status/x", status(State.STARTING)), (0.7, "d/x-1", wrote(100.7))], 0.0),
        ([(0.1, "status/x", b"nonsense"), (0.2, "d/x-1", b"nonsense"), (0.3, "d/x-1", wrote(100.33))], 0.03),
    ],
)  # fmt: skip
def test_the_first_tick_is_found(tmp_path: Path, records: list[tuple[float, str, bytes]], expected: float) -> None:
    writer = RecordingWriter(tmp_path / "a.mcap", {})
    for time, topic, payload in [(0.0, "truth", b""), *records]:
        writer.write(RecordedMessage(100.0 + time, topic, payload))
    writer.close()
    found = beginnings(RecordingIndex(tmp_path / "a.mcap"), RATES)
    assert found["x"] == pytest.approx(100.0 + expected, abs=1e-4)
    if expected == 0.0:
        assert found["x"] == 100.0
