"""The table of agents: state, rate, latency, restarts, last error, clocks that differ, what they count themselves."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rich.console import Group
from rich.table import Table
from rich.text import Text

from dsr.cli.common import add_names, add_numbers, shown
from dsr.runtime.launcher import AgentRow
from dsr.runtime.logs import printable
from dsr.runtime.status import State

_COLOURS = {
    "ready": "green",
    "degraded": "yellow",
    "starting": "cyan",
    "restarting": "yellow",
    "no status": "yellow",
    "silent": "red",
    "failed": "red",
    "ended": "red",
}


def status_table(rows: Iterable[AgentRow], title: str) -> Group:
    """The rows for people: the numbers in a table, the last errors and the agents' own counts below it."""
    table = Table(title=title, title_justify="left", box=None, pad_edge=False, collapse_padding=True)
    add_names(table, "agent")
    table.add_column("state", no_wrap=True)
    add_numbers(table, "Hz", "tick\nms", "95 %\nms", "lag\nms", "behind\ns", "missed", "errors", "re-\nstarts")
    rows, problems, counts = list(rows), [], []
    for row in rows:
        colour = _COLOURS.get(row.state, "white")
        table.add_row(shown(row.agent), f"[{colour}]{row.state}[/]", *_numbers(row))
        clock = row.heard.status.clock if row.heard else ""
        for problem in filter(None, (row.last_error, clock)):
            problems.append(Text.from_markup(f"[{colour}]{shown(row.agent)}[/]: {shown(problem)}"))
        if row.heard and row.heard.status.counts:
            told = ", ".join(f"{name} {count}" for name, count in row.heard.status.counts.items())
            counts.append(Text.from_markup(f"[dim]{shown(row.agent)}: {shown(told)}[/]"))
    if late := overloaded(rows):
        problems.append(Text(printable(late), style="red"))
    return Group(table, *problems, *counts)


def overloaded(rows: Iterable[AgentRow]) -> str:
    """Which agents lag because their machine has more to do than it can, in a line; empty if none does."""
    late = [row for row in rows if row.heard and row.heard.status.overloaded]
    late.sort(key=lambda row: -row.heard.status.waiting if row.heard else 0.0)
    waits = [f"{row.agent} ({100.0 * row.heard.status.waiting:.0f} %)" for row in late if row.heard]
    said = "the machine is overloaded; agents that leave out ticks, with their time of waiting for a processor: "
    return said + ", ".join(waits) if waits else ""


def _numbers(row: AgentRow) -> list[str]:
    if row.heard is None or row.state == State.STOPPED:  # its last numbers are over
        return [""] * 7 + [str(row.restarts)]
    status = row.heard.status
    times = (status.rate_hz, status.tick_ms_p50, status.tick_ms_p95, row.heard.latency * 1e3, status.behind)
    return [*(f"{number:.1f}" for number in times), *map(str, (status.missed, status.errors, row.restarts))]


def status_json(rows: Iterable[AgentRow]) -> list[dict[str, Any]]:
    """The rows for programs."""
    return [
        {
            "agent": row.agent,
            "state": row.state,
            "pid": row.pid,
            "rate_hz": row.heard.status.rate_hz if row.heard else None,
            "tick_ms_p50": row.heard.status.tick_ms_p50 if row.heard else None,
            "tick_ms_p95": row.heard.status.tick_ms_p95 if row.heard else None,
            "latency_ms": row.heard.latency * 1e3 if row.heard else None,
            "behind_s": row.heard.status.behind if row.heard else None,
            "missed": row.heard.status.missed if row.heard else None,
            "errors": row.heard.status.errors if row.heard else None,
            "restarts": row.restarts,
            "waiting": row.heard.status.waiting if row.heard else None,
            "overloaded": row.heard.status.overloaded if row.heard else None,
            "last_error": row.last_error,
            "clock": row.heard.status.clock if row.heard else None,
            "counts": row.heard.status.counts if row.heard else {},
        }
        for row in rows
    ]
