"""The command `dsr replay`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import msgspec
import typer

from agents.replay.control import Controls, parse_command, send
from agents.replay.player import Player
from agents.replay.session import Session
from agents.replay.source import ReplayedGraph
from dsr.cli.common import JsonOption, RouterOption, SecurityOption, console, errors, print_json, reading, shown
from dsr.connect import connect
from dsr.errors import ConfigError
from dsr.keys import check_name
from dsr.rendezvous import endpoints

_INTERRUPTED = 130
_SHOWN = 5  # reasons why something was left out

app = typer.Typer(
    name="replay", invoke_without_command=True, subcommand_metavar="",
    context_settings={"allow_interspersed_args": True},
)  # fmt: skip


@app.callback()
def replay(
    recording: Annotated[Path | None, typer.Argument(help="A recording.mcap, or the folder of a run.")] = None,
    name: Annotated[str, typer.Option(help="Name of the graph that the replay runs as.")] = "replay",
    speed: Annotated[str, typer.Option(help="Recorded seconds a second, or max.")] = "1",
    begin: Annotated[float, typer.Option("--from", min=0.0, metavar="S", help="Where to start.")] = 0.0,
    until: Annotated[float | None, typer.Option(min=0.0, metavar="S", help="Where to end.")] = None,
    pause_at: Annotated[float | None, typer.Option(min=0.0, metavar="S", help="Pause there.")] = None,
    stay: Annotated[bool | None, typer.Option(help="At the end, hold the last state; default: in a terminal.")] = None,
    control: Annotated[
        str | None,
        typer.Option(metavar="COMMAND", help="Tell the running replay: pause, resume, seek S, speed X, state, quit."),
    ] = None,
    as_json: JsonOption = False,
    router: RouterOption = None,
    security: SecurityOption = None,
) -> None:
    """Play a recording back as a running graph: look at it with `dsr watch -g replay`, `dsr show`, `dsr tree`, ...

    Times are seconds since the recording's first message. In a terminal: space pauses, the arrows
    seek by 5 s and change the speed, q quits. From elsewhere:

        dsr replay --control "seek 12.5"

    A truncated recording is played up to the cut.
    """
    if control is not None:
        command = parse_command(control)
        with reading(name, router, security) as memory:
            state = send(memory.transport, memory.keys, command)
        if as_json:
            print_json(msgspec.to_builtins(state))
        else:
            playing = "at the end" if state.ended else "playing" if state.playing else "paused"
            console.print(f"{playing} at {state.time:.3f} s of {state.until:.3f} s, speed {state.speed:g}")
        return
    source = open_recording(recording)
    play(source, check_name("graph name", name), _speed(speed), begin, until, pause_at, stay, router, security)


def open_recording(path: Path | None) -> ReplayedGraph:
    """The recording, after telling what of it is missing. Raises `ConfigError` if none was named."""
    if path is None:
        raise ConfigError("which recording? Give a recording.mcap or the folder of a run")
    source = ReplayedGraph(path)
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
    router: str | None,
    security: Path | None,
) -> None:
    """Play in this terminal."""
    if endpoints(name):
        raise ConfigError(f"graph {name!r} runs already; give the replay another name: --name")
    stay = console.is_terminal if stay is None else stay
    routers = [router] if router else ()
    with connect(name, agent="replay", connect=routers, security=security) as memory:
        player = Player(source, memory, begin=begin, until=until, speed=speed, pause_at=pause_at)
        controls = Controls(memory.transport, memory.keys, player)
        console.print(f"graph {name}: {source.duration:.1f} s from {shown(str(source.index.path))}", soft_wrap=True)
        try:
            Session(source, player, controls, stay=stay, console=console).run()
        except KeyboardInterrupt:
            raise typer.Exit(_INTERRUPTED) from None
        finally:
            controls.close()
    _report(source, player)


def _speed(text: str) -> float:
    try:
        value = math.inf if text == "max" else float(text)
    except ValueError:
        value = math.nan
    if not value > 0:
        raise ConfigError(f"--speed {text}: expected a positive number, or max")
    return value


def _report(source: ReplayedGraph, player: Player) -> None:
    """Say what was left out."""
    if source.malformed:
        errors.print(f"[yellow]{source.malformed} changes left out: {shown(source.first_malformed)}[/]", soft_wrap=True)
    for reason, count in player.mirror.left_out.most_common(_SHOWN):
        errors.print(f"[yellow]left out {count} times: {shown(reason)}[/]", soft_wrap=True)
