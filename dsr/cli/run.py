"""`dsr run`: start a system, show how its agents are doing, stop it all on Ctrl-C."""

from __future__ import annotations

import enum
import os
import signal
import sys
import threading
from pathlib import Path
from typing import Annotated

import typer
from rich.live import Live

from dsr.cli.background import ALL_READY, folder_in_background, start_in_background
from dsr.cli.common import RouterOption, SecurityOption, SystemsGraphOption, console, new_run_folder, run_folder, shown
from dsr.cli.completion import complete_system
from dsr.cli.persist import warn
from dsr.cli.status_table import status_table
from dsr.cli.streams import redraws
from dsr.errors import AgentError, ConfigError
from dsr.persistence.files import read_graph
from dsr.runtime.display import has_display
from dsr.runtime.launcher import AgentRow, Launcher
from dsr.runtime.system import System, find_system, load_system

app = typer.Typer()
_VIEWER = "viewer"
"""Of the systems' agents, the one that opens a window."""


class LogLevel(enum.StrEnum):
    """Values of `--log-level`."""

    DEBUG = "debug"
    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


@app.command()
def run(
    system: Annotated[
        str, typer.Argument(help="A TOML file, or the name of one in etc/systems.", autocompletion=complete_system)
    ],
    graph: SystemsGraphOption = None,
    load: Annotated[
        Path | None, typer.Option(metavar="FILE", help="JSON file of what the graph holds at first.")
    ] = None,
    state: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Restore the graph from here, and keep it here: it survives a crash."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of everything random.")] = 0,
    folder: Annotated[Path | None, typer.Option(help="For logs and recordings; default: a new one in runs/.")] = None,
    router: RouterOption = None,
    security: SecurityOption = None,
    log_level: Annotated[LogLevel, typer.Option(help="Of the agents.")] = LogLevel.INFO,
    view: Annotated[
        bool, typer.Option("--view", help="Open the window of the system's viewer; see also `dsr view`.")
    ] = False,
    detach: Annotated[
        bool, typer.Option("--detach", "-d", help="Go on in the background; see `dsr logs` and `dsr stop`.")
    ] = False,
) -> None:
    """Start the agents of a system in processes and supervise them until Ctrl-C.

    Light agents share the process "shared"; `process` in the system file says otherwise.
    Modules beside the file of the system are imported and run: give only files that you trust.
    Agents that crash are started again. Look into the working memory from another terminal: dsr ls, dsr tree,
    dsr watch, dsr top. The exit code is 1 if the agents do not become ready, or all end by themselves.
    """
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)  # whoever started us may ignore it: then nobody learns how agents end
    in_background = folder_in_background()
    folder = in_background or folder
    if detach and in_background is None:
        start_in_background(folder or new_run_folder(find_system(system).stem))
        return
    chosen = load_system(system)
    chosen = chosen.on_graph(graph) if graph else chosen
    chosen = _with_window(chosen) if view else chosen
    content = read_graph(load) if load else None
    if content is not None:
        warn(content.warnings)
    level = log_level.value
    with run_folder(folder, find_system(system).stem) as place, Launcher(
        chosen, place, seed=seed, router=router, log_level=level, security=security, content=content, state=state,
        fork=True,
    ) as launcher:  # fmt: skip
        message = f"graph [bold]{launcher.graph}[/], logs and recordings in [bold]{place}[/], Ctrl-C stops"
        console.print(message, soft_wrap=True)
        if launcher.restored:
            instead = f"; [bold]{load}[/] is not loaded" if load else ""
            console.print(f"restored from [bold]{state}[/]{instead}", soft_wrap=True)
        table = _Table(launcher)
        with table.live:
            try:
                launcher.wait_ready(table.show)
                table.say(ALL_READY)
                launcher.run(threading.Event(), table.show)
            except KeyboardInterrupt:
                table.live.update("")
                table.live.stop()
                console.print(f"stopped; logs and recordings are in [bold]{shown(str(place))}[/]", soft_wrap=True)
                raise typer.Exit(0) from None
    raise AgentError(f"all agents have ended by themselves; their logs are in {place}")


def _with_window(system: System) -> System:
    """The system with a viewer that opens its window. Raises `ConfigError` if there is no viewer or no display."""
    if not any(spec.name == _VIEWER for spec in system.agents):
        raise ConfigError(f"the system has no agent {_VIEWER!r}; watch it from another terminal: dsr view")
    if not has_display(os.environ, sys.platform):
        raise ConfigError("there is no display; serve the view to a browser, from another terminal: dsr view --serve")
    return system.with_config(_VIEWER, spawn=True)


class _Table:
    """Shows the agents' rows: a live table in a terminal, else a line for each change of state."""

    def __init__(self, launcher: Launcher) -> None:
        self._title = f"graph {launcher.graph}"
        self._states: dict[str, str] = {}
        self.live = Live(console=console, refresh_per_second=4, transient=True)

    def say(self, text: str) -> None:
        """Print a line where there is no table."""
        if not redraws(console):
            console.print(text)

    def show(self, rows: list[AgentRow]) -> None:
        """Show the newest rows."""
        if redraws(console):
            self.live.update(status_table(rows, self._title))
            return
        for row in rows:
            if self._states.get(row.agent) != row.state:
                self._states[row.agent] = row.state
                error = f" ({shown(row.last_error)})" if row.last_error else ""
                console.print(f"{row.agent}: {row.state}{error}", soft_wrap=True)
