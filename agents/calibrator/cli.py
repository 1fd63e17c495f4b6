"""`dsr calibrate`: find out where a camera is, in the running system or from a recording."""

from __future__ import annotations

import math
import threading
from pathlib import Path
from typing import Annotated

import msgspec
import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table

from agents.calibrator.hand_eye_cli import hand_eye
from agents.calibrator.recorded import calibrate_recorded
from agents.replay.source import ReplayedGraph
from dsr.cli.common import (
    AsOption,
    GraphOption,
    JsonOption,
    RouterOption,
    SecurityOption,
    add_names,
    add_numbers,
    console,
    errors,
    print_json,
    shown,
    writing,
)
from dsr.clock import WALL_CLOCK
from dsr.errors import ConfigError, DsrError, suggest
from dsr.memory import Memory
from dsr.vocabulary.calibration import (
    ANSWERED,
    DEFAULT_METHOD,
    Report,
    checked_method,
    method_names,
    read_report,
    request_calibration,
    request_undo,
)

_PERIOD = 0.1  # s between two looks
_UNANSWERED = 5.0  # s after which nobody seems to calibrate
_SILENT = 180.0  # s without news after which it has ended; it waits for views for 120 s by default
_WITHOUT_REPORT = "the request was removed by somebody"

app = typer.Typer(name="calibrate", invoke_without_command=True, subcommand_metavar="[hand-eye ...]")


app.command("hand-eye")(hand_eye)


@app.callback()
def calibrate(
    context: typer.Context,
    camera: Annotated[
        str, typer.Option("--camera", metavar="NAME", help="Its node; default: the only one that sees objects.")
    ] = "",
    method: Annotated[str, typer.Option(help=f"One of {', '.join(method_names())}.")] = DEFAULT_METHOD,
    force: Annotated[bool, typer.Option("--force", help="Adopt the pose also if it is not well determined.")] = False,
    views: Annotated[
        int, typer.Option(min=1, metavar="N", help="From how many poses of the arm to look; you move it, or --move.")
    ] = 1,
    move: Annotated[
        bool, typer.Option("--move", help="Have the arm that carries the camera move to the further views, and back.")
    ] = False,
    undo: Annotated[
        bool, typer.Option("--undo", help="Take back what the last calibration changed, instead of calibrating.")
    ] = False,
    recording: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Use what this recording, or folder of a run, shows.")
    ] = None,
    begin: Annotated[float, typer.Option("--from", min=0.0, metavar="S", help="With --recording: from then on.")] = 0.0,
    until: Annotated[float | None, typer.Option(min=0.0, metavar="S", help="With --recording: until then.")] = None,
    graph: GraphOption = None,
    as_json: JsonOption = False,
    router: RouterOption = None,
    security: SecurityOption = None,
    agent: AsOption = "dsr",
) -> None:
    """Find out where a camera is, by objects that it sees and whose places are believed; adopt that.

    The running system's agent calibrator looks for a second, then writes the camera's edge if the objects determine its
    pose and most agree with it. With --recording nothing is written. The exit code is 0 only if the pose is adopted, or
    with --recording deserves to be. `dsr calibrate hand-eye` needs no belief: it goes by images of a target.
    """
    if context.invoked_subcommand is not None:
        return
    checked_method(method)
    if until is not None and until <= begin:
        raise ConfigError(f"--until {until:g} is not after --from {begin:g}")
    if move and (views < 2 or recording is not None):
        raise ConfigError("--move takes --views of 2 or more, and no --recording")
    if recording is None and (begin > 0.0 or until is not None):
        raise ConfigError("--from and --until go with --recording only")
    if recording is not None and views > 1:
        raise ConfigError("--views goes without --recording: all views of the arm that it shows are used")
    if undo and (force or views > 1 or recording is not None or method != DEFAULT_METHOD):
        raise ConfigError("--undo goes with --camera only")
    if recording is not None:
        report = calibrate_recorded(ReplayedGraph(recording), camera, method, begin=begin, end=until, force=force)
    else:
        with writing(graph, router, security, agent) as memory:
            _check_camera(memory, camera)
            if undo:
                report = _answer(memory, request_undo(memory, camera))
            else:
                request = request_calibration(memory, camera, method=method, force=force, views=views, move=move)
                report = _answer(memory, request)
    if as_json:
        print_json(msgspec.to_builtins(report))
    else:
        _show(report)
    raise typer.Exit(0 if report.adopted else 1)


def _check_camera(memory: Memory, camera: str) -> None:
    cameras = [node.name for node in memory.nodes("camera")]
    if camera and camera not in cameras:
        raise ConfigError(f"no camera {camera!r}; {suggest(camera, cameras)}")


def _answer(memory: Memory, name: str) -> Report:
    """Wait for what comes of a request. Raises `DsrError` if nothing does."""
    try:
        return _wait(memory, name)
    finally:
        node = memory.get_node(name)
        if node is not None and node.get("status") not in ANSWERED:  # those are shown to others, and removed later
            memory.remove_node(name)


def _wait(memory: Memory, name: str) -> Report:
    heard, told = WALL_CLOCK.monotonic(), ("", "")
    while (node := memory.get_node(name)) is not None:
        status, why = node.get("status", ""), node.get("explanation", "")
        if status in ANSWERED:
            report = read_report(memory, name)
            if report is None:
                raise DsrError(why)
            return report
        if (status, why) != told:
            if why != told[1]:
                errors.print(f"[dim]{shown(why)}[/]")
            heard, told = WALL_CLOCK.monotonic(), (status, why)
        silent = WALL_CLOCK.monotonic() - heard
        if not status and silent > _UNANSWERED:
            raise DsrError("nobody answers: no agent of class agents.calibrator:Calibrator seems to run")
        if silent > _SILENT:
            raise DsrError(f"nothing was heard of the calibrator for {silent:.0f} s; it does not seem to run any more")
        WALL_CLOCK.wait(threading.Event(), _PERIOD)
    raise DsrError(_WITHOUT_REPORT)


def _show(report: Report) -> None:
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    add_names(table, "object")
    add_numbers(table, "before (mm)", "(deg)", "after (mm)", "(deg)")
    add_names(table, "")
    for one in report.objects:
        before, after = (one.before_m, one.before_rad), (one.after_m, one.after_rad)
        numbers = [text for m, rad in (before, after) for text in (f"{1e3 * m:.1f}", f"{math.degrees(rad):.2f}")]
        table.add_row(shown(one.name), *numbers, "disagrees" if one.is_outlier else "")
    if report.objects:
        console.print(table)
    if report.adopted:
        mount = report.before if report.unchanged else report.after
        translation, rotation = (", ".join(f"{x:.6f}" for x in part) for part in (mount[:3], mount[3:]))
        console.print(f"{report.parent} -> {report.camera}:", highlight=False)
        console.print(f"mount = {{ translation = \\[{translation}], rotation = \\[{rotation}] }}", soft_wrap=True)
    style = "" if report.adopted else "[bold red]"
    console.print(f"{style}{shown(report.text)}", soft_wrap=True)
