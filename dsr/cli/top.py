"""`dsr top`: the state of all agents of a running system, seen from another terminal."""

from __future__ import annotations

import threading
from collections.abc import Collection

import typer
from rich.console import Group
from rich.live import Live
from rich.text import Text

from dsr.cli.common import (
    LEFT,
    GraphOption,
    JsonOption,
    RouterOption,
    SecurityOption,
    console,
    is_deserted,
    print_json,
    reading,
)
from dsr.cli.status_table import status_json, status_table
from dsr.cli.streams import redraws
from dsr.clock import WALL_CLOCK
from dsr.graph.far_stamps import by_agent
from dsr.memory import Memory
from dsr.network.keys import agent_of
from dsr.network.rendezvous import members
from dsr.runtime.launcher import LAUNCHER, AgentRow
from dsr.runtime.logs import printable
from dsr.runtime.status import PERIOD, StatusBoard
from dsr.timeline import AGENT, query

app = typer.Typer()

_LISTEN = 1.5 * PERIOD
"""s in which every agent is heard at least once"""
_REFRESH = 0.25  # s
_SILENT = "told no status since this command began: it hangs, or its machine cannot be reached"
_NO_STATUS = "takes part in the graph and tells no status: it is no agent, or it hangs"


@app.command()
def top(
    graph: GraphOption = None,
    as_json: JsonOption = False,
    router: RouterOption = None,
    security: SecurityOption = None,
) -> None:
    """Show state, rate, latency, last error and clock of every agent, and who forged stamps, live until Ctrl-C.

    Agents that were silent before the command began are listed, too, and other processes that tell no status.
    With --json, or if the output is no terminal or a dumb one, listens for a moment, prints once and ends.
    """
    with reading(graph, router, security) as memory:
        board = StatusBoard(memory.transport, memory.keys, WALL_CLOCK)
        title = f"graph {memory.graph_name}"
        WALL_CLOCK.wait(threading.Event(), _LISTEN)
        if as_json:
            print_json(status_json(_rows(board, memory)))
        elif not redraws(console):
            console.print(_shown(board, title, memory))
        else:
            _follow(board, title, memory)


def _follow(board: StatusBoard, title: str, memory: Memory) -> None:
    with Live(console=console, auto_refresh=False) as live:
        try:
            while True:
                live.update(_shown(board, title, memory), refresh=True)
                WALL_CLOCK.wait(threading.Event(), _REFRESH)
        except KeyboardInterrupt:
            return


def _shown(board: StatusBoard, title: str, memory: Memory) -> Group:
    """The table, and below it if all have left, and who stamped how many values of the base world days ahead."""
    table = status_table(_rows(board, memory), title)
    notes = [Text(LEFT, style="yellow")] if is_deserted(memory) else []
    far = memory.far_stamps() if memory.far_stamped else []
    if not far:
        return Group(table, *notes)
    writers = ", ".join(f"{agent} ({count})" for agent, count in by_agent(far).items())
    text = f"{len(far)} values are stamped days ahead of this clock, last written by {writers}; see: dsr stamps"
    return Group(table, *notes, Text(printable(text), style="red"))


def _rows(board: StatusBoard, memory: Memory) -> list[AgentRow]:
    rows = _unheard(memory, board.agents())
    for agent in board.agents():
        heard = board.get(agent)
        if heard is not None:
            status = heard.status
            state = "silent" if board.is_silent(agent) else str(status.state)
            rows.append(AgentRow(agent, state, status.pid, heard, status.restarts, status.last_error))
    return sorted(rows, key=lambda row: row.agent)


def _unheard(memory: Memory, heard: Collection[str]) -> list[AgentRow]:
    """Who is in the graph beside those that were heard, and us: an agent, as the timeline tells, or any other process.

    A process that hangs is no peer of a newcomer; on this machine its entry in the meeting place is still locked.
    """
    present = {*memory.peers, *(member.rid for member in members(memory.graph_name))} - {memory.rid}
    runs = [entry for entry in query(memory, kind=AGENT) if len(entry.participants) > 1]
    agents = {entry.participants[0] for entry in runs if entry.is_open or entry.participants[1] in present}
    others = {agent_of(rid) for rid in present} - agents - {LAUNCHER, memory.agent}
    rows = [AgentRow(agent, "silent", None, None, 0, _SILENT) for agent in agents.difference(heard)]
    return rows + [AgentRow(agent, "no status", None, None, 0, _NO_STATUS) for agent in others.difference(heard)]
