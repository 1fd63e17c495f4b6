"""`dsr top`: the state of all agents of a running system, seen from another terminal."""

from __future__ import annotations

import threading

import typer
from rich.console import Group
from rich.live import Live
from rich.text import Text

from dsr.cli.common import GraphOption, JsonOption, RouterOption, SecurityOption, console, print_json, reading
from dsr.cli.status_table import status_json, status_table
from dsr.cli.streams import redraws
from dsr.clock import WALL_CLOCK
from dsr.graph.far_stamps import by_agent
from dsr.memory import Memory
from dsr.runtime.launcher import AgentRow
from dsr.runtime.logs import printable
from dsr.runtime.status import PERIOD, StatusBoard

app = typer.Typer()

_LISTEN = 1.5 * PERIOD
"""s in which every agent is heard at least once"""
_REFRESH = 0.25  # s


@app.command()
def top(
    graph: GraphOption = None,
    as_json: JsonOption = False,
    router: RouterOption = None,
    security: SecurityOption = None,
) -> None:
    """Show state, rate, latency, last error and clock of every agent, and who forged stamps, live until Ctrl-C.

    With --json, or if the output is no terminal or a dumb one, listens for a moment, prints once and ends.
    """
    with reading(graph, router, security) as memory:
        board = StatusBoard(memory.transport, memory.keys, WALL_CLOCK)
        title = f"graph {memory.graph_name}"
        WALL_CLOCK.wait(threading.Event(), _LISTEN)
        if as_json:
            print_json(status_json(_rows(board)))
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
    """The table, and below it how many values are stamped days ahead in the base world, and by whom."""
    table = status_table(_rows(board), title)
    far = memory.far_stamps() if memory.far_stamped else []
    if not far:
        return table
    writers = ", ".join(f"{agent} ({count})" for agent, count in by_agent(far).items())
    text = f"{len(far)} values are stamped days ahead of this clock, last written by {writers}; see: dsr stamps"
    return Group(table, Text(printable(text), style="red"))


def _rows(board: StatusBoard) -> list[AgentRow]:
    rows = []
    for agent in board.agents():
        heard = board.get(agent)
        if heard is not None:
            status = heard.status
            state = "silent" if board.is_silent(agent) else str(status.state)
            rows.append(AgentRow(agent, state, status.pid, heard, status.restarts, status.last_error))
    return rows
