"""The command `dsr timeline`: what happened, in a recording or in the running system."""

from __future__ import annotations

import threading
from datetime import datetime
from pathlib import Path
from typing import Annotated

import msgspec
import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table

from agents.inbox import Inbox
from agents.replay.cli import open_recording
from agents.replay.history import events_of
from dsr.cli.common import (
    GraphOption,
    JsonOption,
    RouterOption,
    SecurityOption,
    console,
    errors,
    print_json,
    reading,
    shown,
)
from dsr.clock import WALL_CLOCK
from dsr.errors import ConfigError, WireError, suggest
from dsr.memory import Memory
from dsr.runtime.logs import printable
from dsr.runtime.status import PERIOD, decode_status
from dsr.timeline import EVENT_KINDS, Event, Timeline

_KINDS = EVENT_KINDS
_LOOK = 0.1  # s between two looks at a running system
_LISTEN = 1.5 * PERIOD
"""s in which every agent is heard at least once"""
_MOST_STATUSES = 1000
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
        list[str] | None, typer.Option("--kind", "-k", help=f"Only these: {', '.join(_KINDS)}. May be repeated.")
    ] = None,
    graph: GraphOption = None,
    as_json: JsonOption = False,
    router: RouterOption = None,
    security: SecurityOption = None,
) -> None:
    """Show what happened, in order: surprises, explanations, relations, intentions and actions, agents.

    Of a running system, what its graph still tells of the past; with --follow, what happens from now on
    too. With --json --follow, one JSON object a line.
    """
    wanted = frozenset(kinds or _KINDS)
    for kind in sorted(wanted.difference(_KINDS)):
        raise ConfigError(f"--kind {kind}: no such kind of event; {suggest(kind, _KINDS)}")
    if recording is None:
        _show_running(graph, router, security, wanted, follow=follow, as_json=as_json)
        return
    if follow:
        raise ConfigError("--follow is for a running system; a recording has an end")
    source = open_recording(recording)
    events = [event for event in events_of(source) if event.kind in wanted]
    _show(events, source.index.begin, as_json=as_json)
    if source.malformed:
        errors.print(f"[yellow]{source.malformed} messages left out: {shown(source.first_malformed)}[/]")


def _show(events: list[Event], begin: float, *, as_json: bool) -> None:
    if as_json:
        print_json([msgspec.to_builtins(event) for event in events])
        return
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("s", justify="right", no_wrap=True)
    table.add_column("what", no_wrap=True)
    table.add_column("event")
    for event in events:
        table.add_row(f"{event.time - begin:.2f}", event.kind, shown(event.text), style=_COLOURS.get(event.kind, ""))
    console.print(table)


class _Listener:
    """The timeline of a running graph."""

    def __init__(self, memory: Memory) -> None:
        self._memory = memory
        self._timeline = Timeline()
        self._watch = memory.watch()
        self._statuses = Inbox(memory.transport, memory.keys.status(), WALL_CLOCK, _MOST_STATUSES)

    def events(self) -> list[Event]:
        """What happened since the last call."""
        now = WALL_CLOCK.now()
        events = self._timeline.note(self._watch.poll(), self._memory, now)
        for message in self._statuses.take():
            try:
                events += self._timeline.note_status(decode_status(message.payload), message.stamp)
            except WireError:  # its sender counts elsewhere
                continue
        return sorted([*events, *self._timeline.note_silence(now)], key=lambda event: event.time)


def _show_running(
    graph: str | None, router: str | None, security: Path | None, wanted: frozenset[str], *, follow: bool, as_json: bool
) -> None:
    with reading(graph, router, security) as memory:
        listener, never = _Listener(memory), threading.Event()
        WALL_CLOCK.wait(never, _LISTEN)
        events = [event for event in listener.events() if event.kind in wanted]
        if not follow:
            _show(events, WALL_CLOCK.now(), as_json=as_json)
            return
        try:
            while True:
                for event in events:
                    typer.echo(_json_line(event) if as_json else _line(event))
                WALL_CLOCK.wait(never, _LOOK)
                events = [event for event in listener.events() if event.kind in wanted]
        except KeyboardInterrupt:
            return


def _line(event: Event) -> str:
    time = datetime.fromtimestamp(event.time)
    return f"{time:%H:%M:%S}.{time.microsecond // 1000:03d} {event.kind:<10} {printable(event.text)}"


def _json_line(event: Event) -> str:
    return msgspec.json.encode(event).decode()
