"""`dsr worlds`: the worlds of the running graph."""

from __future__ import annotations

import contextlib
import threading
from datetime import datetime
from typing import Annotated, Any

import typer
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
    naming,
    print_json,
    reading,
    shown,
    writing,
)
from dsr.clock import WALL_CLOCK
from dsr.errors import TransportError, WorldNotFoundError
from dsr.memory import Memory
from dsr.network.keys import BASE
from dsr.replication.holders import HOLDER_PATIENCE
from dsr.worlds.presence import WorldPresence
from dsr.worlds.registry import WorldInfo

app = typer.Typer()

_PATIENCE = 2.0
"""s that those who hold a world get to hand it on, to be counted."""
_LOOK_AGAIN = 0.02
"""s"""


@app.command()
def worlds(
    graph: GraphOption = None,
    delete: Annotated[
        list[str] | None, typer.Option("--delete", metavar="WORLD", help="Delete this world; may be repeated.")
    ] = None,
    as_json: JsonOption = False,
    router: RouterOption = None,
    security: SecurityOption = None,
) -> None:
    """List the worlds of the running graph: what each was forked from or follows, who made it, when, and its size.

    With --delete, delete worlds instead, also those that nobody holds any more: every process drops them.
    """
    if delete:
        with writing(graph, router, security, "dsr") as memory, naming():
            for name in delete:
                memory.delete_world(name)
        if as_json:
            print_json([{"deleted": name} for name in delete])
        return
    with reading(graph, router, security) as memory:
        held = _held(memory)
        rows = [_summary(memory, info, info.name in held) for info in memory.worlds()]
    if as_json:
        print_json(rows)
        return
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    add_names(table, "world", "begun as", "made by")
    table.add_column("at", no_wrap=True)
    add_numbers(table, "nodes", "edges", "held by")
    for row in rows:
        parent = "" if row["parent"] is None else f"{'follows' if row['follows'] else 'fork of'} {row['parent']}"
        made = f"{datetime.fromtimestamp(row['created']):%Y-%m-%d %H:%M:%S}" if row["created"] else ""
        sizes = ["" if row[key] is None else str(row[key]) for key in ("nodes", "edges", "held_by")]
        table.add_row(shown(row["name"]), shown(parent), shown(row["creator"]), made, *sizes)
    console.print(table)


def _held(memory: Memory) -> set[str]:
    """Names of the worlds that somebody holds, as soon as all are known to be held, or after `HOLDER_PATIENCE`."""
    with contextlib.closing(WorldPresence(memory)) as presence:
        until = WALL_CLOCK.monotonic() + HOLDER_PATIENCE
        while True:
            agents = presence.agents()
            held = {BASE, *(name for name, present in agents.items() if present)}
            if held >= agents.keys() or WALL_CLOCK.monotonic() >= until:
                return held
            WALL_CLOCK.wait(threading.Event(), _LOOK_AGAIN)


def _summary(memory: Memory, info: WorldInfo, is_held: bool) -> dict[str, Any]:
    row: dict[str, Any] = {
        "name": info.name,
        "parent": info.parent,
        "follows": info.follows,
        "creator": info.creator,
        "created": info.created,
    }
    nobodys = {**row, "nodes": None, "edges": None, "held_by": 0}
    if not is_held:
        return nobodys
    try:
        world = memory.world(info.name, timeout=_PATIENCE)
    except (WorldNotFoundError, TransportError):  # nobody holds it any more, or it was deleted just now
        return nobodys
    return {**row, "nodes": len(world.nodes()), "edges": len(world.edges()), "held_by": len(world.peers)}
