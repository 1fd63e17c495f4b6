"""`dsr save`, `dsr load`, `dsr convert`: graphs from and to JSON files."""

from __future__ import annotations

import enum
from pathlib import Path
from typing import Annotated

import typer

from dsr.cli.common import GraphOption, RouterOption, SecurityOption, console, errors, reading, writing
from dsr.persistence.content import GraphContent
from dsr.persistence.files import read_graph, write_graph
from dsr.runtime.logs import printable

app = typer.Typer()

_MOST_WARNINGS = 20


class FileFormat(enum.StrEnum):
    """Values of `--format`."""

    DSR = "dsr"
    CORTEX = "cortex"


FormatOption = Annotated[FileFormat, typer.Option("--format", help="What is written; cortex: its DSRModel JSON.")]


@app.command()
def save(
    file: Annotated[Path, typer.Argument(help="JSON file to write; an old one is replaced.")],
    graph: GraphOption = None,
    file_format: FormatOption = FileFormat.DSR,
    router: RouterOption = None,
    security: SecurityOption = None,
) -> None:
    """Write the running graph to a JSON file that people can read and edit. Equal graphs give equal files."""
    with reading(graph, router, security) as memory:
        content = GraphContent.of(memory)
    warn(content)
    write_graph(content, file, file_format.value)
    _report("saved", content, f"to {file}")


@app.command()
def load(
    file: Annotated[Path, typer.Argument(help="JSON file of dsr or of CORTEX.")],
    graph: GraphOption = None,
    replace: Annotated[bool, typer.Option("--replace", help="Remove what the file does not have.")] = False,
    router: RouterOption = None,
    security: SecurityOption = None,
    agent: Annotated[
        str, typer.Option("--as", metavar="AGENT", help="With security: whose certificate.")
    ] = "dsr",
) -> None:
    """Add the nodes, edges and attributes of a JSON file to the running graph, and update those it has.

    The exit code is 0 once all processes of the graph have them. A wrong file changes nothing: each problem is told
    with its line and column.
    """
    content = read_graph(file)
    warn(content)
    with writing(graph, router, security, agent) as memory:
        content.put_into(memory, replace=replace)
    _report("loaded", content, f"into graph {memory.graph_name}")


@app.command()
def convert(
    source: Annotated[Path, typer.Argument(help="JSON file of dsr or of CORTEX.")],
    target: Annotated[Path, typer.Argument(help="JSON file to write; an old one is replaced.")],
    file_format: FormatOption = FileFormat.DSR,
) -> None:
    """Check a graph file and write it in the other format, or again in its own; nothing needs to run."""
    content = read_graph(source)
    warn(content)
    write_graph(content, target, file_format.value)
    _report("wrote", content, f"to {target}")


def warn(content: GraphContent) -> None:
    """Tell what could not be taken over as it was."""
    for warning in content.warnings[:_MOST_WARNINGS]:
        errors.print(printable(warning), style="yellow", markup=False, soft_wrap=True)
    if len(content.warnings) > _MOST_WARNINGS:
        errors.print(f"and {len(content.warnings) - _MOST_WARNINGS} more warnings", style="yellow")


def _report(done: str, content: GraphContent, where: str) -> None:
    console.print(
        f"{done} {len(content.nodes)} nodes, {len(content.edges)} edges {where}", markup=False, soft_wrap=True
    )
