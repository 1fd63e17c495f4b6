"""Entry point of the `dsr` command: options of all commands, and what errors look like."""

from __future__ import annotations

import logging
import os
import sys
from importlib.metadata import version
from typing import Annotated

import typer

from dsr.cli.commands import Commands
from dsr.cli.interrupts import INTERRUPTED
from dsr.cli.streams import prepare_output
from dsr.config.extras import DISTRIBUTION, missing_extra
from dsr.errors import ConfigError, DsrError
from dsr.runtime.resources import shortage

app = typer.Typer(
    name="dsr",
    cls=Commands,
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
    help="Working memory for robots. Start with `dsr demo`; look into what runs with `dsr ls`, `dsr tree`, `dsr top`.",
)


def _show_version(asked: bool) -> None:
    if asked:
        typer.echo(f"dsr {version(DISTRIBUTION)}")
        raise typer.Exit


@app.callback()
def options(
    debug: Annotated[bool, typer.Option("--debug", help="Show tracebacks and debug logs.")] = False,
    interest: Annotated[
        str | None,
        typer.Option("--interest", metavar="PARTS", help="Parts of the graph to hold, as kitchen,hall; '*' for all."),
    ] = None,
    _version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """Read the options of all commands."""
    from rich.logging import RichHandler

    from dsr.cli.common import errors
    from dsr.connecting import INTEREST, interest_of
    from dsr.runtime.logs import PlainFormatter

    global _debug  # noqa: PLW0603
    _debug = debug
    if interest is not None:
        interest_of(interest)
        os.environ[INTEREST] = interest  # for the processes that a command starts, too
    handler: logging.Handler = logging.StreamHandler()
    handler.setFormatter(PlainFormatter("%(levelname)-8s %(message)s"))
    if errors.is_terminal:  # as wide as it is: lines fill it
        handler = RichHandler(console=errors, show_path=debug, show_time=debug, rich_tracebacks=True)
        handler.setFormatter(PlainFormatter("%(message)s"))
    logging.basicConfig(level=logging.DEBUG if debug else logging.WARNING, handlers=[handler])


_debug = False


def main() -> None:
    """Run the command line: exit code 0 if what was asked holds, 2 for wrong input, 1 for other failures.

    130 if Ctrl-C ended it before there was an outcome, and 141 if nobody reads its output any more.
    """
    prepare_output()
    try:
        app()
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
    except DsrError as error:
        _end(str(error), error, 2 if isinstance(error, ConfigError) else 1)
    except (OSError, MemoryError, RuntimeError, ImportError) as error:  # a folder that cannot be written, a full disk
        said = shortage(error)
        if said is None and isinstance(error, OSError):
            said = f"{f'{error.filename}: ' if error.filename else ''}{error.strerror or error}"
        absent = missing_extra(error)
        _end(absent or said, error, 2 if absent else 1)


def _end(said: str | None, error: Exception, code: int) -> None:
    """Say what went wrong in one line and exit; raise the error if that was asked for, or nothing can be said."""
    if _debug or said is None:
        raise error
    from dsr.cli.common import errors, shown

    errors.print(f"[bold red]{shown(said)}[/]", soft_wrap=True)
    sys.exit(code)
