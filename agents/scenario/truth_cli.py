"""The command `dsr scenario truth`: the true course of a scenario, played without any agent."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from agents.scenario.faults import faults
from agents.scenario.options import check_writable
from agents.scenario.runner import true_course
from agents.scenario.staging import make_run
from agents.scenario.truth_report import show_truth, truth_report, write_truth
from dsr.cli.common import console


def truth(
    scenario: Annotated[str, typer.Argument(help="A built-in scenario (see `dsr scenario list`) or a TOML file.")],
    seed: Annotated[int, typer.Option(min=0, help="Varies where the objects start.")] = 0,
    json: Annotated[Path | None, typer.Option("--json", help="Also write the course to this file.")] = None,
) -> None:
    """Show what truly happens in a scenario, without any agent: events, when what moves and where it comes to rest.

    Plays only the simulated world with the experimenter's events, without images.
    What waits for the robot does not happen, for nothing moves the arm.

    The exit code is 1 if an event could not be carried out, puts or drives things into one another, or begins
    while an earlier one of the same hand or object is still going on.
    """
    if json:
        check_writable(json)
    run = make_run(scenario, seed=seed)
    history = true_course(run)
    report = truth_report(history, seed)
    if json:
        write_truth(report, json)
    show_truth(report, console)
    if run.scenario.mission is not None:
        console.print("The robot does nothing here: what its mission would bring about does not happen.")
    found = faults(history)
    for fault in found:
        _, index = fault.path
        console.print(f"[red]✗[/] event {int(index) + 1}: {escape(fault.text)}")
    raise typer.Exit(1 if found else 0)
