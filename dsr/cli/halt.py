"""`dsr halt`: an emergency stop that needs no planner, and no graph that answers."""

from __future__ import annotations

import contextlib
import getpass
import threading
import uuid
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import msgspec
import typer

from dsr.cli.common import (
    AsOption,
    GraphOption,
    JsonOption,
    RouterOption,
    SecurityOption,
    for_people,
    joinable,
    print_json,
    shown,
)
from dsr.clock import WALL_CLOCK
from dsr.connecting import connect, identity_of, open_transport
from dsr.errors import DsrError, TransportError, WireError
from dsr.memory import new_rid
from dsr.network.keys import Keys
from dsr.network.transport import Transport
from dsr.vocabulary.halting import (
    HALTER,
    HaltOrder,
    HaltReport,
    decode_report,
    halt_report_key,
    send_order,
    write_order,
)

app = typer.Typer()

_REPEAT = 0.05
"""s between two messages of one order: who was not connected yet hears the next one"""
_NOBODY = 3.0
"""s without any answer after which nobody will answer: processes of one machine are connected within one"""
_LINGER = 0.5
"""s after the first answer in which others answer, too"""
_STILL = 3.0
"""s in which an arm that has heard comes to rest: arms brake within one"""
_GRAPH = 2.0
"""s without a word from the graph after which the order is not written there"""


@app.command()
def halt(
    why: Annotated[str, typer.Argument(help="The reason, for everybody who asks why nothing moves.")] = "",
    graph: GraphOption = None,
    arm: Annotated[str, typer.Option("--arm", metavar="NAME", help="Only this arm, such as arm or left.")] = "",
    release: Annotated[bool, typer.Option("--release", help="Allow motion again; nothing moves by that.")] = False,
    as_json: JsonOption = False,
    router: RouterOption = None,
    security: SecurityOption = None,
    agent: AsOption = HALTER,
) -> None:
    """Stop every arm at once, or one, and keep it from moving until: dsr halt --release

    Arms come to rest within the limits of their joints, and keep what they hold. The order reaches arm controllers
    and drivers directly: it works without a planner, in the middle of a motion, and when the graph does not answer.
    The command ends with exit code 1 if no arm has answered that it stands still. It replaces no emergency stop of
    the arm itself.

    Example: dsr halt "a hand is in the way"
    """
    name = joinable(graph, router)
    order = HaltOrder(uuid.uuid4().hex, not release, _who(), why[:500], WALL_CLOCK.now(), arm)
    routers = [router] if router else []
    answers = _spread(name, order, routers, security, agent)
    untold = _write(name, order, routers, security, agent)
    if as_json:
        reports = [msgspec.to_builtins(report) for report in answers.sorted()]
        about = {"halted": order.halted, "arm": order.arm}
        print_json({**about, "answers": reports, "written": not untold, "problem": untold})
    _tell(order, answers, untold, as_json)
    if not answers.obeyed(order):
        raise typer.Exit(1)


@dataclass
class _Answers:
    """The newest report of each agent on one order."""

    order: HaltOrder
    reports: dict[str, HaltReport] = field(default_factory=dict)

    def receive(self, key: str, payload: bytes) -> None:
        """Take a message in; what is no report on our order is none of ours."""
        with contextlib.suppress(WireError):
            report = decode_report(payload)
            if report.id == self.order.id and key.endswith(f"/{report.agent}"):
                self.reports[report.agent] = report

    def sorted(self) -> list[HaltReport]:
        """By agent."""
        return sorted(self.reports.values(), key=lambda report: report.agent)

    def obeyed(self, order: HaltOrder) -> bool:
        """Whether somebody answered, and all of them do as they are told."""
        reports = self.sorted()
        return bool(reports) and all(
            report.halted == order.halted and not (order.halted and report.moving) for report in reports
        )


def _who() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # a user without a name
        return "somebody"


def _spread(name: str, order: HaltOrder, routers: list[str], security: Path | None, agent: str) -> _Answers:
    """Tell the order again and again, until all who answer do as they are told, or time is up."""
    answers = _Answers(order)
    transport, registration = open_transport(
        name, new_rid(agent), routers, has_memory=False, identity=identity_of(agent, security)
    )
    with contextlib.closing(registration), contextlib.closing(transport):
        transport.subscribe(halt_report_key(Keys(name)), answers.receive)
        _repeat(transport, Keys(name), order, answers)
    return answers


def _repeat(transport: Transport, keys: Keys, order: HaltOrder, answers: _Answers) -> None:
    began, never = WALL_CLOCK.monotonic(), threading.Event()
    first: float | None = None
    while True:
        send_order(transport, keys, order)
        WALL_CLOCK.wait(never, _REPEAT)
        now = WALL_CLOCK.monotonic()
        if first is None and answers.reports:
            first = now
        if first is None and now - began > _NOBODY:
            return
        if first is not None and now - first > _LINGER and (answers.obeyed(order) or now - first > _STILL):
            return


def _write(name: str, order: HaltOrder, routers: list[str], security: Path | None, agent: str) -> str:
    """Write the order to the graph, for those who come later; returns why that was not possible, or nothing."""
    try:
        with connect(
            name, agent=agent, connect=routers, timeout=_GRAPH, security=security, must_exist=False
        ) as memory:
            if not memory.peers:
                return "nobody holds the graph"
            write_order(memory, order)
            sync = memory.replica.synchroniser
            if not memory.replica.wait_until(lambda: sync.delivered, _GRAPH):
                raise TransportError(f"not all of {', '.join(memory.peers)} have it")
    except DsrError as error:
        return str(error)
    return ""


def _tell(order: HaltOrder, answers: _Answers, untold: str, as_json: bool) -> None:
    """Say who obeys, and what did not work."""
    people = for_people(as_json)
    for report in answers.sorted():
        if report.halted != order.halted:
            said = "does not obey: another order came"
        elif not order.halted:
            said = "may move again"
        else:
            said = "[red]still moves[/]" if report.moving else "stands still, and stays so"
        people.print(f"{shown(report.agent)}: {said}", soft_wrap=True)
    if not answers.reports:
        whom = f"the arm {shown(order.arm)}" if order.arm else "an arm"
        told = f"nobody who drives {whom} has answered" + (": use the arm's own emergency stop" if order.halted else "")
        people.print(f"[bold red]{told}[/]", soft_wrap=True)
    if untold:
        late = f"the order is not in the graph ({shown(untold)}): whoever starts now does not know of it"
        people.print(f"[yellow]{late}[/]", soft_wrap=True)
    if order.halted and answers.reports:
        again = f"dsr halt --release{f' --arm {shown(order.arm)}' if order.arm else ''}"
        people.print(f"to allow motion again: {again}", soft_wrap=True)
