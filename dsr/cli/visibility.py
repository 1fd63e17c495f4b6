"""`dsr visibility`: which things every camera and person of a world sees, and how much of them."""

from __future__ import annotations

from typing import Annotated

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
    print_json,
    reading,
    shown,
)
from dsr.cli.completion import complete_node, complete_world
from dsr.network.keys import BASE
from dsr.visibility import LEAST_SHARE, WIDTH, is_seen, visibility
from dsr.visibility.perspectives import MOST_WIDTH

app = typer.Typer()


@app.command("visibility")
def show_visibility(
    world: Annotated[str, typer.Argument(metavar="WORLD", help="Which world.", autocompletion=complete_world)] = BASE,
    perspective: Annotated[
        list[str] | None,
        typer.Option("--from", metavar="NAME", help="Only this camera or person.", autocompletion=complete_node),
    ] = None,
    everything: Annotated[bool, typer.Option("--all", help="Also what is not seen.")] = False,
    least: Annotated[
        float, typer.Option("--least", min=0.0, max=1.0, help="Share of a thing from which it is seen.")
    ] = LEAST_SHARE,
    width: Annotated[int, typer.Option(min=16, max=MOST_WIDTH, help="Of the pictures that are drawn (px).")] = WIDTH,
    graph: GraphOption = None,
    as_json: JsonOption = False,
    router: RouterOption = None,
    security: SecurityOption = None,
) -> None:
    """List what is seen from every perspective, with the share of the pixels that each thing would have alone."""
    with reading(graph, router, security, world) as memory:
        found = visibility(memory, perspective, width)
    rows = [
        {"perspective": name, "thing": thing, "seen": seen, **glance._asdict()}
        for (name, thing), glance in sorted(found.items())
        if (seen := is_seen(glance, least)) or everything
    ]
    if as_json:
        print_json(rows)
        return
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    add_names(table, "perspective", "thing")
    add_numbers(table, "share", "pixels")
    add_names(table, "hidden by")
    for row in rows:
        share = f"{100.0 * row['share']:.0f} %" if row["seen"] else f"[dim]{100.0 * row['share']:.0f} %[/]"
        names = shown(row["perspective"]), shown(row["thing"])
        table.add_row(*names, share, str(row["pixels"]), shown(row["hidden_by"]))
    console.print(table)
