"""`dsr relations`: how things are placed relative to each other, as boxes."""

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
    WorldOption,
    add_names,
    add_numbers,
    console,
    errors,
    naming,
    print_json,
    reading,
    shown,
)
from dsr.cli.completion import complete_node
from dsr.errors import ConfigError, suggest
from dsr.network.keys import BASE
from dsr.spatial import SPATIAL, checked_relations, read_scene, read_view
from dsr.spatial.scene import check_no_view

app = typer.Typer()


@app.command()
def relations(
    names: Annotated[
        list[str] | None, typer.Argument(help="Things to tell of; default: all.", autocompletion=complete_node)
    ] = None,
    viewpoint: Annotated[
        str | None,
        typer.Option(
            "--from",
            metavar="NAME",
            help="Camera or frame from which left, behind, ... are seen.",
            autocompletion=complete_node,
        ),
    ] = None,
    kinds: Annotated[
        list[str] | None, typer.Option("--relation", "-r", help=f"Only these: {', '.join(SPATIAL)}. May be repeated.")
    ] = None,
    world: WorldOption = BASE,
    graph: GraphOption = None,
    as_json: JsonOption = False,
    router: RouterOption = None,
    security: SecurityOption = None,
) -> None:
    """Show what is above, beside, in or, with --from, left of or behind what, from believed poses and sizes.

    The margin says by how far a relation holds. Relations from contact are edges: dsr show NAME.
    """
    wanted = checked_relations(kinds) if kinds else None
    if wanted and viewpoint is None:
        check_no_view(wanted, "name a camera or frame with --from")
    with reading(graph, router, security, world) as memory:
        with naming():
            view = None if viewpoint is None else read_view(memory, viewpoint)
            for name in names or ():
                memory.node(name)
        scene = read_scene(memory)
    for name in names or ():
        if name not in scene.boxes:
            raise ConfigError(f"{name!r} is not known to be somewhere, with a size; {suggest(name, scene.boxes)}")
    margins = scene.margins(wanted, names or None, view=view)
    found = {fact: margin for fact, margin in margins.items() if margin >= 0.0}
    if as_json:
        print_json([{**fact._asdict(), "margin_m": margin} for fact, margin in found.items()])
        return
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    add_names(table, "thing", "is", "of what")
    add_numbers(table, "margin (mm)")
    for fact, margin in found.items():
        table.add_row(shown(fact.source), fact.relation, shown(fact.destination), f"{1e3 * margin:.0f}")
    console.print(table)
    if view is None and not kinds:
        errors.print("[dim]in_front_of, behind, left_of and right_of depend on who looks: --from CAMERA[/]")
