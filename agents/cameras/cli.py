"""The command `dsr drivers`: which cameras and arms can be used here, and whether one works."""

from __future__ import annotations

import contextlib
import os
import sys
import threading
import tomllib
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Annotated, Any, NoReturn

import msgspec
import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table

from agents.cameras.arm_trial import STEP, ArmFindings, ArmTrial
from agents.cameras.trial import CameraFindings, Trial, picture_of
from agents.drivers import ArmDriver, ArmEntry, CameraDriver, CameraEntry, camera_entry, make_driver
from dsr.cli.common import (
    GraphOption,
    JsonOption,
    add_names,
    check_writable,
    console,
    for_people,
    joinable,
    print_json,
    shown,
)
from dsr.clock import WALL_CLOCK
from dsr.config.extras import check_installed
from dsr.config.plugins import DRIVERS, provided
from dsr.connecting import open_transport
from dsr.errors import ConfigError
from dsr.images.blobs import Frame
from dsr.network.keys import Keys
from dsr.network.local_transport import LocalNetwork
from dsr.network.rendezvous import endpoints
from dsr.network.transport import Transport
from dsr.runtime.display import has_display
from dsr.runtime.signals import set_on_signals

_PERIOD = 0.004
"""s between two looks at a camera: no picture of one at 200 Hz is missed"""
_WATCHED = 5.0
"""s for which a camera is watched where nobody sees it live: a hundred pictures, and one attempt to open it again"""
_READ = 2.0
"""s for which the joints of an arm are read: a hundred samples at 50 Hz"""
_PICTURES = (".png", ".jpg", ".jpeg")

_HELP = "Cameras and arms: which can be used here, and whether one works."

app = typer.Typer(name="drivers", no_args_is_help=True, help=_HELP)


@app.callback()
def drivers() -> None:
    """Cameras and arms: which can be used here, and whether one works."""


class Row(msgspec.Struct, frozen=True):
    """A line of `dsr drivers list`."""

    name: str
    what: str
    gives: str
    needs: str
    extra: str
    available: bool
    missing: list[str]


@app.command("list")
def list_drivers(as_json: JsonOption = False) -> None:
    """List the drivers of cameras and arms: what each needs, and what of that is missing here.

    Packages add drivers of their own in the entry point group dsr.drivers. Try one: dsr drivers try NAME
    """
    rows = [_row(name) for name in provided(DRIVERS)]
    if as_json:
        print_json(rows)
        return
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    add_names(table, "", "driver", "what", "gives", "needs", "extra", "missing here")
    for row in rows:
        mark = "[green]✓[/]" if row.available else "[yellow]![/]"
        texts = (row.name, row.what, row.gives, row.needs, row.extra, "; ".join(row.missing))
        table.add_row(mark, *map(shown, texts))
    console.print(table)


@app.command("try")
def try_driver(
    name: Annotated[str, typer.Argument(help="As dsr drivers list tells them, or module:Class.")],
    options: Annotated[
        list[str] | None, typer.Argument(metavar="[KEY=VALUE]...", help="Options of the driver, values as in TOML.")
    ] = None,
    seconds: Annotated[
        float | None,
        typer.Option("--for", min=0.1, metavar="S", help="Watch so long; default: until Ctrl-C, without a window 5."),
    ] = None,
    save: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="Write the last picture, depth in false colours beside it.")
    ] = None,
    view: Annotated[
        bool | None, typer.Option("--view/--no-view", help="Show it live; default: if there is a display.")
    ] = None,
    move: Annotated[
        bool, typer.Option("--move", help="Of an arm: also move each joint a little and back; asks before.")
    ] = False,
    graph: GraphOption = None,
    as_json: JsonOption = False,
) -> None:
    """Try a camera: show it live, and tell rates, resolution, depth, intrinsics and what is missing. Or try an arm:
    read its joints without moving it.

    No graph needs to run, but for pictures that come over one (plant). The exit code is 1 if no picture comes, or if
    something is wrong with the arm.

    For example: dsr drivers try webcam device=2 fov=60
    """
    entry = None if ":" in name else camera_entry(name)
    given = dict(map(_option, options or ()))
    if move and entry is not None and not isinstance(entry, ArmEntry):
        raise ConfigError(f"--move: {name!r} is no arm")
    if save is not None:
        check_installed(["cv2"], "--save")
        if save.suffix.lower() not in _PICTURES:
            raise ConfigError(f"--save {save}: expected a name that ends with {', '.join(_PICTURES)}")
        if not save.exists():
            check_writable(save, "--save")
            save.unlink()
    live = has_display(os.environ, sys.platform) if view is None else view
    stop = threading.Event()
    with contextlib.ExitStack() as resources:
        bus, keys = resources.enter_context(_network(entry, graph))
        driver: Any = make_driver(name, bus, keys, **given)
        resources.enter_context(closing(driver))
        if isinstance(entry, ArmEntry) or hasattr(driver, "follow"):
            resources.enter_context(set_on_signals(stop))
            _try_arm(name, driver, stop, seconds or _READ, move, as_json)
        window = resources.enter_context(_window(name)) if live else None
        resources.enter_context(set_on_signals(stop))
        for_people(as_json).print(f"watching {shown(name)}; Ctrl-C ends it")
        trial = _watch(driver, window, stop, seconds if seconds or live else _WATCHED)
        findings = trial.findings()
    if as_json:
        print_json(findings)
    else:
        _show(name, given, findings)
    if save is not None and trial.last is not None:
        _write(save, trial.last)
        for_people(as_json).print(f"picture     {shown(str(save))}", soft_wrap=True)
    raise typer.Exit(0 if findings.frames else 1)


def _row(name: str) -> Row:
    try:
        entry = camera_entry(name)
        missing = entry.missing()
    except ConfigError as error:  # of a package that is installed by half
        return Row(name, "", "", "", "", False, [str(error)])
    return Row(name, entry.what, entry.gives, entry.needs, entry.extra, not missing, missing)


def _option(text: str) -> tuple[str, Any]:
    """A pair of KEY=VALUE. What is no value of TOML is a text."""
    key, equals, value = text.partition("=")
    if not (equals and key.isidentifier()):
        raise ConfigError(f"{text!r}: expected an option as KEY=VALUE")
    try:
        return key, tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return key, value


@contextlib.contextmanager
def _network(entry: CameraEntry | None, graph: str | None) -> Iterator[tuple[Transport, Keys]]:
    """That of a running graph, where pictures come over it; else one that leads nowhere."""
    on_bus = entry.on_bus if entry is not None else bool(graph and endpoints(graph))
    if not on_bus:
        yield LocalNetwork(WALL_CLOCK).connect("try"), Keys("try")
        return
    name = joinable(graph, None)
    transport, registration = open_transport(name, "dsr-drivers")
    with closing(registration), closing(transport):
        yield transport, Keys(name)


def _window(name: str) -> Any:
    check_installed(["rerun"], "a live picture (do without by --no-view)")
    from agents.viewer.camera_window import CameraWindow

    return CameraWindow(name)


def _try_arm(
    name: str, driver: ArmDriver, stop: threading.Event, seconds: float, move: bool, as_json: bool
) -> NoReturn:
    """Read the joints of an arm, move it if that is wanted and allowed, and tell. Ends the command."""
    people, trial = for_people(as_json), ArmTrial(driver)
    people.print(f"reading {shown(name)}; Ctrl-C ends it")
    trial.watch(seconds, stop)
    if move and trial.findings().samples:
        question = f"each joint will move by {STEP} rad and back, one after the other; is there room?"
        if typer.confirm(question, err=as_json):
            trial.move(stop)
    findings = trial.findings()
    if as_json:
        print_json(findings)
    else:
        _show_arm(findings)
    raise typer.Exit(0 if findings.is_good else 1)


def _show_arm(found: ArmFindings) -> None:
    if not found.samples:
        console.print(f"[bold red]no sample came[/]: {shown(found.trouble) or 'nothing was said'}", soft_wrap=True)
        return
    rate = "" if found.rate_hz is None else f", {found.rate_hz:.1f} a second"
    console.print(f"samples     {found.samples}{rate}", highlight=False)
    for joint, position in found.positions.items():
        moved = f", moved, and was {found.moved[joint]:.4f} rad off" if joint in found.moved else ""
        console.print(f"joint       {shown(joint)} at {position:.4f} rad{moved}", highlight=False, soft_wrap=True)
    counts = ", ".join(f"{what} {number}" for what, number in sorted(found.counts.items()))
    console.print(f"counted     {shown(counts) or 'nothing went wrong'}", highlight=False, soft_wrap=True)
    if found.trouble:
        console.print(f"[yellow]![/] {shown(found.trouble)}", soft_wrap=True)


def _watch(driver: CameraDriver, window: Any, stop: threading.Event, seconds: float | None) -> Trial:
    """Look until it is time, Ctrl-C is pressed, the window is closed, or nothing comes any more."""
    trial, began = Trial(driver), WALL_CLOCK.monotonic()
    while not stop.is_set():
        frame = trial.look(WALL_CLOCK.now())
        if frame is not None and window is not None:
            window.show(frame)
        is_over = seconds is not None and WALL_CLOCK.monotonic() - began >= seconds
        ended = frame is None and getattr(driver, "ended", False)
        if is_over or ended or (window is not None and window.closed):
            break
        WALL_CLOCK.wait(stop, _PERIOD)
    return trial


def _show(name: str, options: dict[str, Any], found: CameraFindings) -> None:
    if not found.frames:
        console.print(f"[bold red]no picture came[/]: {shown(found.trouble) or 'nothing was said'}", soft_wrap=True)
        return
    rate = "" if found.rate_hz is None else f", {found.rate_hz:.1f} a second"
    console.print(f"pictures    {found.frames}{rate}, {found.width} x {found.height} px", highlight=False)
    if found.delay_s is not None:
        console.print(f"delay       {found.delay_s * 1e3:.0f} ms after the exposure", highlight=False)
    if found.depth_known is not None and found.depth_m is not None:
        near, middle, far = found.depth_m
        spread = f"{near:.2f} to {far:.2f} m, median {middle:.2f} m"
        console.print(f"depth       of {found.depth_known:.0%} of the pixels, {spread}", highlight=False)
    else:
        console.print("depth       none")
    console.print(f"intrinsics  {_intrinsics(found)}", highlight=False, soft_wrap=True)
    counts = ", ".join(f"{what} {number}" for what, number in sorted(found.counts.items()))
    console.print(f"counted     {shown(counts) or 'nothing went wrong'}", highlight=False, soft_wrap=True)
    for text in filter(None, [found.trouble, *found.missing]):
        console.print(f"[yellow]![/] {shown(text)}", soft_wrap=True)
    console.print("\nin a system, for a camera on a stand (docs/how-to/cameras.md):", soft_wrap=True)
    given = ", ".join(f"{key} = {_toml(value)}" for key, value in options.items())
    console.print(shown(f'driver = "{name}"\noptions = {{ {given} }}'), highlight=False, soft_wrap=True)


def _intrinsics(found: CameraFindings) -> str:
    known = found.intrinsics
    if known is None:
        return "none: give a calibration or a field of view"
    fov = "" if found.fov_deg is None else f", {found.fov_deg:.0f} deg wide"
    lens = "no distortion" if known.distortion is None else f"distortion {known.distortion.model}"
    return f"fx {known.fx:.1f}, fy {known.fy:.1f}, cx {known.cx:.1f}, cy {known.cy:.1f} px{fov}, {lens}"


def _toml(value: Any) -> str:
    """A value as TOML has it."""
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key} = {_toml(part)}' for key, part in value.items())} }}"
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    return msgspec.json.encode(value).decode()


def _write(file: Path, frame: Frame) -> None:
    import cv2

    if not cv2.imwrite(str(file), picture_of(frame)):
        raise ConfigError(f"--save {file}: cannot be written")
