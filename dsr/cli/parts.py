"""`dsr parts`: the parts of the running graph."""

from __future__ import annotations

import contextlib
import threading
from datetime import datetime
from typing import Any

import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table

from dsr.cli.common import (
    GraphOption,
    JsonOption,
    RouterOption,
    SecurityOption,
    add_names,
    console,
    print_json,
    reading,
    shown,
)
from dsr.clock import WALL_CLOCK
from dsr.memory import Memory
from dsr.network.keys import Keys, agent_of
from dsr.replication.holders import HOLDER_PATIENCE

app = typer.Typer()

_LOOK_AGAIN = 0.02
"""s"""


@app.command()
def parts(
    graph: GraphOption = None,
    as_json: JsonOption = False,
    router: RouterOption = None,
    security: SecurityOption = None,
) -> None:
    """List the parts of the running graph: which types belong there, who made each and when, and who holds it."""
    with reading(graph, router, security, hints=False) as memory:
        held = _holders(memory)
        rows = [
            {"name": info.name, "types": list(info.types), "creator": info.creator, "created": info.created,
             "held_by": sorted(held[info.name])}
            for info in memory.parts()
        ]  # fmt: skip
    if as_json:
        print_json(rows)
        return
    if not rows:
        console.print("there are no parts: everybody holds all of the graph")
        return
    console.print(_table(rows))


def _table(rows: list[dict[str, Any]]) -> Table:
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    add_names(table, "part", "types", "made by")
    table.add_column("at", no_wrap=True)
    add_names(table, "held by")
    for row in rows:
        made = f"{datetime.fromtimestamp(row['created']):%Y-%m-%d %H:%M:%S}"
        types, holders = shown(", ".join(row["types"])), shown(", ".join(row["held_by"]))
        table.add_row(shown(row["name"]), types, shown(row["creator"]), made, holders or "nobody")
    return table


def _holders(memory: Memory) -> dict[str, set[str]]:
    """The agents that hold each part, as soon as each is known to be held, or after `HOLDER_PATIENCE`."""
    found: dict[str, set[str]] = {info.name: set() for info in memory.parts()}
    with contextlib.ExitStack() as watches:
        for name, agents in found.items():
            pattern = Keys(memory.graph_name, part=name).presence()

            def appear(key: str, alive: bool, agents: set[str] = agents) -> None:
                (agents.add if alive else agents.discard)(agent_of(key.rpartition("/")[2]))

            watches.callback(memory.transport.watch_presence(pattern, appear).close)
        until = WALL_CLOCK.monotonic() + HOLDER_PATIENCE
        while not all(found.values()) and WALL_CLOCK.monotonic() < until:
            WALL_CLOCK.wait(threading.Event(), _LOOK_AGAIN)
        return {name: set(agents) for name, agents in found.items()}
