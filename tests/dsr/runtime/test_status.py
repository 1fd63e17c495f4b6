"""The status that agents publish, and the board that collects it."""

from __future__ import annotations

import logging

import msgpack
import pytest
from msgspec.structs import replace

from dsr import LocalNetwork, ManualClock, WireError
from dsr.network.keys import Keys
from dsr.runtime.activity import MOST_USES, WorldUse
from dsr.runtime.status import (
    MOST_AGENTS,
    MOST_BYTES,
    MOST_TEXT,
    SILENT_AFTER,
    State,
    Status,
    StatusBoard,
    decode_status,
    encode_status,
)

KEYS = Keys("test")


class Office:
    """A board, and a transport that tells it things."""

    def __init__(self) -> None:
        self.clock = ManualClock()
        self.network = LocalNetwork(self.clock)
        self.board = StatusBoard(self.network.connect("board"), KEYS, self.clock)
        self.bus = self.network.connect("agent")

    def tell(self, status: Status, key: str = "") -> None:
        self.bus.publish(key or KEYS.status(status.agent), encode_status(status))
        self.network.deliver()

    def status(self, agent: str = "arm", state: State = State.READY) -> Status:
        return Status(agent=agent, rid=f"{agent}-1", pid=1, state=state, stamp=self.clock.now())


def test_a_status_survives_the_wire_and_other_languages_can_read_it() -> None:
    status = Status(agent="arm", rid="arm-1", pid=3, state=State.DEGRADED, rate_hz=49.5, last_error="x")
    assert decode_status(encode_status(status)) == status
    assert msgpack.unpackb(encode_status(status))["state"] == "degraded"


@pytest.mark.parametrize("payload", [b"", b"\xc1", msgpack.packb({"agent": "a"}), msgpack.packb([1, 2])])
def test_nonsense_is_a_wire_error(payload: bytes) -> None:
    with pytest.raises(WireError):
        decode_status(payload)


def test_a_status_of_many_worlds_and_a_long_error_fits_and_a_longer_one_is_a_wire_error() -> None:
    uses = [
        WorldUse(world=f"{n:064}", reads=True, read_hz=0.1, write_hz=0.1, last_read=1e9, last_write=1e9)
        for n in range(MOST_USES)
    ]
    office = Office()
    status = replace(office.status(), worlds=uses, last_error="\U0001f916" * 10**6, clock="x" * 10_000)
    read = decode_status(encode_status(status))
    assert read.worlds == uses and read.last_error == status.last_error[:MOST_TEXT]
    assert len(encode_status(status)) < MOST_BYTES
    with pytest.raises(WireError, match="at most"):
        decode_status(encode_status(replace(status, worlds=3 * uses)))


def test_the_board_keeps_so_many_agents_and_those_that_speak_stay() -> None:
    office = Office()
    office.tell(office.status("honest"))
    for number in range(3 * MOST_AGENTS):
        office.tell(office.status(f"a{number}"))
        if number % 500 == 0:
            office.tell(office.status("honest"))
    assert len(office.board.agents()) == MOST_AGENTS and "honest" in office.board.agents()
    assert office.board.forgotten == 2 * MOST_AGENTS + 1


def test_the_board_keeps_the_newest_of_each_agent() -> None:
    office = Office()
    office.tell(office.status("b"))
    office.tell(office.status("a", State.STARTING))
    office.clock.advance(1.0)
    office.tell(office.status("a"))
    assert office.board.agents() == ["a", "b"]
    heard = office.board.get("a")
    assert heard is not None and heard.status.state is State.READY
    assert office.board.get("c") is None


def test_the_board_measures_how_long_a_status_was_under_way() -> None:
    office = Office()
    status = office.status()
    office.clock.advance(0.25)
    office.tell(status)
    heard = office.board.get("arm")
    assert heard is not None and heard.latency == pytest.approx(0.25)


def test_malformed_and_forged_messages_are_dropped_counted_and_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    office = Office()
    with caplog.at_level(logging.WARNING):
        office.bus.publish(KEYS.status("arm"), b"\xc1")
        office.tell(office.status("arm"), key=KEYS.status("camera"))
    assert office.board.malformed == 2
    assert office.board.agents() == []
    assert len(caplog.records) == 1


def test_an_agent_that_hangs_is_silent_and_one_that_stopped_is_not() -> None:
    office = Office()
    assert office.board.is_silent("arm")
    office.tell(office.status("arm"))
    office.tell(office.status("viewer", State.STOPPED))
    office.clock.advance(SILENT_AFTER - 0.1)
    assert not office.board.is_silent("arm")
    office.clock.advance(0.2)
    assert office.board.is_silent("arm")
    assert not office.board.is_silent("viewer")
