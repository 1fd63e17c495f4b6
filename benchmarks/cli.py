"""The command `dsr bench`: measure rows, show them beside their targets and peers, write JSON and plots."""

from __future__ import annotations

import os
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import msgspec
import typer
from rich.console import Console
from rich.markup import escape

from benchmarks import curves, groups, session
from benchmarks.progress import progress_on
from benchmarks.report import rows_table, specs_table
from benchmarks.session import Findings
from benchmarks.workers import BenchmarkError
from dsr.cli.common import JsonFileOption, JsonOption, check_writable, console, errors, for_people, put_json
from dsr.cli.interrupts import INTERRUPTED

_QUIET = 0.5
"""Load above which figures are worse than what the machine could do."""
_PROBE = ".dsr-bench"
"""File that shows whether a folder can be written; it is removed at once."""
_ROWS = "Parts of rows' names, or names of groups; default: all."

app = typer.Typer(
    name="bench", invoke_without_command=True, subcommand_metavar="",
    context_settings={"allow_interspersed_args": True},
)  # fmt: skip


@app.callback()
def bench(
    rows: Annotated[list[str] | None, typer.Argument(help=_ROWS, metavar="ROW")] = None,
    list_rows: Annotated[bool, typer.Option("--list", help="Show rows and targets; measure nothing.")] = False,
    quick: Annotated[bool, typer.Option("--quick", help="Fewer samples: faster, and rough.")] = False,
    repeat: Annotated[int, typer.Option(min=1, metavar="N", help="Run everything N times and report medians.")] = 1,
    plots: Annotated[Path | None, typer.Option("--plots", metavar="FOLDER", help="Write plots (PNG, CSV).")] = None,
    check: Annotated[bool, typer.Option("--check", help="Exit with 1 if a target is missed.")] = False,
    as_json: JsonOption = False,
    json_file: JsonFileOption = None,
) -> None:
    """Measure the memory beside raw TCP, raw Zenoh, ZeroMQ, pycrdt, Loro, Spark-DSG and pytransform3d.

    A row's ratio is our value by that of its first peer, measured in the same run:
    below 1 is better for times and factors, above 1 for rates (units "per s").

    Peers are optional: pip install 'dsr-memory\\[bench]'. Without one, rows are measured without it.
    Quit other programs first; `dsr bench --list` tells how each row is measured.

    The exit code is 0 if all that was asked for was measured, also if targets are missed (see --check).
    """
    chosen = groups.choose(rows or [])
    if list_rows:
        specs = [msgspec.to_builtins(spec) | {"group": group.name} for group, specs in chosen for spec in specs]
        put_json(specs, as_json=as_json, file=json_file)
        if not as_json:
            console.print(specs_table(chosen))
        return
    check_writable(json_file)
    if plots:
        check_writable(plots / _PROBE, "--plots")
        (plots / _PROBE).unlink()
    if os.getloadavg()[0] > _QUIET:
        errors.print(f"[yellow]other programs are busy (load {os.getloadavg()[0]:.1f}): times will be too long[/]")
    findings = Findings()
    code = 0
    try:
        with session.private_runtime(), progress_on(errors) as progress:
            for group, specs in chosen:
                try:
                    session.measure(group, specs, findings, quick=quick, repeat=repeat, progress=progress)
                except BenchmarkError as error:
                    errors.print(f"[bold red]{escape(str(error))}[/]", soft_wrap=True)
                    code = 1
    except KeyboardInterrupt:
        errors.print("stopped; these rows were measured until then")
        code = INTERRUPTED
    _finish(findings, for_people(as_json), plots)
    put_json(findings.rows, as_json=as_json, file=json_file)
    missed = any(row.meets is False for row in findings.rows)
    raise typer.Exit(code or (1 if check and missed else 0))


def _finish(findings: Findings, console: Console, plots: Path | None) -> None:
    """Show what was measured, and draw it."""
    console.print(rows_table(findings.rows))
    met = [row.meets for row in findings.rows if row.meets is not None]
    console.print(f"{sum(met)} of {len(met)} targets met")
    for module in sorted(findings.missing):
        errors.print(f"[yellow]{escape(module)} is not installed, not measured: pip install 'dsr-memory\\[bench]'[/]")
    if plots:
        _draw(findings, console, plots)


def _draw(findings: Findings, console: Console, folder: Path) -> None:
    """Write the curves as CSV, and all plots if matplotlib is there."""
    for file in curves.write(findings.curves, folder):
        console.print(f"curve      {file}", soft_wrap=True)
    if not find_spec("matplotlib"):
        errors.print("[yellow]matplotlib is not installed, so nothing was drawn: pip install 'dsr-memory\\[bench]'[/]")
        return
    from benchmarks.plots import draw

    for file in draw(findings, folder):
        console.print(f"plot       {file}", soft_wrap=True)
