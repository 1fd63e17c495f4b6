"""The commands `dsr scenario list | check | truth | generate | run | sweep` and `dsr demo`."""

from __future__ import annotations

import enum
import os
import shlex
import shutil
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import msgspec
import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from agents.scenario.check.file_check import Findings, look_through, show_all, show_doubts
from agents.scenario.check.truth_report import truth
from agents.scenario.format.scenario import load_scenario, scenario_files
from agents.scenario.generate_cli import generate_episode
from agents.scenario.judge.result import write_result
from agents.scenario.options import Hands, SensorChoice, UntaggedOption, complete_scenario
from agents.scenario.run.report import ProgressBar, show_result
from agents.scenario.run.runner import run_live, run_lockstep
from agents.scenario.run.staging import make_run, staged_system
from agents.scenario.sweep_cli import sweep
from dsr.cli.common import (
    JsonFileOption,
    JsonOption,
    add_names,
    add_numbers,
    check_writable,
    console,
    errors,
    for_people,
    print_json,
    put_json,
    run_folder,
    shown,
)
from dsr.cli.interrupts import INTERRUPTED
from dsr.errors import ConfigError
from dsr.runtime.display import has_display

DEMO = "towers"
"""The scenario of `dsr demo`."""


class PolicyChoice(enum.StrEnum):
    """Values of `--policy`."""

    HYPOTHESES = "hypotheses"
    ALGORITHM1 = "algorithm1"
    PUBLISHED = "published"


Seed = Annotated[int, typer.Option(min=0, help="Varies where the objects start and the sensor's noise.")]
View = Annotated[
    bool | None,
    typer.Option("--view/--no-viewer", help="Open the rerun viewer; default: if there is a display, not in lockstep."),
]

app = typer.Typer(
    name="scenario",
    no_args_is_help=True,
    help="Play scenarios: a simulated world, an experimenter, and what must then hold in the working memory. "
    "A scenario is a TOML file; docs/reference/scenarios.md describes the format.",
)
app.command()(sweep)
app.command()(truth)
app.command("generate")(generate_episode)
demo = typer.Typer(name="demo", invoke_without_command=True, subcommand_metavar="")


@app.command("list")
def list_scenarios(as_json: JsonOption = False) -> None:
    """List the built-in scenarios and those in ./etc/scenarios."""
    scenarios, wrong = {}, []
    for name, file in sorted(scenario_files().items()):
        try:
            scenarios[name] = load_scenario(file)
        except ConfigError as error:
            wrong.append(f"{name}: {error}")
    for message in wrong:
        errors.print(f"[yellow]{shown(message)}[/]", soft_wrap=True)
    if as_json:
        rows = [{"name": name, "title": s.title, "duration_s": s.duration} for name, s in scenarios.items()]
        print_json(rows)
        return
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    add_names(table, "name")
    add_numbers(table, "objects", "duration")
    add_names(table, "what it shows")
    for name, scenario in scenarios.items():
        table.add_row(shown(name), str(len(scenario.objects)), f"{scenario.duration:g} s", shown(scenario.title))
    console.print(table)
    console.print("Run one: [bold]dsr scenario run NAME[/]  (in one process, faster: [bold]--lockstep[/])")


@app.command()
def check(
    files: Annotated[
        list[str],
        typer.Argument(help="Scenario files, or names of built-in ones.", autocompletion=complete_scenario),
    ],
    play: Annotated[bool, typer.Option("--play/--no-play", help="Also play the true course with seed 0.")] = True,
    no_import: Annotated[
        bool, typer.Option("--no-import", help="Import no modules beside the file of the system: for files of others.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Check scenario files and their systems without running any agent; tells file, line and what was expected.

    Reads each file and loads the agents of its system. Then plays its true course with seed 0, in about a second,
    as `dsr scenario truth` does: nothing may be put or driven into something else, and moves of one hand or one
    object must not overlap.
    Where a robot has a mission, nobody knows beforehand where things will be: there only hands are looked at.

    What may be meant, such as a thing that falls where it is put, is told with a `!`, and is no error.
    """
    rows = []
    for file in files:
        counts = {}
        try:
            scenario = load_scenario(file)
            parts = ("objects", "events", "expectations")
            counts = {part: len(getattr(scenario, part)) for part in parts}
            found = look_through(file, play=play, beside=not no_import)
        except ConfigError as error:
            found = Findings([error])
        texts = {"errors": list(map(str, found.errors)), "doubts": list(map(str, found.doubts))}
        rows.append({"file": file, "fine": not found.errors, **counts, **texts})
        if not as_json:
            _show_findings(file, found, counts)
    if as_json:
        print_json(rows)
    raise typer.Exit(0 if all(row["fine"] for row in rows) else 1)


def _show_findings(file: str, found: Findings, counts: Mapping[str, int]) -> None:
    for wrong in found.errors:
        console.print(f"[red]✗[/] {escape(str(wrong))}", soft_wrap=True)
    show_doubts(found.doubts, console)
    if not found.errors:
        said = ", ".join(f"{n} {part[:-1] if n == 1 else part}" for part, n in counts.items())
        console.print(f"[green]✓[/] {shown(file)}: {said}", soft_wrap=True)


@app.command()
def run(
    scenario: Annotated[
        str,
        typer.Argument(
            help="A built-in scenario (see `dsr scenario list`) or a TOML file.", autocompletion=complete_scenario
        ),
    ],
    lockstep: Annotated[
        bool, typer.Option("--lockstep", help="All agents in this process, faster than real time, repeatable.")
    ] = False,
    seed: Seed = 0,
    sensor: Annotated[
        SensorChoice, typer.Option(help="Rendered images, or true poses with the noise measured on images.")
    ] = SensorChoice.PIXELS,
    policy: Annotated[
        PolicyChoice | None, typer.Option(help="How surprises are explained, or `published`; default: the system's.")
    ] = None,
    robot: Annotated[
        str, typer.Option(metavar="NAME|FILE", help="An arm of `etc/robots`, or a URDF file, in place of its own.")
    ] = "",
    hands: Hands = None,
    untagged: UntaggedOption = False,
    view: View = None,
    as_json: JsonOption = False,
    json_file: JsonFileOption = None,
) -> None:
    """Run a scenario and judge it; the exit code is 0 only if all its expectations hold.

    What `dsr scenario check` finds is told first, with a `!`; the run goes on and is judged as it happens.

    Without --lockstep every agent is a process of its own, as on a robot:
    watch it with `dsr top` or `dsr watch` from another terminal.
    With --lockstep --view, the viewer runs along: what it shows is faster than real time, and recorded.

    The run leaves a folder in runs/ with recording, logs and result.json.
    """
    show_all(scenario, for_people(as_json))
    options = {
        "seed": seed,
        "sensor": sensor.value,
        "robot": robot,
        "policy": policy and policy.value,
        "hands": hands and hands.value,
        "untagged": untagged,
    }
    _play(scenario, options, lockstep=lockstep, as_json=as_json, json_file=json_file, view=view)


@demo.callback()
def run_demo(
    seed: Seed = 0, view: View = None, as_json: JsonOption = False, json_file: JsonFileOption = None
) -> None:
    """Show what this is about: the robot builds two towers, one is moved as a whole, and the robot knows.

    Starts plant, arm controller, scene estimator, simulation handler, surprise
    detector, planner, viewer and recorder as processes, tells what happens,
    and compares the belief with the truth.

    The exit code is 0 only if all expectations hold. Ctrl-C stops everything.
    """
    _play(DEMO, {"seed": seed}, lockstep=False, as_json=as_json, json_file=json_file, view=view)


def _play(
    scenario: str,
    options: Mapping[str, Any],
    *,
    lockstep: bool,
    as_json: bool,
    json_file: Path | None,
    view: bool | None,
) -> None:
    """Run with these fields of `Run`, show and write the result; ends the program with its exit code."""
    said = for_people(as_json)
    viewer = view if view is not None else not lockstep
    window = viewer and has_display(os.environ, sys.platform)
    if view and not window:
        errors.print("there is no display: the view is only recorded; to watch the run elsewhere: dsr view --serve")
    plan = make_run(scenario, viewer=viewer or not lockstep, window=window, **options)
    check_writable(json_file)
    staged_system(plan)  # what it lacks is told before anything begins
    with run_folder(None, plan.scenario.name) as folder:
        plan = msgspec.structs.replace(plan, folder=folder)
        try:
            with ProgressBar(plan.scenario, said) as bar:
                result = run_lockstep(plan, bar) if lockstep else run_live(plan, bar)
        except KeyboardInterrupt:
            left = f"; logs and recordings until then are in {folder}" if any(folder.iterdir()) else ""
            said.print(f"stopped{left}", soft_wrap=True)
            raise typer.Exit(INTERRUPTED) from None
        write_result(result, folder / "result.json")
    show_result(result, plan.scenario, said)
    _show_files(folder, said)
    put_json(result, as_json=as_json, file=json_file)
    raise typer.Exit(0 if result.passed else 1)


def _show_files(folder: Path, console: Console) -> None:
    """Say what the run left and how to open it."""
    console.print(f"result     {folder / 'result.json'}", soft_wrap=True)
    for recording in sorted(folder.glob("*.rrd")):
        opened = f"{_rerun_program()} {shlex.quote(str(recording))}"
        console.print(f"recording  {recording}   open it with [bold]{opened}[/]", soft_wrap=True)
    for recording in sorted(folder.glob("*.mcap")):
        console.print(f"recording  {recording}   all changes of the memory and sensor data, as MCAP", soft_wrap=True)


def _rerun_program() -> str:
    """How to call rerun: by its path where this environment is not activated."""
    return "rerun" if shutil.which("rerun") else os.path.relpath(Path(sys.executable).with_name("rerun"))
