"""Prints a run in the terminal: its progress, then its results."""

from __future__ import annotations

import math
from textwrap import shorten
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from agents.scenario.format.model import Scenario
from agents.scenario.judge.result import Result
from agents.scenario.run.story import Line, Topic
from dsr.cli.common import add_names, add_numbers, shown
from dsr.cli.streams import redraws
from dsr.runtime.launcher import AgentRow

STILL_RESTS = 0.001
"""m, the largest gap under a belief that the table calls resting"""
_LINE_PERIOD = 5.0  # s of the scenario between two lines of progress, where no bar can be drawn
_STYLES = {
    Topic.MISSION: "bold cyan",
    Topic.PLAN: "cyan",
    Topic.ACTION: "default",
    Topic.MOVE: "bold magenta",
    Topic.SURPRISE: "bold yellow",
    Topic.EXPLANATION: "bold green",
    Topic.CAMERA: "bold green",
}
_LONGEST = 150  # characters of a finding; the result's file holds all


class ProgressBar:
    """Shows first which agents are not ready yet, then the time of the scenario. A context manager.

    Where the output is no terminal, it prints a line now and then instead.
    """

    def __init__(self, scenario: Scenario, console: Console) -> None:
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.completed:5.1f} of {task.fields[most]}{task.total:.0f} {task.fields[unit]}"),
            TimeRemainingColumn(),
            console=console,
            transient=True,
        )
        self._duration = scenario.duration
        self._name = scenario.name
        self._at_most = "" if scenario.linger is None else "at most "
        self._task = self._progress.add_task("starting", total=scenario.duration, unit="s", most="")
        self._console = console
        self._next_line = -math.inf

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._progress.stop()

    def starting(self, rows: list[AgentRow]) -> None:
        """Show how many agents are ready and which are not."""
        waiting = [row.agent for row in rows if not row.is_ready]
        text = f"starting {', '.join(waiting)}" if waiting else "all agents are ready"
        done = len(rows) - len(waiting)
        self._progress.update(self._task, description=text, completed=done, total=len(rows), unit="agents", most="")

    def running(self, elapsed: float) -> None:
        """Show the time of the scenario."""
        done = min(max(elapsed, 0.0), self._duration)
        if not redraws(self._console) and elapsed >= self._next_line:
            self._console.print(f"{self._name}: {done:.0f} of {self._at_most}{self._duration:.0f} s")
            self._next_line = done + _LINE_PERIOD
        self._progress.update(
            self._task, description=self._name, completed=done, total=self._duration, unit="s", most=self._at_most
        )

    def happened(self, elapsed: float, line: Line) -> None:
        """Print one line of the story, above the bar."""
        self._console.print(story_line(max(elapsed, 0.0), line), soft_wrap=not self._console.is_terminal)


def story_line(elapsed: float, line: Line) -> Text:
    """Format a line of the story: its time, its topic, and its text."""
    style = _STYLES[line.topic]
    said = "bold red" if not line.good else "default" if line.topic is Topic.ACTION else style
    return Text.assemble((f"{elapsed:6.1f} s  ", "dim"), (f"{line.topic:<13}", style), (line.text, said))


def show_result(result: Result, scenario: Scenario, console: Console) -> None:
    """Print the table of objects, the expectations and the notes.

    Of a run that failed on an overloaded machine, distances say nothing about the agents: they are left out.
    """
    blamed = result.overload is not None and not result.passed
    if not blamed:
        console.print(_object_table(result, scenario))
    console.print(_expectation_table(result))
    for note in result.notes:
        console.print(f"[yellow]note[/] {shown(note)}")
    held = sum(verdict.passed for verdict in result.expectations)
    color, word = ("green", "passed") if result.passed else ("red", "FAILED")
    console.print(f"[bold {color}]{word}[/]: {held} of {len(result.expectations)} expectations hold")
    if result.overload is not None:
        why = ". This may be why: run it again when the machine is less busy" if blamed else ""
        console.print(f"[yellow]{shown(result.overload.text)}{why}[/]", soft_wrap=True)


def _object_table(result: Result, scenario: Scenario) -> Table:
    found = f", hands by {result.hands}" if result.hands else ""
    title = f"{result.scenario}, seed {result.seed}, {result.mode}, sensor {result.sensor}{found}"
    table = Table(title=title, caption="mean distance from the truth", title_justify="left")
    add_names(table, "object")
    add_numbers(table, "percept\nerror (mm)", "belief\nerror (mm)", "gap below\n(mm)", "moved\n(mm)")
    add_names(table, "resting")
    for spec in scenario.objects:
        table.add_row(shown(spec.name), *_object_cells(result.metrics, spec.name))
    return table


def _object_cells(metrics: dict[str, float], name: str) -> list[str]:
    gap, drift = metrics.get(f"belief_gap_{name}_m"), metrics.get(f"belief_drift_{name}_m")
    rests = gap is not None and abs(gap) <= STILL_RESTS
    return [
        _millimetres(metrics.get(f"percept_error_{name}_m")),
        _millimetres(metrics.get(f"belief_error_{name}_m")),
        _millimetres(gap),
        _millimetres(drift),
        "[green]yes[/]" if rests else "[red]no[/]",
    ]


def _expectation_table(result: Result) -> Table:
    table = Table(title_justify="left")
    add_names(table, "", "expected", "found")
    for verdict in result.expectations:
        mark = "[green]✓[/]" if verdict.passed else "[red]✗[/]"
        table.add_row(mark, shown(verdict.text), shown(shorten(verdict.actual, _LONGEST, placeholder=" ...")))
    return table


def _millimetres(metres: float | None) -> str:
    return "-" if metres is None else f"{metres * 1000:.2f}"
