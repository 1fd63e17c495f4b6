"""`dsr ls`, `dsr show`, `dsr tree`: show the present content of the working memory."""

from __future__ import annotations

from typing import Annotated, Any

import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.tree import Tree

from dsr.cli.common import (
    GraphOption,
    JsonOption,
    RouterOption,
    SecurityOption,
    WorldOption,
    add_names,
    console,
    counted,
    naming,
    plain,
    print_json,
    readable,
    reading,
    shown,
    with_unit,
)
from dsr.cli.completion import complete_node
from dsr.frames.tree import BELIEVED, WORLD
from dsr.graph.elements import Edge, Node
from dsr.graph.schema import Schema
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.network.keys import BASE
from dsr.timeline import TIMELINE
from dsr.vocabulary.relations import THINGS

app = typer.Typer()

_STRUCTURE = ("RT", "has", "next")
"""Edge types along which `dsr tree` goes down."""
_NOTES = {("perceived", False): "not seen", ("plausible", False): "implausible", ("surprising", True): "surprising"}
"""What `dsr ls` says about a node with this value of this attribute."""
_POSE_UNIT = "m, quaternion"
_PLACE_WIDTH = 23  # columns that three coordinates below 100 m take


@app.command()
def ls(
    kind: Annotated[str | None, typer.Option("--type", "-t", help="Only nodes of this type.")] = None,
    everything: Annotated[bool, typer.Option("--all", "-a", help="All nodes, not only things.")] = False,
    graph: GraphOption = None,
    world: WorldOption = BASE,
    as_json: JsonOption = False,
    router: RouterOption = None,
    security: SecurityOption = None,
) -> None:
    """List the things: where they were perceived and where they are believed to be, in the world frame (m).

    Things are cubes, boxes, containers, cups and balls, and nodes of types of your own. `--all` lists all nodes,
    `--type` those of one type.
    """
    with reading(graph, router, security, world) as memory:
        with naming():
            wanted = kind or (None if everything else [*THINGS, *_own_types(memory)])
            nodes = sorted(memory.nodes(wanted), key=lambda node: (node.type, node.name))
        rows, count = [_summary(memory, node) for node in nodes], len(memory.nodes())
    if as_json:
        print_json(rows)
        return
    table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    add_names(table, "node", "type")
    for column in ("perceived at (m)", "believed at (m)"):
        table.add_column(column, no_wrap=True, min_width=_PLACE_WIDTH)
    add_names(table, "notes")
    for row in rows:
        places = [_place(row[key]) for key in ("perceived_at_m", "believed_at_m")]
        table.add_row(shown(row["name"]), shown(row["type"]), *places, ", ".join(row["notes"]))
    hidden = 0 if kind is not None or everything else count - len(rows)
    if rows:
        console.print(table)
        said = f"and {counted(hidden, 'other node')}: --all"
    else:
        what = "no nodes" if everything else "no things" if kind is None else f"no nodes of type {shown(kind)}"
        console.print(f"there are {what}")
        said = f"{counted(hidden, 'other node')}: --all"
    if hidden:
        console.print(said, style="dim")


def _own_types(memory: Memory) -> set[str]:
    """Types of nodes that somebody registered in this graph."""
    return memory.schema.node_types.keys() - Schema().node_types.keys()


def _summary(memory: Memory, node: Node) -> dict[str, Any]:
    believed = any(edge.type == "Virtual_RT" for edge in memory.edges(dst=node.name))
    return {
        "name": node.name,
        "type": node.type,
        "perceived_at_m": _position(memory, node.name, ("RT",)),
        "believed_at_m": _position(memory, node.name, BELIEVED) if believed else None,
        "attributes": sorted(node),
        "notes": [note for (name, value), note in _NOTES.items() if node.get(name) is value],
    }


def _position(memory: Memory, name: str, types: tuple[str, ...]) -> list[float] | None:
    pose = memory.get_transform(WORLD, name, types=types)
    return None if pose is None else list(pose.t)


def _place(position: list[float] | None) -> str:
    return " ".join(f"{round(number, 4) + 0.0:7.4f}" for number in position) if position else ""


@app.command()
def show(
    name: Annotated[str, typer.Argument(help="Name of a node.", autocompletion=complete_node)],
    graph: GraphOption = None,
    world: WorldOption = BASE,
    as_json: JsonOption = False,
    router: RouterOption = None,
    security: SecurityOption = None,
) -> None:
    """Show everything about a node: its attributes with units, and the edges from and to it."""
    with reading(graph, router, security, world) as memory:
        with naming():
            node = memory.node(name)
        edges = [*memory.edges(src=name), *memory.edges(dst=name)]
        if as_json:
            print_json(
                {
                    "name": node.name,
                    "type": node.type,
                    "attributes": _plain(node),
                    "edges": [{"src": e.src, "dst": e.dst, "type": e.type, "attributes": _plain(e)} for e in edges],
                }
            )
            return
        meaning = memory.schema.node_types.get(node.type, node.type)
        console.print(f"[bold]{shown(node.name)}[/]: {shown(meaning)}")
        console.print(_attribute_table(memory, node))
        if edges:
            console.print("edges; a pose is x y z in m, then the quaternion x y z w of its rotation", style="dim")
        for edge in edges:
            values = "  ".join(f"{key} {with_unit(memory.schema, key, edge[key])}" for key in edge)
            src, type, dst = (shown(part) for part in (edge.src, edge.type, edge.dst))
            console.print(f"{src} [cyan]--{type}-->[/] {dst}  {shown(values)}")


def _plain(element: Node | Edge) -> dict[str, Any]:
    return {name: plain(element[name]) for name in element}


def _attribute_table(memory: Memory, node: Node) -> Table:
    table = Table()
    add_names(table, "attribute", "value", "unit", "meaning")
    for name in node:
        known = memory.schema.attributes.get(name)
        unit, meaning = (known.unit, known.meaning) if known else ("", "")
        unit = _POSE_UNIT if isinstance(node[name], Pose) else unit
        table.add_row(shown(name), shown(readable(node[name])), unit, meaning)
    return table


@app.command()
def tree(
    graph: GraphOption = None,
    world: WorldOption = BASE,
    as_json: JsonOption = False,
    router: RouterOption = None,
    security: SecurityOption = None,
) -> None:
    """Show how nodes hang together: frames under their parents, parts under wholes, plan steps in order."""
    with reading(graph, router, security, world) as memory:
        roots = build_forest(memory)
        name = memory.graph_name if world == BASE else f"{memory.graph_name}, world {world}"
    if as_json:
        print_json(roots)
        return
    drawing = Tree(f"graph [bold]{shown(name)}[/]")
    for root in roots:
        _draw(drawing, root)
    console.print(drawing)


def build_forest(memory: Memory) -> list[dict[str, Any]]:
    """The nodes as nested dictionaries, each node once, below the first parent that leads to it."""
    seen: set[str] = set()
    names = sorted(node.name for node in memory.nodes())
    roots = [name for name in names if not any(edge.type in _STRUCTURE for edge in memory.edges(dst=name))]
    forest = [_branch(memory, name, "", seen) for name in roots]
    return forest + [_branch(memory, name, "", seen) for name in names if name not in seen]  # those in cycles


def _branch(memory: Memory, name: str, edge_type: str, seen: set[str]) -> dict[str, Any]:
    seen.add(name)
    edges = [edge for kind in _STRUCTURE for edge in memory.edges(kind, src=name)]
    children = []
    if name == TIMELINE:  # `dsr timeline` shows them
        seen.update(edge.dst for edge in edges)
    for edge in sorted(edges, key=lambda edge: edge.dst):
        if edge.dst not in seen:
            children.append(_branch(memory, edge.dst, edge.type, seen))
    node = memory.get_node(name)
    others = [f"{e.type} {e.dst}" for e in memory.edges(src=name) if e.type not in (*_STRUCTURE, "Virtual_RT")]
    believed = any(edge.type == "Virtual_RT" for edge in memory.edges(dst=name))
    return {
        "name": name,
        "type": node.type if node else "",
        "edge": edge_type,
        "believed": believed,
        "relations": sorted(others),
        "children": children,
    }


def _draw(parent: Tree, branch: dict[str, Any]) -> None:
    label = f"[bold]{shown(branch['name'])}[/] [dim]{shown(branch['type'])}[/]"
    if branch["edge"]:
        label = f"[cyan]{shown(branch['edge'])}[/] {label}"
    if branch["believed"]:
        label += "  [green]believed[/]"
    if branch["relations"]:
        label += f"  [magenta]{shown(', '.join(branch['relations']))}[/]"
    below = parent.add(label)
    for child in branch["children"]:
        _draw(below, child)
