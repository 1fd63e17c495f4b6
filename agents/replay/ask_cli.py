"""The command `dsr ask`: questions in plain English to the memory, answered with evidence."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import msgspec
import typer

from agents.replay.tell_cli import FILE_ARGUMENT, TIME_OPTION
from agents.replay.told import moment_of
from dsr.cli.common import (
    GraphOption,
    JsonOption,
    RouterOption,
    SecurityOption,
    WorldOption,
    ZoneOption,
    console,
    print_json,
    shown,
)
from dsr.imagining import think
from dsr.narration import Moment
from dsr.narration.answer import Response
from dsr.narration.answers import answer, answer_alone, example_questions
from dsr.narration.calendar import zone_of
from dsr.network.keys import BASE
from dsr.vocabulary.what_if import WhatIf

_ALONE = "a file cannot be simulated; ask the running system, or replay it (dsr replay)"

app = typer.Typer(
    name="ask", invoke_without_command=True, subcommand_metavar="",
    context_settings={"allow_interspersed_args": True},
)  # fmt: skip


@app.callback()
def ask(
    question: Annotated[
        str | None, typer.Argument(help='Such as "where is the cup?"; without one, examples of all kinds are shown.')
    ] = None,
    file: Annotated[Path | None, FILE_ARGUMENT] = None,
    at: Annotated[float | None, TIME_OPTION] = None,
    timezone: ZoneOption = None,
    evidence: Annotated[
        bool, typer.Option("--evidence", help="Also show each statement that the answer is made from.")
    ] = False,
    graph: GraphOption = None,
    world: WorldOption = BASE,
    as_json: JsonOption = False,
    router: RouterOption = None,
    security: SecurityOption = None,
) -> None:
    """Ask where, when, why, who, what if, who sees what, and what a person believes; no language model is needed.

    Days past are answered from summaries: "where was the cup last Tuesday, and who moved it?"
    A small grammar reads the question. What is not understood is told, with similar questions, and the exit code is 1.
    """
    with moment_of(file, at, graph, world, router, security, zone_of(timezone)) as moment:
        if question is None:
            _show_examples(moment, as_json=as_json)
            return
        response = _answered(moment, question, alone=file is not None)
    if as_json:
        print_json(msgspec.to_builtins(response))
    else:
        _show(response, evidence=evidence)
    if not response.understood:
        raise typer.Exit(1)


def _answered(moment: Moment, question: str, *, alone: bool) -> Response:
    """Answer by the simulation handler of the running system, or without any."""
    if alone:
        return answer_alone(moment, question, _ALONE)
    memory = moment.memory
    return think(answer(moment, question), WhatIf(memory.transport, memory.keys, memory.clock))


def _show(response: Response, *, evidence: bool) -> None:
    console.print(shown(response.text), highlight=False)
    for example in response.similar:
        console.print(f"  [dim]understood:[/] {shown(example)}", highlight=False)
    for statement in response.evidence if evidence else ():
        sure = "" if statement.confidence == 1.0 else f" {statement.confidence:.2f}"
        console.print(f"  [dim]{statement.basis.value}{sure}:[/] {shown(statement.text)}", highlight=False)
        for name, value in statement.evidence.items():
            console.print(f"    [dim]{shown(name)}: {shown(str(value))}[/]", highlight=False)


def _show_examples(moment: Moment, *, as_json: bool) -> None:
    examples = example_questions(moment)
    if as_json:
        print_json(examples)
        return
    for example in examples:
        console.print(f"  {shown(example)}", highlight=False)
