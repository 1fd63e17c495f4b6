"""Log records over the bus."""

from __future__ import annotations

import logging
from collections.abc import Iterator

import pytest

from dsr import LocalNetwork, ManualClock, WireError
from dsr.network.keys import Keys
from dsr.runtime.logs import BusLogHandler, LogRecord, decode_log

KEYS = Keys("test")


class Line:
    """A logger whose records go over a bus to `heard`."""

    def __init__(self) -> None:
        self.clock = ManualClock()
        self.network = LocalNetwork(self.clock)
        self.heard: list[LogRecord] = []
        self.network.connect("listener").subscribe(
            KEYS.log(), lambda key, payload: self.heard.append(decode_log(payload))
        )
        self.bus = self.network.connect("agent")
        self.handler = BusLogHandler(self.bus, KEYS, "arm", self.clock, most_per_second=3)
        self.log = logging.getLogger("agent.arm.test")
        self.log.setLevel(logging.DEBUG)
        self.log.addHandler(self.handler)

    def texts(self) -> list[str]:
        self.network.deliver()
        return [record.text for record in self.heard]


@pytest.fixture
def line() -> Iterator[Line]:
    made = Line()
    yield made
    made.log.removeHandler(made.handler)


def test_a_record_arrives_with_agent_level_and_the_clocks_time(line: Line) -> None:
    line.clock.advance(5.0)
    line.log.warning("joint %d is hot", 4)
    assert line.texts() == ["joint 4 is hot"]
    assert line.heard == [LogRecord(line.clock.now(), "WARNING", "arm", "joint 4 is hot")]


def test_debug_records_stay_here(line: Line) -> None:
    line.log.debug("details")
    assert line.texts() == []


def test_a_flood_is_cut_and_says_so(line: Line) -> None:
    for n in range(10):
        line.log.info("line %d", n)
    assert line.texts() == ["line 0", "line 1", "line 2"]
    line.clock.advance(1.0)
    line.log.info("later")
    assert line.texts()[3:] == ["later (7 records before this one were left out)"]


def test_the_transports_own_records_are_not_sent(line: Line) -> None:
    line.handler.handle(logging.makeLogRecord({"name": "dsr.network.zenoh_transport", "msg": "x", "levelno": 40}))
    assert line.texts() == []


def test_a_closed_bus_does_not_end_the_agent(line: Line, capsys: pytest.CaptureFixture[str]) -> None:
    line.bus.close()
    line.log.info("nobody hears this")
    assert "has left the network" in capsys.readouterr().err


def test_nonsense_is_a_wire_error() -> None:
    with pytest.raises(WireError):
        decode_log(b"\xc1")
