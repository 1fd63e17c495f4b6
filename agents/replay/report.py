"""The outcome of a comparison, for people and for programs."""

from __future__ import annotations

from typing import Any

import msgspec
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from agents.replay.compare import Disagreement, Outcome
from dsr.cli.common import shown
from dsr.timeline import Event

_TOLD = ("explained", "surprised", "calmed")
"""Kinds of events that the table shows; the JSON holds all."""


def to_json(outcome: Outcome, differences: list[str]) -> dict[str, Any]:
    """The outcome as plain data, with `equal` and what differs."""
    return {"equal": not differences, "differences": differences, **msgspec.to_builtins(outcome)}


def show(outcome: Outcome, differences: list[str], console: Console) -> None:
    """Print tables, then the verdict."""
    if outcome.poses:
        console.print(_poses(outcome))
    held = [("relation", item) for item in outcome.relations] + [("surprising", item) for item in outcome.surprising]
    disagreements = [(kind, item) for kind, item in held if item.only_recorded.total_s or item.only_anew.total_s]
    if disagreements:
        console.print(_disagreements(disagreements))
    told = [event for event in outcome.recorded_events + outcome.anew_events if event.kind in _TOLD]
    if told:
        console.print(_events(outcome))
    for note in outcome.notes:
        console.print(f"[yellow]note[/] {shown(note)}", soft_wrap=True)
    for difference in differences:
        console.print(f"[red]✗[/] {shown(difference)}", soft_wrap=True)
    what = f"{', '.join(outcome.agents)} anew over {outcome.seconds:.1f} s"
    equal = "[green]equal within the tolerance, but for breaks shorter than the grace[/]"
    verdict = f"[red]{len(differences)} differences[/]" if differences else equal
    console.print(f"{verdict}: {what}", soft_wrap=True)


def _poses(outcome: Outcome) -> Table:
    table = Table("pose", box=SIMPLE_HEAD, pad_edge=False)
    for column in ("max", "mean", "max turn", "greatest at", "apart", "only recorded", "only anew"):
        table.add_column(column, justify="right", no_wrap=True)
    for pose in outcome.poses:
        table.add_row(
            shown(pose.edge),
            f"{pose.max_m * 1e3:.2f} mm",
            f"{pose.mean_m * 1e3:.2f} mm",
            f"{pose.max_rad:.3f} rad",
            f"{pose.max_at_s:.2f} s" if pose.max_m > 0.0 else "",
            _seconds(pose.beyond.total_s),
            _seconds(pose.only_recorded.total_s),
            _seconds(pose.only_anew.total_s),
        )
    return table


def _disagreements(held: list[tuple[str, Disagreement]]) -> Table:
    table = Table("what", "", box=SIMPLE_HEAD, pad_edge=False)
    for column in ("only recorded", "only anew"):
        table.add_column(column, justify="right", no_wrap=True)
    for kind, item in held:
        alone = (_seconds(item.only_recorded.total_s), _seconds(item.only_anew.total_s))
        table.add_row(kind, shown(item.what), *alone)
    return table


def _events(outcome: Outcome) -> Table:
    table = Table("s", "run", "event", box=SIMPLE_HEAD, pad_edge=False)
    rows: list[tuple[Event, str]] = [(event, "recorded") for event in outcome.recorded_events]
    rows += [(event, "anew") for event in outcome.anew_events]
    for event, run in sorted(rows, key=lambda row: row[0].time):
        if event.kind in _TOLD:
            table.add_row(f"{event.time:.2f}", run, shown(event.text), style="" if run == "recorded" else "cyan")
    return table


def _seconds(seconds: float) -> str:
    return f"{seconds:.2f} s" if seconds > 0.0 else ""
