"""Tables at 80 and 120 columns: no name and no number is cut, however long the names are."""

from __future__ import annotations

import io

import pytest
from rich.console import Console, RenderableType

from dsr.cli import status_table, topology
from dsr.clock import WALL_CLOCK
from dsr.runtime.activity import WorldUse
from dsr.runtime.launcher import AgentRow
from dsr.runtime.status import Heard, State, Status
from dsr.runtime.topology import ClientInfo, Topology, WorldEntry
from dsr.worlds.registry import WorldInfo

NAMES = ["spatial_relations", "the_estimator_of_everything_on_the_left_table", "arm"]


def lines(table: RenderableType, width: int) -> list[str]:
    console = Console(file=io.StringIO(), width=width)
    console.print(table)
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue().splitlines()


def check(text: list[str], width: int) -> None:
    """Every agent's name stands in its column, if need be in several lines; nothing is left out."""
    assert all(len(line) <= width for line in text)
    assert not any("…" in line for line in text)
    header = next(line for line in text if "agent" in line and "state" in line)
    column = slice(header.index("agent"), header.index("state"))
    cells = "".join(line[column].strip() for line in text)
    assert all(name in cells for name in NAMES), cells


@pytest.mark.parametrize("width", [80, 120])
def test_dsr_top(width: int) -> None:
    rows = []
    for name in NAMES:
        status = Status(
            agent=name, rid=f"{name}-1", pid=70_000, state=State.DEGRADED, rate_hz=1234.5, tick_ms_p50=1023.4,
            tick_ms_p95=2047.8, missed=98_765, errors=43_210, restarts=123, stamp=WALL_CLOCK.now(),
        )  # fmt: skip
        heard = Heard(status, 0.0, 1.0239)
        rows.append(AgentRow(name, str(State.DEGRADED), 70_000, heard, 123, ""))
    text = lines(status_table.status_table(rows, "graph g"), width)
    check(text, width)
    for number in ("1234.5", "1023.4", "2047.8", "1023.9", "98765", "43210", "123", "degraded"):
        assert sum(number in line.split() for line in text) == len(NAMES), number


@pytest.mark.parametrize("width", [80, 120])
def test_dsr_topology(width: int) -> None:
    use = WorldUse(world=NAMES[1], reads=True, writes=True, read_hz=1234.5, write_hz=987.6, last_read=0.0)
    clients = [ClientInfo(name, "degraded", [use]) for name in NAMES]
    worlds = [WorldEntry(WorldInfo(NAMES[1], parent=NAMES[0], follows=True), True, [], [], None, 0.0)]
    text = lines(topology._table(Topology(worlds, clients), "g", 3599.0), width)
    check(text, width)
    for number in ("1234.5", "987.6", "never", "degraded"):
        assert sum(number in line.split() for line in text) == len(NAMES), number
