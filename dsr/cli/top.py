"""`dsr top`: the state of all agents of a running system, seen from another terminal."""

from __future__ import annotations

import threading

import typer
from rich.live import Live

from dsr.cli.common import GraphOption, JsonOption, RouterOption, SecurityOption, console, print_json, reading
from dsr.cli.status_table import status_json, status_table
from dsr.clock import WALL_CLOCK
from dsr.runtime.launcher import AgentRow
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
    """Show state, rate, latency and last error of every agent, live until Ctrl-C.

    With --json, or if the output is no terminal, listens for a moment, prints once and ends.
    """
    with reading(graph, router, security) as memory:
        board = StatusBoard(memory.transport, memory.keys, WALL_CLOCK)
        title = f"graph {memory.graph_name}"
        WALL_CLOCK.wait(threading.Event(), _LISTEN)
        if as_json:
            print_json(status_json(_rows(board)))
        elif not console.is_terminal:
            console.print(status_table(_rows(board), title))
        else:
            _follow(board, title)


def _follow(board: StatusBoard, title: str) -> None:
    with Live(console=console, auto_refresh=False) as live:
        try:
            while True:
                live.update(status_table(_rows(board), title), refresh=True)
                WALL_CLOCK.wait(threading.Event(), _REFRESH)
        except KeyboardInterrupt:
            return


def _rows(board: StatusBoard) -> list[AgentRow]:
    rows = []
    for agent in board.agents():
        heard = board.get(agent)
        if heard is not None:
            status = heard.status
            state = "silent" if board.is_silent(agent) else str(status.state)
            rows.append(AgentRow(agent, state, status.pid, heard, status.restarts, status.last_error))
    return rows
