"""The command `dsr where`: where a thing could be, now or at a time in a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table

from agents.replay.tell_cli import FILE_ARGUMENT, TIME_OPTION
from agents.replay.told import moment_of
from dsr.cli.common import (
    GraphOption,
    JsonOption,
    RouterOption,
    SecurityOption,
    WorldOption,
    add_names,
    add_numbers,
    console,
    print_json,
    shown,
)
from dsr.cli.completion import complete_node
from dsr.errors import ConfigError
from dsr.frames.tree import BELIEVED, WORLD
from dsr.graph.elements import Node
from dsr.math3d.transforms import Pose
from dsr.narration import Moment
from dsr.narration.chances import chances, unweighed
from dsr.narration.naming import UnknownNameError, node_of
from dsr.narration.statements import place_of, place_words
from dsr.network.keys import BASE
from dsr.vocabulary.sentences import percent

app = typer.Typer(
    name="where", invoke_without_command=True, subcommand_metavar="",
    context_settings={"allow_interspersed_args": True},
)  # fmt: skip


@app.callback()
def where(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Of a thing.", autocompletion=complete_node)],
    file: Annotated[Path | None, FILE_ARGUMENT] = None,
    at: Annotated[float | None, TIME_OPTION] = None,
    graph: GraphOption = None,
    world: WorldOption = BASE,
    as_json: JsonOption = False,
    router: RouterOption = None,
    security: SecurityOption = None,
) -> None:
    """Tell where a thing could be: every place that the belief holds for possible, with its probability.

    The deviation is the standard deviation of the place. With --json each alternative comes with its pose, who holds
    it, what it is in and on, and why. The probability is null if the belief weighs no other place. The exit code is 1
    then, and if nobody knows where the thing is.
    """
    with moment_of(file, at, graph, world, router, security) as moment:
        node = _thing(moment, name)
        found = moment.memory.belief(node.name)
        rows = [] if found is None else chances(found)
        pose = None if rows else moment.memory.get_transform(WORLD, node.name, types=BELIEVED)
    if as_json:
        print_json(rows if pose is None else [unweighed(pose)])
    elif rows:
        table = Table(box=SIMPLE_HEAD, pad_edge=False)
        add_numbers(table, "probability")
        add_names(table, "where")
        add_numbers(table, "deviation, mm")
        add_names(table, "because")
        for row in rows:
            deviation = "-" if row["deviation"] is None else f"{1e3 * row['deviation']:.0f}"
            table.add_row(percent(row["probability"]), shown(row["where"]), deviation, shown(row["reason"]))
        console.print(table)
    else:
        console.print(shown(_certain(node, pose)))
    if not rows:
        raise typer.Exit(1)


def _certain(node: Node, pose: Pose | None) -> str:
    """Where something is of which the belief weighs no places, in a sentence."""
    if pose is None:
        return f"Nobody knows where {node.name} is."
    place = place_words(place_of(pose), height=True)
    return f"{node.name} is {place}. The belief does not weigh where else {node.name} could be."


def _thing(moment: Moment, name: str) -> Node:
    """The node that is meant. Raises `ConfigError` for a name that means none, or several."""
    try:
        return node_of(moment, name.lower())
    except UnknownNameError as error:
        raise ConfigError(str(error)) from error
