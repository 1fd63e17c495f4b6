"""`dsr top`."""

from __future__ import annotations

import contextlib
import io
import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from rich.console import Console

from dsr import Memory, WallClock
from dsr.cli.status_table import overloaded, status_table
from dsr.network.rendezvous import Registration
from dsr.network.transport import Qos
from dsr.runtime.launcher import AgentRow
from dsr.runtime.status import Heard, State, Status, encode_status
from dsr.timeline import AGENT, Chronicle


@pytest.fixture
def arm(memory: Memory) -> Iterator[None]:
    """An agent that tells its status."""
    done = threading.Event()

    def tell() -> None:
        while not done.wait(0.1):
            status = Status(
                agent="arm", rid="arm-1", pid=7, state=State.DEGRADED, rate_hz=49.9, restarts=2,
                last_error="no [gripper]", stamp=WallClock().now(), waiting=0.61, overloaded=True,
            )  # fmt: skip
            memory.transport.publish(memory.keys.status("arm"), encode_status(status), Qos.STREAM)

    thread = threading.Thread(target=tell)
    thread.start()
    yield
    done.set()
    thread.join()


@pytest.mark.usefixtures("arm")
def test_top_shows_every_agent(cli: Callable[..., str], cli_json: Callable[..., Any]) -> None:
    row, other = cli_json("top")
    assert (other["agent"], other["state"], other["rate_hz"]) == ("owner", "no status", None)
    assert (row["agent"], row["state"], row["rate_hz"], row["restarts"]) == ("arm", "degraded", 49.9, 2)
    assert 0 <= row["latency_ms"] < 10_000
    text = cli("top")
    assert "degraded" in text and "49.9" in text and "no [gripper]" in text
    assert "the machine is overloaded" in text and "arm (61 %)" in text
    assert (row["waiting"], row["overloaded"]) == (0.61, True)


def test_agents_that_were_silent_before_are_shown(
    memory: Memory, cli: Callable[..., str], cli_json: Callable[..., Any]
) -> None:
    """One as the timeline tells, and one of which nothing is known but that its process is there, as when it hangs."""
    Chronicle(memory, "chronicler").begin(AGENT, ("owner", memory.rid))
    with contextlib.closing(Registration("scene", "hung-1", "tcp/127.0.0.1:1")):
        assert {row["agent"]: row["state"] for row in cli_json("top")} == {"owner": "silent", "hung": "no status"}
        text = cli("top")
    assert "owner: told no status since this command began" in text
    assert "hung: takes part in the graph and tells no status: it is no agent, or it hangs" in text


def test_an_agent_that_has_ended_is_not_shown(memory: Memory, cli_json: Callable[..., Any]) -> None:
    chronicle = Chronicle(memory, "chronicler")
    chronicle.end(chronicle.begin(AGENT, ("arm", "arm-1")))
    assert [row["agent"] for row in cli_json("top")] == ["owner"]


def test_agents_that_lag_are_named_worst_first_and_others_are_not() -> None:
    def row(agent: str, waiting: float, *, late: bool) -> AgentRow:
        status = Status(agent=agent, rid="x", pid=1, state=State.READY, waiting=waiting, overloaded=late)
        return AgentRow(agent, "ready", 1, Heard(status, 0.0, 0.0), 0, "")

    rows = [row("arm", 0.3, late=True), row("idle", 0.9, late=False), row("plant", 0.61, late=True)]
    assert overloaded(rows).endswith("time of waiting for a processor: plant (61 %), arm (30 %)")
    assert overloaded(rows[1:2]) == "" and overloaded([AgentRow("new", "starting", 1, None, 0, "")]) == ""


def test_the_numbers_of_an_agent_that_stopped_are_over() -> None:
    status = Status(agent="arm", rid="arm-1", pid=7, state=State.STOPPED, rate_hz=49.9, restarts=2, stamp=1.0)
    row = AgentRow("arm", str(status.state), 7, Heard(status, 1.0, 0.0), 2, "")
    text = printed(status_table([row], "graph scene"))
    assert "stopped" in text and "2" in text and "49.9" not in text


def test_names_of_the_agents_that_come_along_are_whole_at_80_columns() -> None:
    states = (State.READY, State.DEGRADED)
    statuses = [
        Status(
            agent="simulation_handler", rid="a-1", pid=7, state=state, rate_hz=20.0, tick_ms_p50=123.4,
            tick_ms_p95=234.5, missed=1234, errors=12, behind=12.3, stamp=1.0,
        )
        for state in states
    ]  # fmt: skip
    rows = [AgentRow(one.agent, str(one.state), 7, Heard(one, 1.0, 0.012), 2, "") for one in statuses]
    rows.append(AgentRow("simulation_handler", "restarting", 7, None, 2, ""))
    lines = [line for line in printed(status_table(rows, "graph scene")).splitlines() if "simulation_handler" in line]
    assert len(lines) == 3


def test_it_says_when_all_have_left(memory: Memory, cli: Callable[..., str], monkeypatch: pytest.MonkeyPatch) -> None:
    assert "nobody else" not in cli("top")
    monkeypatch.setattr("dsr.cli.common.ONLOOKERS", {"owner"})
    assert "nobody else is in the graph any more" in cli("top")


def printed(content: Any) -> str:
    stream = io.StringIO()
    Console(file=stream, width=80).print(content)
    return stream.getvalue()
