"""`dsr stamps`: values that are stamped days ahead of this clock, with their writers; `--clean` makes them anew."""

from __future__ import annotations

from typing import Annotated, Any

import typer
from rich.table import Table

from dsr.cli.common import (
    AsOption,
    GraphOption,
    JsonOption,
    RouterOption,
    SecurityOption,
    WorldOption,
    add_names,
    add_numbers,
    console,
    errors,
    opened,
    print_json,
    reading,
    shown,
    writing,
)
from dsr.crdt.delta import Key
from dsr.graph.far_stamps import FarStamp
from dsr.memory import Memory
from dsr.network.keys import BASE, agent_of

app = typer.Typer()

_DAY = 86_400.0
_LISTEN = 2.0
"""s in which every agent tells its clock at least once: who is behind all others must not judge their stamps."""


@app.command()
def stamps(
    graph: GraphOption = None,
    world: WorldOption = BASE,
    clean: Annotated[
        bool, typer.Option("--clean", help="Make them anew, with the same values and stamps of now.")
    ] = False,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Do not ask before.")] = False,
    as_json: JsonOption = False,
    router: RouterOption = None,
    security: SecurityOption = None,
    agent: AsOption = "dsr",
) -> None:
    """List values that somebody stamped days ahead of this clock: by a wrong clock, or to win over all others.

    They can be overwritten as ever. With --clean, their nodes and edges are made anew, so that nothing is left of the
    stamps; others see them go and come. No process need be started again. The exit code is 1 if some are left.
    """
    if not clean:
        with reading(graph, router, security, world) as memory:
            left = memory.far_stamps()
        _print(left, as_json)
        raise typer.Exit(1 if left else 0)
    with writing(graph, router, security, agent) as memory, opened(memory, world) as target:
        found = target.far_stamps()
        if found and not yes:
            _print(found, as_json=False)
            typer.confirm(f"make {len({stamp.element for stamp in found})} nodes and edges anew?", abort=True, err=True)
        left = _clean(target) if found else []
    _print(left, as_json)
    raise typer.Exit(1 if left else 0)


def _clean(memory: Memory) -> list[FarStamp]:
    """Make them anew; what is left, with the reasons on standard error."""
    others = {agent_of(rid) for rid in memory.peers}
    memory.replica.wait_until(lambda: memory.clocks.agents >= len(others), _LISTEN)
    done = memory.clean_stamps()
    errors.print(f"cleaned {len(done.renewed)} values")
    for key, reason in done.refused.items():
        errors.print(f"[red]{shown(_name(key))}: {shown(reason)}[/]", soft_wrap=True)
    return memory.far_stamps()


def _print(found: list[FarStamp], as_json: bool) -> None:
    if as_json:
        print_json([_plain(stamp) for stamp in found])
        return
    if not found:
        console.print("no value is stamped days ahead of this clock")
        return
    table = Table(box=None, pad_edge=False)
    add_names(table, "element", "type", "attribute", "last written by")
    add_numbers(table, "days ahead")
    for stamp in found:
        texts = (_name(stamp.element), stamp.type, stamp.attribute, agent_of(stamp.writer) or stamp.writer)
        table.add_row(*map(shown, texts), f"{stamp.ahead / _DAY:.0f}")
    console.print(table)


def _name(key: Key) -> str:
    return key if isinstance(key, str) else f"{key[0]} -{key[2]}-> {key[1]}"


def _plain(stamp: FarStamp) -> dict[str, Any]:
    element = stamp.element if isinstance(stamp.element, str) else list(stamp.element)
    return {
        "element": element, "type": stamp.type, "attribute": stamp.attribute, "writer": stamp.writer,
        "ahead_s": stamp.ahead,
    }  # fmt: skip
