"""Entry point of the `dsr` command: its own commands, and those that other packages add under `dsr.commands`."""

from __future__ import annotations

import logging
import os
import signal
import sys
from importlib.metadata import EntryPoint, entry_points
from typing import Annotated

import typer
from rich.logging import RichHandler
from rich.markup import escape

from dsr.cli import (
    diff,
    doctor,
    hub,
    inspect,
    load,
    persist,
    relations,
    run,
    security,
    stamps,
    top,
    topology,
    visibility,
    watch,
    what_if,
    worlds,
)
from dsr.cli.common import errors, shown
from dsr.errors import ConfigError, DsrError
from dsr.runtime.logs import PlainFormatter
from dsr.runtime.resources import shortage

app = typer.Typer(
    name="dsr",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Working memory for robots. Start with `dsr demo`; look into what runs with `dsr ls`, `dsr tree`, `dsr top`.",
)
for module in (
    run, inspect, relations, visibility, worlds, watch, top, topology, diff, what_if, persist, load, hub, stamps,
    doctor,
):  # fmt: skip
    app.add_typer(module.app)
app.add_typer(security.app)


@app.callback()
def options(
    debug: Annotated[bool, typer.Option("--debug", help="Show tracebacks and debug logs.")] = False,
) -> None:
    """Read the options of all commands."""
    global _debug  # noqa: PLW0603
    _debug = debug
    handler = RichHandler(console=errors, show_path=debug, show_time=debug, rich_tracebacks=True)
    handler.setFormatter(PlainFormatter("%(message)s"))
    logging.basicConfig(level=logging.DEBUG if debug else logging.WARNING, handlers=[handler])


_debug = False


def mount(entry_point: EntryPoint) -> None:
    """Add the command of another package, a typer app, under the entry point's name."""
    try:
        command = entry_point.load()
    except ImportError as error:
        errors.print(f"[yellow]command {entry_point.name!r} cannot be loaded: {escape(str(error))}[/]")
        return
    app.add_typer(command, name=entry_point.name)


def main() -> None:
    """Run the command line: exit code 0 if what was asked holds, 2 for wrong input, 1 for other failures."""
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.default_int_handler)
    for entry_point in sorted(entry_points(group="dsr.commands")):
        mount(entry_point)
    try:
        app()
    except DsrError as error:
        if _debug:
            raise
        errors.print(f"[bold red]{shown(str(error))}[/]", soft_wrap=True)
        sys.exit(2 if isinstance(error, ConfigError) else 1)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # the reader of our output left
    except (OSError, MemoryError, RuntimeError, ImportError) as error:  # a folder that cannot be written, a full disk
        said = shortage(error)
        if said is None and isinstance(error, OSError) and error.filename is not None:
            said = f"{error.filename}: {error.strerror}"
        if _debug or said is None:
            raise
        errors.print(f"[bold red]{escape(said)}[/]", soft_wrap=True)
        sys.exit(1)


if __name__ == "__main__":
    main()
