"""`dsr stop`, `dsr logs`, and how `dsr run --detach` goes on in the background."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated

import msgspec
import typer

from dsr.cli.common import GraphOption, JsonOption, check_runs, console, errors, last_run, shown
from dsr.cli.completion import complete_log
from dsr.clock import WALL_CLOCK
from dsr.errors import AgentError, ConfigError, TransportError, suggest
from dsr.network.rendezvous import Claim, graphs, read_claim, running_graph
from dsr.runtime.launched import exit_text
from dsr.runtime.logs import printable
from dsr.runtime.system import RUN

Show = Callable[[str, list[bytes]], None]
"""Prints lines of an agent's log."""

app = typer.Typer()
ALL_READY = "all agents are ready"
"""Line of a run without a terminal, after which `--detach` lets it go on alone."""
RUN_LOG = f"{RUN}.log"
"""File in the folder of a run in the background: what `dsr run` says."""
_DETACHED = "DSR_DETACHED"
"""Environment variable of the run that goes on in the background: its folder."""
_HEADLINE = re.compile(r"^graph (?P<graph>\S+), logs and recordings in (?P<folder>.+), Ctrl-C stops$", re.MULTILINE)
"""Line in which `dsr run` says which graph it works on, and where its files are. Warnings stand before it."""
_WRONG_INPUT = 2  # exit code of a command
_PERIOD = 0.1  # s between two looks
_PATIENCE = 30.0  # s in which a system ends; agents have 5 s to stop before they are killed


def start_in_background(folder: Path) -> None:
    """Run this command again in a session of its own, where it does not detach, and wait until its agents are ready.

    Ctrl-C until then ends what was started.

    Raises:
        ConfigError: if the input is wrong, with what was said.
        AgentError: if the agents do not become ready, likewise.
    """
    folder.mkdir(parents=True, exist_ok=True)
    log = folder / RUN_LOG
    command = [sys.executable, "-P", "-m", "dsr.cli", *sys.argv[1:]]
    process: subprocess.Popen[bytes] | None = None
    try:
        with log.open("wb") as output, _interrupts_held():
            process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT, start_new_session=True,
                env={**os.environ, _DETACHED: str(folder)},
            )  # fmt: skip
        while ALL_READY not in (said := log.read_text(encoding="utf-8", errors="replace")):
            if (code := process.poll()) is not None:
                said = log.read_text(encoding="utf-8", errors="replace").strip()
                reason = said or f"it ended with {exit_text(code)}, and nothing could be written to {log}"
                kind = ConfigError if code == _WRONG_INPUT else AgentError
                raise kind(f"the system did not start:\n{printable(reason)}")
            _wait()
    except KeyboardInterrupt:
        if process is not None:
            process.terminate()
            process.wait(_PATIENCE)
        raise
    headline = _HEADLINE.search(said)
    assert headline is not None, "a run says it before its agents are ready"
    if warnings := said[: headline.start()].rstrip():
        errors.print(shown(warnings), soft_wrap=True)
    graph = headline["graph"]
    place = f"graph {graph}, logs and recordings in {headline['folder']}"
    console.print(shown(f"{place}; dsr logs -g {graph}, dsr stop -g {graph}"), soft_wrap=True)


@contextlib.contextmanager
def _interrupts_held() -> Iterator[None]:
    """Raise KeyboardInterrupt for a Ctrl-C only when the block is done: what it starts is known by then."""
    came: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if came:
        raise KeyboardInterrupt


def folder_in_background() -> Path | None:
    """The folder of this run, if `start_in_background` started it. Agents that it starts do not inherit that."""
    folder = os.environ.pop(_DETACHED, None)
    return Path(folder) if folder else None


@app.command()
def stop(graph: GraphOption = None) -> None:
    """Stop a system that `dsr run` started on this machine, in whichever terminal."""
    name = running_graph(graph)
    claim = _claim(name)
    with contextlib.suppress(ProcessLookupError):
        os.kill(claim.pid, signal.SIGTERM)
    deadline = WALL_CLOCK.monotonic() + _PATIENCE
    while read_claim(name) == claim:
        if WALL_CLOCK.monotonic() > deadline:
            raise TransportError(f"process {claim.pid} has not ended after {_PATIENCE:.0f} s: kill -9 {claim.pid}")
        _wait()
    console.print(f"graph {shown(name)} has ended; its logs are in {shown(str(claim.folder))}", soft_wrap=True)


@app.command()
def logs(
    agents: Annotated[
        list[str] | None, typer.Argument(help="Names of agents; default: all.", autocompletion=complete_log)
    ] = None,
    lines: Annotated[int, typer.Option("--lines", "-n", min=0, help="How many of each log, from its end.")] = 20,
    follow: Annotated[bool, typer.Option("--follow", "-f", help="Go on with new lines until Ctrl-C.")] = False,
    graph: GraphOption = None,
    as_json: JsonOption = False,
) -> None:
    """Show the logs of the agents of a system that `dsr run` started on this machine.

    If it has ended, those of the last run in the folder runs/ are shown.
    """
    name, folder = _logs_of(graph)
    files = {file.stem: file for file in sorted(folder.glob("*.log"))}
    for agent in agents or ():
        if agent not in files:
            raise ConfigError(f"no log of {agent!r} in {folder}; {suggest(agent, files)}")
    chosen = {agent: Path(files[agent]) for agent in agents or files}
    show = _show_json if as_json else _show
    places = {agent: _show_end(agent, file, lines, show) for agent, file in chosen.items()}
    with contextlib.suppress(KeyboardInterrupt):
        while follow:
            for agent, file in chosen.items():
                places[agent] = _show_from(agent, file, places[agent], show)
            if name is None or read_claim(name) is None:
                break
            _wait()


def _logs_of(graph: str | None) -> tuple[str | None, Path]:
    """The graph that runs and the folder of its logs; of a system that has ended, None and the folder of its last run.

    Raises `ConfigError` if there is neither.
    """
    running = graphs()
    if (folder := last_run(graph)) is not None and (graph not in running if graph else not running):
        which = f"graph {graph} does not run" if graph else "no graph runs"
        errors.print(shown(f"{which} on this machine; these are the logs of the last run, in {folder}"), soft_wrap=True)
        return None, folder
    name = running_graph(graph)
    return name, _claim(name).folder


def _claim(graph: str) -> Claim:
    claim = read_claim(graph)
    if claim is None:
        check_runs(graph)
        raise ConfigError(f"no `dsr run` started graph {graph!r} on this machine; end its processes where they run")
    return claim


def _show_end(agent: str, file: Path, lines: int, show: Show) -> int:
    """Print the last lines of a log; returns where it ends now, in bytes."""
    content = file.read_bytes()
    show(agent, content.splitlines()[-lines:] if lines else [])
    return len(content)


def _show_from(agent: str, file: Path, place: int, show: Show) -> int:
    """Print what a log has got since `place` (bytes) up to its last whole line; returns where that ends."""
    with file.open("rb") as opened:
        opened.seek(place)
        whole, newline, _ = opened.read().rpartition(b"\n")
    show(agent, whole.splitlines() if newline else [])
    return place + len(whole) + len(newline)


def _show(agent: str, lines: list[bytes]) -> None:
    for line in lines:
        typer.echo(f"{agent}: {printable(line.decode(errors='replace'))}")


def _show_json(agent: str, lines: list[bytes]) -> None:
    for line in lines:
        typer.echo(msgspec.json.encode({"agent": agent, "text": line.decode(errors="replace")}).decode())


def _wait() -> None:
    WALL_CLOCK.wait(threading.Event(), _PERIOD)
