"""`dsr watch`: shows changes of the working memory, line by line."""

from __future__ import annotations

import threading
from datetime import datetime
from typing import Annotated, Any

import msgspec
import typer

from dsr.cli.common import (
    CompanyNotice,
    GraphOption,
    JsonOption,
    RouterOption,
    SecurityOption,
    WorldOption,
    naming,
    plain,
    reading,
    with_unit,
)
from dsr.clock import WALL_CLOCK
from dsr.errors import WorldNotFoundError
from dsr.graph.elements import Edge, Node
from dsr.graph.watch import Change
from dsr.memory import Memory
from dsr.network.keys import BASE
from dsr.runtime.logs import printable

Names = list[str] | None

app = typer.Typer()


@app.command()
def watch(
    graph: GraphOption = None,
    world: WorldOption = BASE,
    node_type: Annotated[Names, typer.Option("--node-type", "--type", "-t", help="Only nodes of this type.")] = None,
    edge_type: Annotated[Names, typer.Option("--edge-type", "-e", help="Only edges of this type.")] = None,
    attribute: Annotated[Names, typer.Option("--attribute", "-a", help="Only this attribute.")] = None,
    period: Annotated[float, typer.Option(min=0.0, help="s between two looks; changes between are joined.")] = 0.2,
    changes_only: Annotated[bool, typer.Option("--new", help="Leave out what is there already.")] = False,
    as_json: JsonOption = False,
    router: RouterOption = None,
    security: SecurityOption = None,
) -> None:
    """Print every change of nodes and edges until Ctrl-C, or until the world is deleted. Options may be repeated.

    Example: dsr watch --node-type cube --attribute perceived
    """
    with reading(graph, router, security, world) as memory:
        with naming():
            changes = memory.watch(
                node_type=node_type, edge_type=edge_type, attribute=attribute, existing=not changes_only
            )
        company = CompanyNotice(memory)
        try:
            while True:
                company.look()
                for change in changes.poll():
                    typer.echo(_json_line(memory, change) if as_json else _text_line(memory, change))
                if changes.closed:
                    raise WorldNotFoundError(f"world {world!r} was deleted")
                WALL_CLOCK.wait(threading.Event(), period)
        except KeyboardInterrupt:
            return


def _values(memory: Memory, change: Change) -> dict[str, Any]:
    """The present values of what changed."""
    element: Node | Edge | None
    if change.element == "node":
        element = memory.get_node(change.name)
    else:
        element = memory.get_edge(change.src, change.dst, change.type)
    return {name: element[name] for name in sorted(change.attributes) if name in element} if element else {}


def _json_line(memory: Memory, change: Change) -> str:
    values = {name: plain(value) for name, value in _values(memory, change).items()}
    ends = {"src": change.src, "dst": change.dst} if change.element == "edge" else {"name": change.name}
    line = {"stamp": memory.clock.now(), "kind": change.kind, "element": change.element, "type": change.type}
    return msgspec.json.encode({**line, **ends, "attributes": values}).decode()


def _text_line(memory: Memory, change: Change) -> str:
    time = datetime.fromtimestamp(memory.clock.now())
    name = change.name if change.element == "node" else f"{change.src} -> {change.dst}"
    values = "  ".join(
        f"{attribute} {with_unit(memory.schema, attribute, value)}"
        for attribute, value in _values(memory, change).items()
    )
    clock = f"{time:%H:%M:%S}.{time.microsecond // 1000:03d}"
    return printable(f"{clock} {change.kind:<7} {change.type} {name}  {values}".rstrip())
