"""The command `dsr timeline`: the past, in a recording or in the running system."""

from __future__ import annotations

import threading
from datetime import datetime
from pathlib import Path
from typing import Annotated

import msgspec
import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table

from agents.replay.cli import open_recording
from agents.replay.control import replayed_time
from agents.replay.listening import LISTEN, Listener, history_of
from agents.replay.selection import KNOWN_KINDS, TIMES, Asking, Selection
from dsr.cli.common import (
    GraphOption,
    JsonOption,
    RouterOption,
    SecurityOption,
    WorldOption,
    add_names,
    add_numbers,
    console,
    errors,
    print_json,
    reading,
    shown,
)
from dsr.clock import WALL_CLOCK
from dsr.errors import ConfigError
from dsr.memory import Memory
from dsr.network.keys import BASE, agent_of
from dsr.runtime.logs import printable
from dsr.timeline import ALLEN, EVENT, SITUATION, SUMMARY, Event, query, tell

_LOOK = 0.1  # s between two looks at a running system
_COLOURS = {"surprised": "yellow", "explained": "cyan", "intention": "bold", "gone": "red", "agent": "dim"}

app = typer.Typer(
    name="timeline", invoke_without_command=True, subcommand_metavar="",
    context_settings={"allow_interspersed_args": True},
)  # fmt: skip


@app.callback()
def timeline(
    recording: Annotated[
        Path | None, typer.Argument(help="A recording.mcap, or the folder of a run; default: the running system.")
    ] = None,
    follow: Annotated[bool, typer.Option("--follow", "-f", help="Of a running system: go on until Ctrl-C.")] = False,
    kinds: Annotated[
        list[str] | None,
        typer.Option("--kind", "-k", help=f"Only these: {', '.join(KNOWN_KINDS)}, or kinds of one's own. Repeatable."),
    ] = None,
    participants: Annotated[
        list[str] | None, typer.Option("--participant", "-p", help="Only with this node or agent. Repeatable: all.")
    ] = None,
    since: Annotated[
        float | None,
        typer.Option(metavar="S", help="Only from then on, as in column s: -60 is a minute ago, live or in a replay."),
    ] = None,
    until: Annotated[float | None, typer.Option(metavar="S", help="Only until then, likewise.")] = None,
    type: Annotated[
        str | None,
        typer.Option("--type", "-t", metavar="TYPE", help="Only event (instants) or situation (what lasts or lasted)."),
    ] = None,
    is_open: Annotated[bool, typer.Option("--open", help="Only situations that still last.")] = False,
    relations: Annotated[
        list[str] | None,
        typer.Option(
            "--relation",
            "-r",
            metavar="RELATION",
            help=f"Only what is surely in this relation to --of: {', '.join(ALLEN)}. Repeatable: any of them.",
        ),
    ] = None,
    of: Annotated[
        str | None,
        typer.Option(
            metavar=f"ENTRY|{TIMES}",
            help="Name of an entry (column entry), or a time as in column s: -60:0, -60: (lasts), -60 (an instant).",
        ),
    ] = None,
    graph: GraphOption = None,
    world: WorldOption = BASE,
    as_json: JsonOption = False,
    router: RouterOption = None,
    security: SecurityOption = None,
) -> None:
    """Show what happened, in order: surprises, explanations, relations, intentions and actions, agents.

    Of a running system, what its timeline holds of the past; with --follow, what happens from now on too.
    With --json --follow, one JSON object a line.

    With --type, --open or --relation, the begin and end of those entries of the timeline, and their names:
    "--open" tells what lasts, "-r during --of -60:0" what happened, or began and was over, in the last minute,
    "-r overlaps --of ENTRY" what had begun before that and ended meanwhile.
    """
    wanted = Selection(kinds or (), participants or (), since, until)
    asking = Asking(type, is_open, relations or (), of)
    if follow and asking.is_given:
        raise ConfigError("--type, --open and --relation ask about the past; --follow tells what happens from now on")
    if recording is None:
        _show_running(graph, world, router, security, wanted, asking, follow=follow, as_json=as_json)
        return
    if follow:
        raise ConfigError("--follow is for a running system; a recording has an end")
    if graph is not None or world != BASE:
        raise ConfigError("--graph and --world are for a running system; a recording is one graph")
    source = open_recording(recording)
    history, begin = history_of(source), source.index.begin
    events = history.events
    wanted.check_found([*events, *tell(history.entries, fully=True)], history.names)
    if asking.is_given:
        if not history.entries:
            errors.print("[dim]no timeline was recorded (agents.chronicler)[/]")
        events = tell(asking.among(history.entries, begin, history.end), fully=True)
    _show(wanted.of(events, begin), begin, as_json=as_json, named=asking.is_given)
    if source.malformed:
        errors.print(f"[yellow]{source.malformed} messages left out: {shown(source.first_malformed)}[/]")


def _show(events: list[Event], begin: float, *, as_json: bool, named: bool) -> None:
    if as_json:
        print_json([msgspec.to_builtins(event) for event in events])
        return
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    add_numbers(table, "s")
    add_names(table, "what", "event", *(["entry"] if named else []))
    for event in events:
        name = [shown(event.details["name"])] if named else []
        row = f"{event.time - begin:.2f}", shown(event.kind), shown(event.text), *name
        table.add_row(*row, style=_COLOURS.get(event.kind, ""))
    console.print(table)


def _show_running(
    graph: str | None,
    world: str,
    router: str | None,
    security: Path | None,
    wanted: Selection,
    asking: Asking,
    *,
    follow: bool,
    as_json: bool,
) -> None:
    with reading(graph, router, security, world) as memory:
        listener, never = Listener(memory), threading.Event()
        if listener.keeper is None:
            WALL_CLOCK.wait(never, LISTEN)
            rest = "it has only what others told" if asking.is_given else "this is what the graph still tells"
            errors.print(f"[dim]nobody writes the timeline (agents.chronicler): {rest}[/]")
        played = replayed_time(memory.transport, memory.keys)
        now, events = WALL_CLOCK.now() if played is None else played, listener.events()
        if not follow:
            entries = query(memory) if asking.is_given else []
            wanted.check_found([*events, *tell(entries, fully=True)], _names(memory))
            if asking.is_given:
                events = tell(asking.among(entries, now, now), fully=True)
            _show(wanted.of(events, now), now, as_json=as_json, named=asking.is_given)
            return
        try:
            wanted.check_participants(events, _names(memory))
        except ConfigError as error:  # who is not there yet may come
            errors.print(f"[yellow]{printable(str(error))}[/]")
        try:
            while True:
                for event in wanted.of(events, now):
                    typer.echo(_json_line(event) if as_json else _line(event))
                WALL_CLOCK.wait(never, _LOOK)
                events = listener.events()
        except KeyboardInterrupt:
            return


def _names(memory: Memory) -> set[str]:
    """Of nodes, without those of the timeline, and of agents."""
    nodes = {node.name for node in memory.nodes() if node.type not in (EVENT, SITUATION, SUMMARY)}
    return nodes | {agent_of(rid) for rid in memory.peers}


def _line(event: Event) -> str:
    time = datetime.fromtimestamp(event.time)
    return f"{time:%H:%M:%S}.{time.microsecond // 1000:03d} {event.kind:<10} {printable(event.text)}"


def _json_line(event: Event) -> str:
    return msgspec.json.encode(event).decode()
