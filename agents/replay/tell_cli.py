"""The command `dsr tell`: the memory in plain sentences, of now or of a time in a recording."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import msgspec
import typer

from agents.replay.told import moment_of
from dsr.cli.common import (
    GraphOption,
    JsonOption,
    RouterOption,
    SecurityOption,
    WorldOption,
    ZoneOption,
    console,
    errors,
    print_json,
    shown,
)
from dsr.cli.completion import complete_node, complete_recording
from dsr.errors import ConfigError
from dsr.narration import Moment, Statement, account, chapters, person_account
from dsr.narration.calendar import time_span, zone_of
from dsr.network.keys import BASE
from dsr.timeline import TIMELINE

TIME_OPTION = typer.Option(
    "--at", metavar="S", min=0.0, help="Of a recording: when, from its beginning; default: its end."
)
FILE_ARGUMENT = typer.Argument(
    help="A recording, the folder of a run, or a graph saved as JSON; default: the running system.",
    autocompletion=complete_recording,
)

app = typer.Typer(
    name="tell", invoke_without_command=True, subcommand_metavar="",
    context_settings={"allow_interspersed_args": True},
)  # fmt: skip


@app.callback()
def tell(
    file: Annotated[Path | None, FILE_ARGUMENT] = None,
    at: Annotated[float | None, TIME_OPTION] = None,
    since: Annotated[
        str | None,
        typer.Option(
            metavar="WHEN",
            help='Tell what happened from then on: -10 is 10 s ago (default: -60), or words such as yesterday, "this '
            'morning"; of a recording also s from its begin.',
        ),
    ] = None,
    about: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Only what is about this node. Repeatable.", autocompletion=complete_node),
    ] = None,
    person: Annotated[
        str | None, typer.Option("--as", "--person", metavar="PERSON", help="What a person sees and believes.")
    ] = None,
    timezone: ZoneOption = None,
    graph: GraphOption = None,
    world: WorldOption = BASE,
    as_json: JsonOption = False,
    router: RouterOption = None,
    security: SecurityOption = None,
) -> None:
    """Tell in sentences what is where, what is believed though unseen and why, what happened, and what the robot wants.

    A sentence that says "is believed" or "probably" is not seen; all others are what sensors show, or are about
    the robot itself. With --json each sentence comes with its basis, what it claims, and the evidence.
    """
    with moment_of(file, at, graph, world, router, security, zone_of(timezone)) as moment:
        told = told_of(moment, since, about or [], person)
        is_kept = TIMELINE in moment.memory
    if as_json:
        print_json([msgspec.to_builtins(statement) for statement in told])
        return
    show(told)
    if not is_kept:
        errors.print("[dim]no timeline is there (agents.chronicler): nothing tells what happened[/]")


def told_of(moment: Moment, since: str | None, about: list[str], person: str | None) -> list[Statement]:
    """The statements that the options ask for. Raises `ConfigError` for a time or a name that is none."""
    begin = since_when(moment, since)
    if person is None:
        return account(moment, since=begin, about=about)
    told = person_account(moment, person, since=begin)
    return [statement for statement in told if not about or not set(about).isdisjoint(statement.names)]


def since_when(moment: Moment, given: str | None) -> float | None:
    """The time that `--since` means, s. Raises `ConfigError` for none, one after now, or without a beginning."""
    if given is None:
        return None
    try:
        since = float(given)
    except ValueError:
        return time_span(given, moment.now, moment.zone).begin
    if not math.isfinite(since):
        raise ConfigError(f"--since {given}: expected a number of s")
    if since < 0.0:
        return moment.now + since
    if moment.origin is None:
        raise ConfigError(f"--since {since:g}: expected seconds before now, such as -10; a system has no beginning")
    if moment.origin + since > moment.now:
        raise ConfigError(f"--since {since:g}: expected at most {moment.now - moment.origin:.1f}, of which is told")
    return moment.origin + since


def show(told: list[Statement]) -> None:
    """Print sentences below the titles of what they are about."""
    for number, (title, statements) in enumerate(chapters(told)):
        console.print(f"{chr(10) if number else ''}[bold]{title}[/]")
        for statement in statements:
            console.print(f"  {shown(statement.text)}", highlight=False)
    if not told:
        console.print("Nothing is known.")
