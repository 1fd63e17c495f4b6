"""The command `dsr robots`: which arms come along, and what the description of one holds."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table

from agents.arm_controller.model.model_report import ArmReport, report_on
from agents.urdf_files import find_robot, known_robots
from dsr.cli.common import JsonOption, add_names, add_numbers, console, print_json, shown
from dsr.errors import ConfigError

app = typer.Typer(name="robots", no_args_is_help=True, help="Arms: which come along, and what a description holds.")


@app.callback()
def robots() -> None:
    """Arms: which come along, and what a description holds."""


@app.command("list")
def list_robots(as_json: JsonOption = False) -> None:
    """List the arms that come along.

    Look into one: dsr robots check NAME
    """
    if as_json:
        print_json([{"name": name, "file": str(file)} for name, file in known_robots().items()])
        return
    for name in known_robots():
        console.print(shown(name), soft_wrap=True)


@app.command()
def check(
    robot: Annotated[str, typer.Argument(metavar="NAME|FILE", help="An arm of `dsr robots list`, or a URDF file.")],
    args: Annotated[
        list[str] | None, typer.Option("--arg", metavar="NAME:=VALUE", help="An argument of its macros (xacro).")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Tell what the description of an arm holds: roles of links, joints with their limits, shapes, and doubts.

    The exit code is 2 if the arm controller would refuse it: for example where a mesh is missing. Nothing moves.

    What may be meant, such as a joint without a limit of speed, is told with a `!`, and is no error.
    """
    report = report_on(find_robot(robot, Path()), dict(map(_argument, args or [])))
    if as_json:
        print_json(report)
        return
    console.print(_joints(report))
    for line in _lines(report):
        console.print(shown(line), soft_wrap=True)
    for doubt in report.doubts:
        console.print(f"[yellow]![/] {shown(doubt)}", soft_wrap=True)


def _argument(text: str) -> tuple[str, str]:
    name, gives, value = text.partition(":=")
    if not gives:
        raise ConfigError(f"--arg {text!r}: expected NAME:=VALUE")
    return name, value


def _joints(report: ArmReport) -> Table:
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    add_names(table, "joint", "type", "moves", "of", "mimics")
    add_numbers(table, "from", "to", "velocity", "effort")
    for joint in report.joints:
        numbers = (joint.lower, joint.upper, joint.velocity, joint.effort)
        texts = (joint.name, joint.kind, joint.moves, joint.role, joint.mimics)
        table.add_row(*map(shown, texts), *("-" if number is None else f"{number:.4g}" for number in numbers))
    return table


def _lines(report: ArmReport) -> list[str]:
    boxes = ", ".join(f"{link} {count}" for link, count in report.boxes.items() if count)
    home = ", ".join(f"{position:.4g}" for position in report.home) or "none"
    return [
        "positions in rad or m, velocities per s, efforts in N m or N; - where there is no limit",
        f"base {report.base}, palm {report.palm}, tool {report.tool}",
        f"opening up to {report.widest * 1e3:.1f} mm" if report.widest else "no fingers",
        f"home {home}",
        f"boxes around collision shapes: {boxes or 'none'}",
    ]
