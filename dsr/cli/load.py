"""`dsr load`: graphs from JSON files, and meshes from OBJ, STL, GLB and COLLADA, into a world of the running system."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dsr.cli.common import (
    AsOption,
    GraphOption,
    RouterOption,
    SecurityOption,
    console,
    errors,
    naming,
    opened,
    shown,
    writing,
)
from dsr.cli.persist import report, warn
from dsr.errors import ConfigError
from dsr.geometry.files import READERS, Up, load_model
from dsr.geometry.mesh import mesh_hashes
from dsr.geometry.placing import OBJECT, put_model
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.network.keys import BASE
from dsr.persistence.files import read_graph

app = typer.Typer()

_PATIENCE = 20.0
"""s that somebody else gets to take the meshes."""
_MOST_WARNINGS = 20


@app.command()
def load(
    places: Annotated[
        list[str],
        typer.Argument(
            metavar="[WORLD] FILE",
            help=f"JSON of dsr or of CORTEX, or meshes: {', '.join(READERS)}; before it a world, if it is not base.",
        ),
    ],
    under: Annotated[
        str, typer.Option("--under", metavar="NODE", help="Meshes: the parent of what is loaded.")
    ] = "world",
    kind: Annotated[str, typer.Option("--type", help="Meshes: the node type of what has one.")] = OBJECT,
    prefix: Annotated[str, typer.Option("--prefix", help="Meshes: put before all names of the file.")] = "",
    at: Annotated[
        str, typer.Option("--at", metavar="X,Y,Z", help="Meshes: where, in the frame of NODE (m).")
    ] = "0,0,0",
    scale: Annotated[float, typer.Option("--scale", help="Meshes: metres of the file's unit, such as 0.001.")] = 1.0,
    up: Annotated[str | None, typer.Option("--up", help="Meshes: the file's axis that points up: x, y or z.")] = None,
    graph: GraphOption = None,
    replace: Annotated[bool, typer.Option("--replace", help="JSON: remove what the file does not have.")] = False,
    router: RouterOption = None,
    security: SecurityOption = None,
    agent: AsOption = "dsr",
) -> None:
    """Add what a file holds to a world of the running system: a graph (JSON), or meshes with their hierarchy and names.

    Nodes that are there are updated. The exit code is 0 once all processes of the graph have them, and somebody else
    the meshes. A wrong file changes nothing: each problem is told, for JSON with line and column.
    """
    if len(places) > 2:
        raise ConfigError(f"expected [WORLD] FILE, got {len(places)} arguments: {' '.join(places)}")
    name, path = places[0] if len(places) > 1 else BASE, Path(places[-1])
    if path.suffix.lower() not in READERS:
        content = read_graph(path)
        warn(content.warnings)
        with writing(graph, router, security, agent) as memory, opened(memory, name) as target:
            warn(content.put_into(target, replace=replace))
        report("loaded", content, f"into {_place(memory, name)}")
        return
    place, axis = _position(at), _axis(up)
    model = load_model(path, scale=scale, up=axis)
    for warning in model.warnings[:_MOST_WARNINGS]:
        errors.print(f"[yellow]{shown(warning)}[/]", soft_wrap=True)
    with writing(graph, router, security, agent) as memory, opened(memory, name) as target, naming():
        names = put_model(target, model, under=under, type=kind, prefix=prefix, at=place)
        hashes = dict.fromkeys(hash for node in names for hash in mesh_hashes(target.node(node)))
        memory.meshes.hand_over(hashes, memory.peers, _PATIENCE)
    console.print(
        f"loaded {len(names)} nodes, {len(hashes)} meshes into {_place(memory, name)}: {', '.join(names[:10])}"
        f"{', ...' if len(names) > 10 else ''}",
        markup=False, soft_wrap=True,
    )  # fmt: skip


def _place(memory: Memory, world: str) -> str:
    return f"graph {memory.graph_name}" if world == BASE else f"world {world} of {memory.graph_name}"


def _position(text: str) -> Pose:
    try:
        x, y, z = map(float, text.split(","))
        return Pose((x, y, z))
    except ValueError:
        raise ConfigError(f"--at {text!r}: expected three numbers in m, such as 0.3,0,0.1") from None


def _axis(text: str | None) -> Up | None:
    match text:
        case None | "x" | "y" | "z":
            return text
    raise ConfigError(f"--up {text!r}: expected x, y or z")
