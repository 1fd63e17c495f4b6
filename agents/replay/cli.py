"""The command `dsr replay`."""

from __future__ import annotations

import contextlib
import math
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import msgspec
import typer
from rich.progress import Progress

from agents.replay.compare import ReplayOutcome, show, to_json
from agents.replay.control import Controls, parse_command, send
from agents.replay.player import Player
from agents.replay.session import Session
from agents.replay.source import ReplayedGraph
from dsr.cli.common import (
    JsonOption,
    ReplayGraphOption,
    RouterOption,
    SecurityOption,
    console,
    errors,
    print_json,
    reading,
    shown,
)
from dsr.cli.completion import complete_recording
from dsr.cli.interrupts import INTERRUPTED
from dsr.connecting import connect
from dsr.errors import ConfigError
from dsr.network.keys import check_name
from dsr.network.rendezvous import endpoints
from dsr.network.transport import Qos
from dsr.runtime.display import has_display
from dsr.runtime.native_output import silenced
from dsr.vocabulary.replayed import Replayed, replayed_key

Settings = dict[str, dict[str, object]]
"""Fields of configurations, by agent."""
_SHOWN = 5  # reasons why something was left out

app = typer.Typer(
    name="replay", invoke_without_command=True, subcommand_metavar="",
    context_settings={"allow_interspersed_args": True},
)  # fmt: skip


@app.callback()
def replay(
    recording: Annotated[
        Path | None,
        typer.Argument(
            help="A recording.mcap, the folder of a run, or a bag of ROS.", autocompletion=complete_recording
        ),
    ] = None,
    name: ReplayGraphOption = "replay",
    speed: Annotated[str, typer.Option(help="Recorded seconds a second, or max.")] = "1",
    begin: Annotated[float, typer.Option("--from", min=0.0, metavar="S", help="Where to start.")] = 0.0,
    until: Annotated[float | None, typer.Option(min=0.0, metavar="S", help="Where to end.")] = None,
    pause_at: Annotated[float | None, typer.Option(min=0.0, metavar="S", help="Pause there.")] = None,
    stay: Annotated[bool | None, typer.Option(help="At the end, hold the last state; default: in a terminal.")] = None,
    control: Annotated[
        str | None,
        typer.Option(metavar="COMMAND", help="Tell the running replay: pause, resume, seek S, speed X, state, quit."),
    ] = None,
    agents: Annotated[
        str | None,
        typer.Option(metavar="NAME,...", help="Run these agents anew on the recording, compare, play nothing."),
    ] = None,
    tolerance: Annotated[float, typer.Option(min=0.0, metavar="M", help="With --agents: of positions, m.")] = 1e-3,
    turn_tolerance: Annotated[float, typer.Option(min=0.0, metavar="RAD", help="Of rotations, rad.")] = 0.05,
    grace: Annotated[
        float, typer.Option(min=0.0, metavar="S", help="How long without a break the runs may differ.")
    ] = 0.25,
    report: Annotated[bool, typer.Option("--report", help="With --agents: exit code 0 also if runs differ.")] = False,
    system: Annotated[
        str | None, typer.Option(metavar="SYSTEM", help="With --agents: configures them; of a bag, also its bridge.")
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="With --agents; default: as recorded.")] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="AGENT.FIELD=VALUE", help="With --agents: configure one differently; of a bag: ros_bridge."
        ),
    ] = None,
    view: Annotated[
        bool, typer.Option("--view", help="Open a window; without a display: dsr view --serve -g replay.")
    ] = False,
    as_json: JsonOption = False,
    router: RouterOption = None,
    security: SecurityOption = None,
) -> None:
    """Play a recording back as a running graph: look at it with `dsr watch -g replay`, `dsr show`, `dsr tree`, ...

    Times are seconds since the recording's first message. In a terminal: space pauses, the arrows
    seek by 5 s and change the speed, q quits. From elsewhere:

        dsr replay --control "seek 12.5"

    With --agents, the agents run anew, as fast as possible, on what was recorded, without what they had
    written themselves; the exit code is 0 only if they do the same again:

        dsr replay --agents simulation_handler runs/hovering-20260101-120000

    A truncated recording is played up to the cut.

    A bag of ROS (a rosbag2 MCAP, .db3 or folder, or a .bag of ROS 1) is played as a bridge would have written
    it to the graph. The settings of this bridge are those of the agent ros_bridge:

        dsr replay drive.mcap --set ros_bridge.world_frame=odom
    """
    if control is not None:
        _control(control, name, router, security, as_json)
        return
    if agents is not None:
        options = {"system": system, "seed": seed, "until": until, "settings": read_settings(settings or [])}
        tolerances = {"tolerance": tolerance, "turn_tolerance": turn_tolerance}
        differ = _run_anew(_named(recording), agents, grace, as_json, **options, **tolerances)
        raise typer.Exit(1 if differ and not report else 0)
    source = open_recording(recording, read_settings(settings or []), system)
    end = source.duration if until is None else min(until, source.duration)
    if begin > end:
        raise ConfigError(f"--from {begin:g}: expected at most {end:.1f} s, where the replay ends")
    play(source, check_name("graph name", name), _speed(speed), begin, until, pause_at, stay, view, router, security)


def _run_anew(recording: Path, agents: str, grace: float, as_json: bool, **options: Any) -> bool:
    """Run agents (names joined by commas) anew and show how that compares; whether it differs beyond `grace` (s)."""
    names = [part.strip() for part in agents.split(",") if part.strip()]
    outcome = compare(recording, names, **options)
    differences = outcome.differences(grace)
    if as_json:
        print_json(to_json(outcome, differences))
    else:
        show(outcome, differences, console)
    return bool(differences)


def read_settings(texts: list[str]) -> Settings:
    """The fields by agent in texts such as `agent.field=value`, the value as JSON or plain text. `ConfigError`."""
    settings: Settings = {}
    for text in texts:
        path, equals, value = text.partition("=")
        agent, dot, field = path.strip().partition(".")
        if not (equals and dot and agent and field):
            raise ConfigError(f"--set {text}: expected AGENT.FIELD=VALUE")
        try:
            parsed = msgspec.json.decode(value)
        except msgspec.DecodeError:
            parsed = value
        settings.setdefault(agent, {})[field] = parsed
    return settings


def compare(path: Path, agents: list[str], **options: Any) -> ReplayOutcome:
    """Run agents anew (options as of `run_anew`), with a progress bar in a terminal."""
    with Progress(console=errors, transient=True, disable=not errors.is_terminal) as progress:
        task = progress.add_task(f"{', '.join(agents)} anew", total=None)

        def advance(time: float, duration: float) -> None:
            progress.update(task, completed=time, total=duration)

        with silenced():  # pybullet introduces itself
            from agents.replay.anew import run_anew
        return run_anew(path, agents, on_progress=advance, **options)


def _control(text: str, name: str, router: str | None, security: Path | None, as_json: bool) -> None:
    """Tell a running replay what to do."""
    command = parse_command(text)
    with reading(name, router, security) as memory:
        state = send(memory.transport, memory.keys, command)
    if as_json:
        print_json(msgspec.to_builtins(state))
        return
    playing = "at the end" if state.ended else "playing" if state.playing else "paused"
    console.print(f"{playing} at {state.time:.3f} s of {state.until:.3f} s, speed {state.speed:g}")


def _named(path: Path | None) -> Path:
    if path is None:
        raise ConfigError("which recording? Give a recording.mcap or the folder of a run")
    return path


def open_recording(path: Path | None, settings: Settings | None = None, system: str | None = None) -> ReplayedGraph:
    """The recording, after telling how it is understood, and what of it is missing.

    Raises:
        ConfigError: if none was named, or the settings do not fit.
    """
    source = ReplayedGraph(_named(path), settings, system)
    if unknown := sorted((settings or {}).keys() - {source.index.settings_of}):
        raise ConfigError(f"--set {unknown[0]}: no such agent runs; with --agents it runs anew")
    for note in source.index.notes:
        console.print(shown(note), style="dim", soft_wrap=True)
    for problem in source.problems:
        errors.print(f"[yellow]{shown(problem)}; what could be read: {source.duration:.1f} s[/]", soft_wrap=True)
    return source


def play(
    source: ReplayedGraph,
    name: str,
    speed: float,
    begin: float,
    until: float | None,
    pause_at: float | None,
    stay: bool | None,
    view: bool,
    router: str | None,
    security: Path | None,
) -> None:
    """Play in this terminal."""
    if endpoints(name):
        raise ConfigError(f"graph {name!r} runs already; give the replay another name: --graph")
    if view and not has_display(os.environ, sys.platform):
        raise ConfigError(f"there is no display; serve the view, from another terminal: dsr view --serve -g {name}")
    stay = console.is_terminal if stay is None else stay
    routers = [router] if router else ()
    with connect(name, agent="replay", connect=routers, security=security, must_exist=False) as memory:
        player = Player(source, memory, begin=begin, until=until, speed=speed, pause_at=pause_at)
        _tell_missing(player)
        controls = Controls(memory.transport, memory.keys, player)
        console.print(f"graph {name}: {source.duration:.1f} s from {shown(str(source.index.path))}", soft_wrap=True)

        def tell(replayed: Replayed) -> None:
            memory.transport.publish(replayed_key(memory.keys), msgspec.msgpack.encode(replayed), Qos.STREAM)

        try:
            with _window(name, router, security) if view else contextlib.nullcontext():
                Session(source, player, controls, tell=tell, stay=stay, console=console).run()
        except KeyboardInterrupt:
            raise typer.Exit(INTERRUPTED) from None
        finally:
            controls.close()
        _tell_missing(player)
    _report(source, player)


@contextlib.contextmanager
def _window(graph: str, router: str | None, security: Path | None) -> Iterator[None]:
    """A window that shows a graph, as `dsr view` does; it is closed at the end."""
    options = [*(["--connect", router] if router else []), *(["--security", str(security)] if security else [])]
    command = [sys.executable, "-P", "-m", "dsr.cli", "view", "--graph", graph, *options]
    with subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, start_new_session=True) as view:
        try:
            yield
        finally:
            view.terminate()


def _speed(text: str) -> float:
    try:
        value = math.inf if text == "max" else float(text)
    except ValueError:
        value = math.nan
    if not value > 0:
        raise ConfigError(f"--speed {text}: expected a positive number, or max")
    return value


def _tell_missing(player: Player) -> None:
    """Say which meshes nobody has."""
    missing = player.missing_meshes
    for hash, name in sorted(missing.items(), key=lambda pair: pair[1])[:_SHOWN]:
        text = f"mesh {hash[:12]} of {name} is neither in the recording nor on this machine: it is shown without"
        errors.print(f"[yellow]{shown(text)}[/]", soft_wrap=True)
    if len(missing) > _SHOWN:
        errors.print(f"[yellow]and {len(missing) - _SHOWN} more[/]")


def _report(source: ReplayedGraph, player: Player) -> None:
    """Say what was left out."""
    if source.malformed:
        errors.print(f"[yellow]{source.malformed} changes left out: {shown(source.first_malformed)}[/]", soft_wrap=True)
    for finding in source.index.findings():
        errors.print(f"[yellow]{shown(finding)}[/]", soft_wrap=True)
    for reason, count in player.mirror.left_out.most_common(_SHOWN):
        errors.print(f"[yellow]left out {count} times: {shown(reason)}[/]", soft_wrap=True)
