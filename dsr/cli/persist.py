"""`dsr save`, `dsr convert`: graphs to JSON files, and from one format to the other; `load.py` brings them back."""

from __future__ import annotations

import enum
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from dsr.cli.common import GraphOption, RouterOption, SecurityOption, WorldOption, console, counted, errors, reading
from dsr.network.keys import BASE
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
    world: WorldOption = BASE,
    file_format: FormatOption = FileFormat.DSR,
    router: RouterOption = None,
    security: SecurityOption = None,
) -> None:
    """Write a world of the running graph to a JSON file that people can read and edit. Equal ones give equal files."""
    with reading(graph, router, security, world) as memory:
        content = GraphContent.of(memory)
    warn(content.warnings)
    write_graph(content, file, file_format.value)
    report("saved", content, f"to {file}")


@app.command()
def convert(
    source: Annotated[Path, typer.Argument(help="JSON file of dsr or of CORTEX.")],
    target: Annotated[Path, typer.Argument(help="JSON file to write; an old one is replaced.")],
    file_format: FormatOption = FileFormat.DSR,
) -> None:
    """Check a graph file and write it in the other format, or again in its own; nothing needs to run."""
    content = read_graph(source)
    warn(content.warnings)
    write_graph(content, target, file_format.value)
    report("wrote", content, f"to {target}")


def warn(warnings: Sequence[str]) -> None:
    """Report what could not be taken over as it was."""
    for warning in warnings[:_MOST_WARNINGS]:
        errors.print(printable(warning), style="yellow", markup=False, soft_wrap=True)
    if len(warnings) > _MOST_WARNINGS:
        errors.print(f"and {len(warnings) - _MOST_WARNINGS} more warnings", style="yellow")


def report(done: str, content: GraphContent, where: str) -> None:
    """Report the result of saving or loading a graph."""
    size = f"{counted(len(content.nodes), 'node')}, {counted(len(content.edges), 'edge')}"
    console.print(f"{done} {size} {where}", markup=False, soft_wrap=True)
