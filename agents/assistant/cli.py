"""The commands `dsr assist serve` and `dsr assist confirm`: tools for assistants, and who confirms acts."""

from __future__ import annotations

import logging
import sys
import threading
from datetime import tzinfo
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import typer

from agents.assistant.acting import Acts
from agents.assistant.stdio import input_that_ends
from agents.assistant.token import default_token_file, read_or_make_token
from dsr.cli.common import (
    AsOption,
    GraphOption,
    JsonOption,
    RouterOption,
    SecurityOption,
    ZoneOption,
    check_company,
    console,
    errors,
    joinable,
    print_json,
    shown,
)
from dsr.clock import WALL_CLOCK
from dsr.config.extras import check_installed
from dsr.connecting import connect
from dsr.errors import ConfigError, TransportError, WireError
from dsr.graph.access import Access, WriteGuard
from dsr.memory import Memory
from dsr.narration.calendar import zone_of
from dsr.vocabulary.halting import HALT_ATTRIBUTES, HALT_NODE
from dsr.vocabulary.proposed_acts import (
    ACTS_SERVICE,
    CONFIRMER,
    DECISIONS,
    ActQuestion,
    ActState,
    Confirmation,
    ProposedAct,
    decode_acts,
    encode_confirmation,
    encode_question,
    fingerprint,
)

if TYPE_CHECKING:
    from agents.assistant.server import ToolServer

_log = logging.getLogger("agents.assistant")

ASSISTANT = "assistant"
"""The agent as which a tool server takes part, in a secured graph too."""
_ACTS = Access(
    nodes=("mind", "intention", HALT_NODE), edges=("has",),
    attributes=("goal", "maintain", "priority", "status", *HALT_ATTRIBUTES),
)  # fmt: skip
"""What a server with --allow-actions may write."""
_PATIENCE = 10.0  # s to wait for the outcome of an act that was confirmed
_PERIOD = 0.1  # s between two looks at what became of it

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
    token_file: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Of http: holds the token that assistants show; made if it is missing."),
    ] = None,
    no_token: Annotated[
        bool, typer.Option("--no-token", help="Of http: answer whoever can open a connection on this machine.")
    ] = False,
    timezone: ZoneOption = None,
    graph: GraphOption = None,
    router: RouterOption = None,
    security: SecurityOption = None,
    agent: AsOption = ASSISTANT,
) -> None:
    """Serve the memory of a running system to assistants by the Model Context Protocol, until it is stopped.

    Without --allow-actions nothing is written. Standard output belongs to the protocol; messages go to standard error.
    Over http assistants show a token (Authorization: Bearer). It is in a file that only this user can read.
    """
    if transport is Serving.STDIO and (token_file is not None or no_token):
        raise ConfigError("--token-file and --no-token are for --transport http; over stdio nobody else can ask")
    if token_file is not None and no_token:
        raise ConfigError("--token-file and --no-token exclude each other")
    zone = zone_of(timezone)
    check_installed(["mcp"], "dsr assist")
    logging.basicConfig(level=logging.WARNING)
    name = joinable(graph, router)
    guard = WriteGuard(agent, _ACTS if allow_actions else Access())
    routers = [router] if router else ()
    with connect(name, agent=agent, connect=routers, guard=guard, security=security, must_exist=False) as memory:
        check_company(memory, router)
        if transport is Serving.STDIO:
            server = _server_of(memory, zone, allow_actions=allow_actions)
            with input_that_ends():
                server.mcp.run("stdio")
            return
        _serve_http(memory, zone, port, token_file, no_token=no_token, allow_actions=allow_actions)


def _serve_http(
    memory: Memory, zone: tzinfo | None, port: int, token_file: Path | None, *, no_token: bool, allow_actions: bool
) -> None:
    from agents.assistant import http

    listener = http.listening(port)
    file = default_token_file(memory.graph_name) if token_file is None else token_file
    token = None if no_token else read_or_make_token(file)
    shows = "anybody on this machine may ask" if token is None else f"the token that they show is in {file}"
    where = f"http://{http.HOST}:{port}/mcp"
    errors.print(f"assistants connect to {where}; {shows}; Ctrl-C ends", markup=False, soft_wrap=True)
    server = _server_of(memory, zone, allow_actions=allow_actions)
    http.serve(server.mcp.streamable_http_app(host=http.HOST), listener, token)


def _server_of(memory: Memory, zone: tzinfo | None, *, allow_actions: bool) -> ToolServer:
    from agents.assistant.memory_tools import MemoryTools
    from agents.assistant.proposing import Proposer
    from agents.assistant.server import ToolServer

    acts = Acts(memory.clock) if allow_actions else None
    looking = MemoryTools(memory, zone=zone)
    propose = None if acts is None else Proposer(memory, acts).propose
    server = ToolServer(memory, looking, lambda camera: _picture(memory, camera), acts, propose)
    if acts is not None:
        acts.listen(memory)
    return server


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
    agent: AsOption = CONFIRMER,
) -> None:
    """Show what an assistant proposes, and carry out or refuse each act as a person decides.

    Only at a terminal an act can be accepted: a program that runs this command is no person.
    With --json, lists what waits, or the state of one act, and decides nothing unless with --refuse.
    """
    name = joinable(graph, router)
    routers, guard = [router] if router else [], WriteGuard(agent, Access())
    with connect(name, agent=agent, connect=routers, guard=guard, security=security, must_exist=False) as memory:
        check_company(memory, router)
        acts = _ask(memory, id or "")
        if as_json:
            open_acts = [act for act in acts if act.state is ActState.WAITING] if refuse else []
            refused = {act.id: _decide(memory, act, accept=False) for act in open_acts}
            print_json(msgspec.to_builtins([refused.get(act.id, act) for act in acts]))
            return
        if not acts:
            console.print("nothing waits")
        for act in acts:
            _show(act)
            waits = act.state is ActState.WAITING
            _report(_decide(memory, act, accept=not refuse and _is_wanted()) if waits else act)


def _report(act: ProposedAct) -> None:
    console.print(f"{shown(act.act)}: {act.state.value}{f', {shown(act.outcome)}' if act.outcome else ''}")


def _is_wanted() -> bool:
    """What a person says in the terminal. Raises `ConfigError` if there is none."""
    if not sys.stdin.isatty():
        raise ConfigError("a person accepts an act in a terminal, and this is none; --refuse needs no terminal")
    return typer.confirm("carry it out?", default=False)


def _ask(memory: Memory, id: str) -> list[ProposedAct]:
    """Ask the servers of this graph for one act, or what waits. Raises `TransportError` if none answers.

    An answer that makes no sense, or is about another act, counts as none.
    """
    answers: list[bytes] = []
    done = threading.Event()
    memory.transport.request(
        memory.keys.service(ACTS_SERVICE), encode_question(ActQuestion(id)),
        lambda _key, payload: answers.append(payload), done.set, _PATIENCE,
    )  # fmt: skip
    WALL_CLOCK.wait(done, 2.0 * _PATIENCE)
    told = [acts for payload in list(answers) if (acts := _acts_of(payload, id)) is not None]
    if not told:
        what = f"proposed act {id!r}" if id else "tool server with --allow-actions"
        raise TransportError(f"no {what} in graph {memory.graph_name!r}")
    return [act for acts in told for act in acts]


def _acts_of(payload: bytes, id: str) -> list[ProposedAct] | None:
    """The acts of an answer to the question for one act, or for all with an empty id; None if it is no such answer."""
    try:
        acts = decode_acts(payload)
    except WireError as error:
        _log.warning("an answer about proposed acts is dropped: %s", error)
        return None
    return acts if not id or all(act.id == id for act in acts) else None


def _decide(memory: Memory, act: ProposedAct, *, accept: bool) -> ProposedAct:
    """Send a decision until the server has it, and wait for what comes of it. Raises `TransportError`."""
    message = encode_confirmation(Confirmation(act.id, accept, fingerprint(act)))
    end, never = WALL_CLOCK.monotonic() + _PATIENCE, threading.Event()
    while WALL_CLOCK.monotonic() < end:
        memory.transport.publish(memory.keys.service(DECISIONS), message)  # an act is decided on once, whatever comes
        WALL_CLOCK.wait(never, _PERIOD)
        for answered in _ask(memory, act.id):
            if answered.state is not ActState.WAITING:
                return answered
    raise TransportError(
        f"the server did not heed the decision on {act.id}: in a secured graph that takes a certificate such as "
        f"{CONFIRMER!r}, which may publish {memory.keys.service(DECISIONS)}"
    )


def _show(act: ProposedAct) -> None:
    console.print(f"[bold]{shown(act.act)}[/]")
    for sentence in act.preview:
        console.print(f"  {shown(sentence)}", highlight=False)
