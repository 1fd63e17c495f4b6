"""`dsr topology`: who provides and reads which world, how fast, and when last."""

from __future__ import annotations

import contextlib
import threading
from typing import Any

import typer
from msgspec import to_builtins
from rich.box import SIMPLE_HEAD
from rich.table import Table

from dsr.cli.common import (
    GraphOption,
    JsonOption,
    RouterOption,
    SecurityOption,
    add_names,
    add_numbers,
    console,
    print_json,
    reading,
    shown,
)
from dsr.clock import WALL_CLOCK
from dsr.runtime.activity import WorldUse
from dsr.runtime.status import PERIOD
from dsr.runtime.topology import WAITED_FOR, ClientInfo, Topology, TopologyObserver, WorldEntry

app = typer.Typer()

_LISTEN = 1.5 * PERIOD
"""s in which every agent is heard at least once"""
_JUST_NOW = 1.5  # s
_MINUTE = 60.0  # s


@app.command()
def topology(
    graph: GraphOption = None,
    as_json: JsonOption = False,
    router: RouterOption = None,
    security: SecurityOption = None,
) -> None:
    """Show the worlds of a system and the agents that provide and read them, with rates and last activity.

    Listens for a moment first. Processes that are no agents are listed with the worlds that they have open.
    """
    with reading(graph, router, security) as memory:
        with contextlib.closing(TopologyObserver(memory, but=[memory.agent])) as observer:
            WALL_CLOCK.wait(threading.Event(), _LISTEN)
            found, now = observer.look(), WALL_CLOCK.now()
        name = memory.graph_name
    if as_json:
        print_json(to_builtins(found))
        return
    console.print(_table(found, name, now))


def _table(found: Topology, graph: str, now: float) -> Table:
    title = f"worlds of {graph}"
    table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0), title=title, title_justify="left")
    add_names(table, "world", "made from", "agent")
    table.add_column("state", no_wrap=True)
    add_numbers(table, "reads /s", "last", "writes /s", "last")
    for world in found.worlds:
        first = [shown(world.info.name), _origin(world)]
        for client, use in _uses(found, world.info.name):
            table.add_row(*first, shown(client.agent), client.state, *_activity(use, now))
            first = ["", ""]
        if first[0]:
            table.add_row(*first, "", "", "", "", "", "")
    return table


def _uses(found: Topology, world: str) -> list[tuple[ClientInfo, WorldUse]]:
    """Who has to do with a world, those who write it first."""
    uses = [(client, use) for client in found.clients for use in client.uses if use.world == world]
    return sorted(uses, key=lambda pair: (not pair[1].writes, pair[0].agent))


def _origin(world: WorldEntry) -> str:
    if not world.there:
        return f"[yellow]{WAITED_FOR}[/]"
    parent = shown(world.info.parent or "")
    return f"{parent}, live" if parent and world.info.follows else parent


def _activity(use: WorldUse, now: float) -> list[Any]:
    read = (f"{use.read_hz:.1f}", _ago(use.last_read, now)) if use.reads else ("", "")
    written = (f"{use.write_hz:.1f}", _ago(use.last_write, now)) if use.writes else ("", "")
    return [*read, *written]


def _ago(stamp: float | None, now: float) -> str:
    if stamp is None:
        return "never"
    seconds = max(now - stamp, 0.0)
    if seconds < _JUST_NOW:
        return "now"
    return f"{seconds:.0f} s ago" if seconds < _MINUTE else f"{seconds / _MINUTE:.0f} min ago"
