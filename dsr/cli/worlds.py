"""`dsr worlds`: the worlds of the running graph."""

from __future__ import annotations

from datetime import datetime
from typing import Any

import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table

from dsr.cli.common import GraphOption, JsonOption, RouterOption, SecurityOption, console, print_json, reading, shown
from dsr.errors import TransportError, WorldNotFoundError
from dsr.memory import Memory
from dsr.worlds.registry import WorldInfo

app = typer.Typer()

_PATIENCE = 2.0
"""s that those who hold a world get to hand it on, to be counted."""


@app.command()
def worlds(
    graph: GraphOption = None,
    as_json: JsonOption = False,
    router: RouterOption = None,
    security: SecurityOption = None,
) -> None:
    """List the worlds of the running graph: what each was forked from or follows, who made it, when, and its size."""
    with reading(graph, router, security) as memory:
        rows = [_summary(memory, info) for info in memory.worlds()]
    if as_json:
        print_json(rows)
        return
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for column in ("world", "begun as", "made by", "at"):
        table.add_column(column, no_wrap=True)
    for column in ("nodes", "edges", "held by"):
        table.add_column(column, justify="right", no_wrap=True)
    for row in rows:
        parent = "" if row["parent"] is None else f"{'follows' if row['follows'] else 'fork of'} {row['parent']}"
        made = f"{datetime.fromtimestamp(row['created']):%Y-%m-%d %H:%M:%S}" if row["created"] else ""
        sizes = ["" if row[key] is None else str(row[key]) for key in ("nodes", "edges", "held_by")]
        table.add_row(shown(row["name"]), shown(parent), shown(row["creator"]), made, *sizes)
    console.print(table)


def _summary(memory: Memory, info: WorldInfo) -> dict[str, Any]:
    row: dict[str, Any] = {
        "name": info.name,
        "parent": info.parent,
        "follows": info.follows,
        "creator": info.creator,
        "created": info.created,
    }
    try:
        world = memory.world(info.name, timeout=_PATIENCE)
    except (WorldNotFoundError, TransportError):  # nobody holds it any more, or it was deleted just now
        return {**row, "nodes": None, "edges": None, "held_by": 0}
    return {**row, "nodes": len(world.nodes()), "edges": len(world.edges()), "held_by": len(world.peers)}
