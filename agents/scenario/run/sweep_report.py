"""Prints a sweep in the terminal: its progress with the successes so far, then the statistics."""

from __future__ import annotations

import re
from collections.abc import Sequence
from types import TracebackType

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from agents.scenario.run.statistics import RunSummary, Spread
from agents.scenario.run.sweep import RunOutcome
from dsr.cli.common import add_names, add_numbers
from dsr.cli.streams import redraws

MAIN = {
    "recovery_time_max_s": "recovery",
    "recovery_in_view_max_s": "in view",
    "surprises_raised": "surprises",
    "wrong_beliefs": "wrong beliefs",
    "replans": "replans",
    "mission_reached_s": "mission",
}
"""Metrics of the overview and how they are called there."""
_LINES = 10  # of progress, where no bar can be drawn
_MOST_SEEDS = 20  # listed of one failed expectation


class SweepBar:
    """The number of runs done and passed. A context manager; prints a line now and then where there is no terminal."""

    def __init__(self, total: int, console: Console) -> None:
        self._total = total
        self._console = console
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
            console=console,
            transient=True,
        )
        self._task = self._progress.add_task("starting", total=total)

    def __enter__(self) -> SweepBar:
        self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._progress.stop()

    def show(self, outcomes: Sequence[RunOutcome]) -> None:
        """Show the state after these runs."""
        done, passed = len(outcomes), sum(outcome.passed for outcome in outcomes)
        last = outcomes[-1]
        text = f"{last.scenario}: [green]{passed} passed[/], [red]{done - passed} failed[/]"
        self._progress.update(self._task, description=text, completed=done)
        every = max(1, self._total // _LINES)
        if not redraws(self._console) and (done % every == 0 or done == self._total):
            self._console.print(f"{done} of {self._total} runs, {passed} passed")


def show_sweep(summaries: Sequence[RunSummary], console: Console, *, metrics: bool) -> None:
    """Print the overview, all `metrics` if wanted, and which seeds failed what."""
    if not summaries:
        return
    console.print(_overview(summaries))
    if metrics:
        for scenario in dict.fromkeys(summary.scenario for summary in summaries):
            console.print(_metric_table([summary for summary in summaries if summary.scenario == scenario]))
    for summary in summaries:
        for reason, seeds in sorted(summary.failures.items(), key=lambda item: -len(item[1])):
            shown = ", ".join(map(str, seeds[:_MOST_SEEDS])) + (" ..." if len(seeds) > _MOST_SEEDS else "")
            count = f"{len(seeds)} of {summary.runs}"
            console.print(f"[red]✗[/] {summary.title}: {escape(reason)}: {count}, seeds {shown}", soft_wrap=True)
    passed, runs = sum(summary.passed for summary in summaries), sum(summary.runs for summary in summaries)
    color = "green" if passed == runs else "red"
    console.print(f"[bold {color}]{passed} of {runs} runs passed[/]")


def _overview(summaries: Sequence[RunSummary]) -> Table:
    table = Table(caption="median / 95 % over the runs that have it", title_justify="left")
    add_names(table, "scenario")
    if any(summary.policy for summary in summaries):
        add_names(table, "policy")
    add_numbers(table, "passed")
    names = [name for name in MAIN if any(name in summary.metrics for summary in summaries)]
    for name in names:
        table.add_column(MAIN[name], justify="right", overflow="fold")
    add_numbers(table, "a run\ntakes")
    for summary in summaries:
        color = "green" if summary.passed == summary.runs else "red"
        cells = [summary.scenario, *([summary.policy or "default"] if any(s.policy for s in summaries) else [])]
        cells.append(f"[{color}]{summary.passed}/{summary.runs}[/]")
        cells += [_cell(name, summary.metrics.get(name), summary.runs) for name in names]
        table.add_row(*cells, f"{summary.wall_s:.1f} s")
    return table


def _metric_table(summaries: Sequence[RunSummary]) -> Table:
    """All metrics of one scenario, a column for each policy."""
    table = Table(title=summaries[0].scenario, caption="median / 95 % / worst", title_justify="left")
    add_names(table, "metric")
    for summary in summaries:
        table.add_column(summary.policy or "", justify="right", overflow="fold")
    for name in dict.fromkeys(name for summary in summaries for name in summary.metrics):
        cells = [_cell(name, summary.metrics.get(name), summary.runs, worst=True) for summary in summaries]
        table.add_row(name, *cells)
    return table


def _cell(name: str, spread: Spread | None, runs: int, *, worst: bool = False) -> str:
    """`median / 95 %`, with how many runs have it if not all."""
    if spread is None:
        return "-"
    values = [spread.median, spread.p95, *([spread.worst] if worst else [])]
    found = " / ".join(_written(name, value) for value in values)
    return f"{found} {_unit(name)}".rstrip() + (f" (n={spread.count})" if spread.count < runs else "")


def _written(name: str, value: float) -> str:
    return f"{value * 1000:.2f}" if name.endswith("_m") else f"{value:.2f}" if _unit(name) else f"{value:g}"


def _unit(name: str) -> str:
    match = re.search(r"_(m|rad|s)$", name)
    return "" if match is None else {"m": "mm"}.get(match[1], match[1])
