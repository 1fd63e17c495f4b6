"""The command `dsr days`: what the memory still holds of each day, and the account of one of them."""

from __future__ import annotations

from collections import defaultdict
from datetime import datetime, tzinfo
from pathlib import Path
from typing import Annotated

import msgspec
import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table

from agents.replay.tell_cli import FILE_ARGUMENT, TIME_OPTION
from agents.replay.told import moment_of
from dsr.cli.common import (
    GraphOption,
    JsonOption,
    RouterOption,
    SecurityOption,
    WorldOption,
    ZoneOption,
    add_names,
    add_numbers,
    console,
    errors,
    print_json,
    shown,
)
from dsr.memory import Memory
from dsr.narration.calendar import time_span, zone_of
from dsr.narration.days import day_account
from dsr.narration.statements import length_of_time
from dsr.network.keys import BASE
from dsr.timeline import SUMMARY, SURPRISES, StoredSummary, read_summary

app = typer.Typer(
    name="days", invoke_without_command=True, subcommand_metavar="",
    context_settings={"allow_interspersed_args": True},
)  # fmt: skip


class RememberedPeriod(msgspec.Struct, frozen=True):
    """What the summaries of one hour, day or week hold."""

    level: str
    """`hour`, `day`, `week` or `earlier`"""
    begin: float
    """s"""
    end: float
    """s"""
    remembered: int
    """Events and situations"""
    surprises: int
    """How many of these were surprising"""
    resolution: float
    """s; of what is alike and shorter, the last within it is remembered"""
    forgotten_before: float
    """s; some of what was over before then is forgotten, 0 if nothing is"""
    bytes: int
    """Of the summaries in the graph"""


@app.callback()
def days(
    file: Annotated[Path | None, FILE_ARGUMENT] = None,
    on: Annotated[
        str | None,
        typer.Option(metavar="WHEN", help='Tell of this time: yesterday, "last Tuesday", "on 12 November".'),
    ] = None,
    timezone: ZoneOption = None,
    at: Annotated[float | None, TIME_OPTION] = None,
    graph: GraphOption = None,
    world: WorldOption = BASE,
    as_json: JsonOption = False,
    router: RouterOption = None,
    security: SecurityOption = None,
) -> None:
    """Show what is remembered of the days past: hours of two days, days of five weeks, weeks of a year, all before.

    With --on, tell of that time in sentences: where things were, who moved them, and what was surprising.
    Old times are remembered more coarsely: docs/how-to/timeline.md has the rule.
    """
    zone = zone_of(timezone)
    with moment_of(file, at, graph, world, router, security, zone) as moment:
        if on is not None:
            told = day_account(moment, time_span(on, moment.now, zone))
        found, unreadable = ([], 0) if on is not None else remembered_periods(moment.memory)
    if on is not None:
        if as_json:
            print_json([msgspec.to_builtins(statement) for statement in told])
            return
        for statement in told:
            console.print(shown(statement.text), highlight=False)
        if not told:
            console.print("Nothing of that time is remembered.")
        return
    if as_json:
        print_json([msgspec.to_builtins(period) for period in found])
    else:
        show(found, zone)
    if unreadable:
        errors.print(f"[yellow]{unreadable} summaries cannot be read, and are left out[/]")


def remembered_periods(memory: Memory) -> tuple[list[RememberedPeriod], int]:
    """The periods of which summaries tell, in order, and how many summaries cannot be read."""
    sizes: dict[str, int] = {}
    same: dict[tuple[str, float], list[StoredSummary]] = defaultdict(list)
    unreadable = 0
    for node in memory.nodes(SUMMARY):
        stored = read_summary(node)
        if stored is None:
            unreadable += 1
            continue
        sizes[node.name] = len(str(node.get("content", "")).encode())
        same[stored.level.name, stored.begin].append(stored)
    return sorted((_period(parts, sizes) for parts in same.values()), key=lambda one: (one.begin, one.end)), unreadable


def show(periods: list[RememberedPeriod], zone: tzinfo | None) -> None:
    """Print periods as a table."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    add_names(table, "from", "until", "level")
    add_numbers(table, "remembered", "surprises", "resolution", "bytes")
    add_names(table, "forgotten in part before")
    for one in periods:
        lost = _stamp(one.forgotten_before, zone) if one.forgotten_before else ""
        table.add_row(
            _stamp(one.begin, zone) if one.begin else "", _stamp(one.end, zone), one.level, str(one.remembered),
            str(one.surprises), length_of_time(one.resolution) if one.resolution else "", str(one.bytes), lost,
        )  # fmt: skip
    console.print(table)
    if not periods:
        console.print("No summary is there: agents.chronicler writes them.")


def _period(parts: list[StoredSummary], sizes: dict[str, int]) -> RememberedPeriod:
    """The summaries of one period, one from each writer."""
    items = {item for part in parts for item in part.summary.items}
    first = parts[0]
    return RememberedPeriod(
        first.level.name, first.begin, max(part.end for part in parts), len(items),
        sum(item.kind in SURPRISES for item in items), max(part.summary.resolution for part in parts),
        max(part.summary.complete_from for part in parts), sum(sizes[part.name] for part in parts),
    )  # fmt: skip


def _stamp(time: float, zone: tzinfo | None) -> str:
    return f"{datetime.fromtimestamp(time, zone):%Y-%m-%d %H:%M}"
