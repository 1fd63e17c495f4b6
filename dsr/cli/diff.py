"""`dsr diff`: shows the differences between two worlds of the running system."""

from __future__ import annotations

import math
from typing import Annotated, Any

import msgspec
import typer

from dsr.cli.common import (
    GraphOption,
    JsonOption,
    RouterOption,
    SecurityOption,
    console,
    naming,
    plain,
    print_json,
    readable,
    reading,
    shown,
)
from dsr.cli.completion import complete_world
from dsr.worlds.comparison import Difference, ElementName, Tolerance, difference

app = typer.Typer()


@app.command()
def diff(
    first: Annotated[
        str, typer.Argument(metavar="WORLD", help="A world, such as base.", autocompletion=complete_world)
    ],
    second: Annotated[
        str, typer.Argument(metavar="WORLD", help="The world to compare it with.", autocompletion=complete_world)
    ],
    metres: Annotated[float, typer.Option(min=0.0, help="Positions this near are equal.")] = 1e-3,
    radians: Annotated[float, typer.Option(min=0.0, help="Rotations this near are equal.")] = 1e-2,
    numbers: Annotated[float, typer.Option(min=0.0, help="Relative tolerance of other numbers.")] = 1e-9,
    ignore: Annotated[list[str] | None, typer.Option("--ignore", help="Not this attribute; may be repeated.")] = None,
    graph: GraphOption = None,
    as_json: JsonOption = False,
    router: RouterOption = None,
    security: SecurityOption = None,
) -> None:
    """Show what differs between two worlds: nodes, edges, attributes, and poses by more than a tolerance.

    The exit code is 0 if they are equal, 1 if they differ, 2 if they could not be compared.
    """
    with reading(graph, router, security) as memory:
        with naming():
            one, other = memory.world(first), memory.world(second)
        found = difference(one, other, Tolerance(metres, radians, numbers), ignore=ignore or ())
    if as_json:
        print_json({"first": first, "second": second, "equal": found.equal, **_json(found)})
    else:
        _show(found, first, second)
    if not found.equal:
        raise typer.Exit(1)


def _show(found: Difference, first: str, second: str) -> None:
    for sign, elements in (("[red]-", found.only_first), ("[green]+", found.only_second)):
        for element in elements:
            console.print(f"{sign}[/] {_text(element)}")
    for one, other in found.retyped:
        console.print(f"[yellow]![/] {shown(one.name)}: {shown(one.type)} | {shown(other.type)}")
    for change in found.attributes:
        values = " | ".join("unset" if value is None else readable(value) for value in (change.first, change.second))
        console.print(f"[yellow]![/] {_text(change.element)}  {shown(change.attribute)}: {shown(values)}")
    for edge in found.edges:
        console.print(f"[yellow]![/] {_text(edge.element)}  pose: {_apart(edge.metres, edge.radians)}")
    for node in found.nodes:
        console.print(f"[cyan]~[/] {shown(node.name)}: {_apart(node.metres, node.radians)}")
    if found.equal:
        console.print(f"{first} and {second} are equal")


def _text(element: ElementName) -> str:
    source, _, destination = element.name.partition(" ")
    if destination:
        return f"{shown(source)} [cyan]--{shown(element.type)}-->[/] {shown(destination)}"
    return f"{shown(element.type)} {shown(element.name)}"


def _apart(metres: float, radians: float) -> str:
    if math.isinf(metres):
        return "has a place in one of the worlds only"
    return f"{metres * 1e3:.2f} mm, {radians:.4f} rad apart"


def _json(found: Difference) -> dict[str, Any]:
    """The difference as plain data; a place that is missing is null."""
    data: dict[str, Any] = msgspec.to_builtins(
        msgspec.structs.replace(found, attributes=[], nodes=[])
    )  # fmt: skip
    data["attributes"] = [
        {
            "element": msgspec.to_builtins(change.element),
            "attribute": change.attribute,
            "first": plain(change.first),
            "second": plain(change.second),
        }
        for change in found.attributes
    ]
    data["nodes"] = [
        {"name": node.name, "metres": None if math.isinf(node.metres) else node.metres, "radians": node.radians}
        for node in found.nodes
    ]
    return data
