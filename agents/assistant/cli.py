"""The commands `dsr assist serve` and `dsr assist confirm`: tools for assistants, and who confirms acts."""

from __future__ import annotations

import logging
import threading
from enum import StrEnum
from typing import Annotated

import msgspec
import typer

from agents.assistant.acting import SERVICE, Acts, Confirmation, ProposedAct, decode_acts, encode_confirmation
from dsr.cli.common import (
    AsOption,
    GraphOption,
    JsonOption,
    RouterOption,
    SecurityOption,
    check_company,
    console,
    errors,
    joinable,
    print_json,
    reading,
    shown,
)
from dsr.clock import WALL_CLOCK
from dsr.config.extras import check_installed
from dsr.connecting import connect
from dsr.errors import TransportError
from dsr.graph.access import Access, WriteGuard
from dsr.memory import Memory
from dsr.vocabulary.halting import HALT_ATTRIBUTES, HALT_NODE

ASSISTANT = "assistant"
"""The agent as which a tool server takes part, in a secured graph too."""
_ACTS = Access(
    nodes=("mind", "intention", HALT_NODE), edges=("has",),
    attributes=("goal", "maintain", "priority", "status", *HALT_ATTRIBUTES),
)  # fmt: skip
"""What a server with --allow-actions may write."""
_PATIENCE = 10.0  # s to wait for the outcome of an act that was confirmed

app = typer.Typer(name="assist", help="Let assistants ask the memory, and act as a person confirms.")


class Serving(StrEnum):
    """Values of `--transport`."""

    STDIO = "stdio"
    HTTP = "http"


@app.command()
def serve(
    transport: Annotated[
        Serving, typer.Option(help="stdio: the assistant starts this command; http: it connects to a port.")
    ] = Serving.STDIO,
    port: Annotated[int, typer.Option(min=1, max=65535, help="Of http; on this machine only.")] = 8765,
    allow_actions: Annotated[
        bool,
        typer.Option("--allow-actions", help="Let it propose missions and halts, each for: dsr assist confirm"),
    ] = False,
    graph: GraphOption = None,
    router: RouterOption = None,
    security: SecurityOption = None,
    agent: AsOption = ASSISTANT,
) -> None:
    """Serve the memory of a running system to assistants by the Model Context Protocol, until it is stopped.

    Without --allow-actions nothing is written. Standard output belongs to the protocol; messages go to standard error.
    """
    check_installed(["mcp"], "dsr assist")
    logging.basicConfig(level=logging.WARNING)
    name = joinable(graph, router)
    guard = WriteGuard(agent, _ACTS if allow_actions else Access())
    routers = [router] if router else ()
    with connect(name, agent=agent, connect=routers, guard=guard, security=security, must_exist=False) as memory:
        check_company(memory, router)
        _serve(memory, transport, port, allow_actions=allow_actions)


def _serve(memory: Memory, transport: Serving, port: int, *, allow_actions: bool) -> None:
    from agents.assistant.memory_tools import MemoryTools
    from agents.assistant.proposing import Proposer
    from agents.assistant.server import ToolServer

    acts = Acts(memory.clock) if allow_actions else None
    looking = MemoryTools(memory)
    propose = None if acts is None else Proposer(memory, acts).propose
    server = ToolServer(memory, looking, lambda camera: _picture(memory, camera), acts, propose)
    if acts is not None:
        answer = acts.answer
        memory.transport.serve(memory.keys.service(SERVICE), lambda _key, payload: answer(payload))
    if transport is Serving.STDIO:
        server.mcp.run("stdio")
    else:
        errors.print(f"assistants connect to http://127.0.0.1:{port}/mcp; Ctrl-C ends", markup=False)
        server.mcp.run("streamable-http", host="127.0.0.1", port=port)


def _picture(memory: Memory, camera: str) -> bytes:
    """Needs opencv, which the extra `sim` brings."""
    check_installed(["cv2"], "camera_image")
    from agents.assistant.pictures import picture

    return picture(memory, camera)


@app.command()
def confirm(
    id: Annotated[str | None, typer.Argument(help="Of an act; default: each that waits is asked about.")] = None,
    refuse: Annotated[bool, typer.Option("--refuse", help="Refuse it instead.")] = False,
    graph: GraphOption = None,
    as_json: JsonOption = False,
    router: RouterOption = None,
    security: SecurityOption = None,
) -> None:
    """Show what an assistant proposes, and carry out or refuse each act as a person decides.

    With --json and without an id, only lists what waits.
    """
    with reading(graph, router, security) as memory:
        if id is not None:
            decided = _ask(memory, Confirmation(id, not refuse))
            _report(decided, as_json=as_json)
            return
        waiting = _ask(memory, Confirmation())
        if as_json:
            print_json(msgspec.to_builtins(waiting))
            return
        if not waiting:
            console.print("nothing waits")
        for act in waiting:
            _show(act)
            accept = not refuse and typer.confirm("carry it out?", default=False)
            _report(_ask(memory, Confirmation(act.id, accept)), as_json=False)


def _ask(memory: Memory, decision: Confirmation) -> list[ProposedAct]:
    """Ask the servers of this graph. Raises `TransportError` if none answers."""
    answers: list[bytes] = []
    done = threading.Event()
    memory.transport.request(
        memory.keys.service(SERVICE), encode_confirmation(decision),
        lambda _key, payload: answers.append(payload), done.set, _PATIENCE,
    )  # fmt: skip
    WALL_CLOCK.wait(done, 2.0 * _PATIENCE)
    if not answers:
        what = f"proposed act {decision.id!r}" if decision.id else "tool server with --allow-actions"
        raise TransportError(f"no {what} in graph {memory.graph_name!r}")
    return [act for payload in answers for act in decode_acts(payload)]


def _show(act: ProposedAct) -> None:
    console.print(f"[bold]{shown(act.act)}[/]")
    for sentence in act.preview:
        console.print(f"  {shown(sentence)}", highlight=False)


def _report(acts: list[ProposedAct], *, as_json: bool) -> None:
    if as_json:
        print_json(msgspec.to_builtins(acts))
        return
    for act in acts:
        console.print(f"{shown(act.act)}: {act.state.value}{f', {shown(act.outcome)}' if act.outcome else ''}")
