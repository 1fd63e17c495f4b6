"""What the shell completes: names of graphs, nodes, agents, systems, folders of runs; never an error, and soon."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from dsr.errors import ConfigError, DsrError
from dsr.network.keys import BASE
from dsr.network.rendezvous import endpoints, graphs, read_claim, running_graph

if TYPE_CHECKING:
    from dsr.memory import Memory

_PATIENCE = 1.0
"""s that a graph may keep silent, before nothing is completed: somebody waits with a finger on the key"""


def complete_graph(incomplete: str) -> list[str]:
    """Names of the graphs in which somebody on this machine takes part."""
    with contextlib.suppress(DsrError, OSError):
        return _beginning_with(incomplete, graphs())
    return []


def complete_node(context: typer.Context, incomplete: str) -> list[str]:
    """Names of the nodes in the graph, and in the world, that the words before name."""
    with contextlib.suppress(DsrError, OSError), _joined(context) as memory:
        world = memory.world(context.params.get("world") or BASE)
        return _beginning_with(incomplete, sorted(node.name for node in world.nodes()))
    return []


def complete_world(context: typer.Context, incomplete: str) -> list[str]:
    """Names of the worlds of the graph that the words before name."""
    with contextlib.suppress(DsrError, OSError), _joined(context) as memory:
        return _beginning_with(incomplete, [info.name for info in memory.worlds()])
    return []


@contextlib.contextmanager
def _joined(context: typer.Context) -> Iterator[Memory]:
    """A replica of the graph that the words before name, that writes nothing.

    Raises:
        ConfigError: if no such graph runs on this machine; the network is not loaded then.
        TransportError: if who holds the graph does not answer soon.
    """
    graph = running_graph(context.params.get("graph"))
    if not endpoints(graph):
        raise ConfigError(f"no graph {graph!r} runs on this machine")
    from dsr.connecting import connect
    from dsr.graph.access import Access, WriteGuard

    guard, security = WriteGuard("dsr", Access()), context.params.get("security")
    logging.disable()  # a line between the words that somebody types would be in the way
    try:
        with connect(graph, agent="dsr", guard=guard, timeout=_PATIENCE, security=security, must_exist=False) as memory:
            yield memory
    finally:
        logging.disable(logging.NOTSET)


def complete_log(context: typer.Context, incomplete: str) -> list[str]:
    """Names of the agents of which the running system has logs."""
    with contextlib.suppress(DsrError, OSError):
        claim = read_claim(running_graph(context.params.get("graph")))
        logs = [] if claim is None else claim.folder.glob("*.log")
        return _beginning_with(incomplete, sorted(log.stem for log in logs))
    return []


def complete_system(incomplete: str) -> list[str]:
    """Names of the systems in `etc/systems`; nothing for a path, which the shell completes itself."""
    from dsr.runtime.system import known_systems  # every command has this module, and few need that one

    return _beginning_with(incomplete, known_systems())


def complete_recording(incomplete: str) -> list[str]:
    """The folders in `runs/` with recordings, newest first; nothing for another path."""
    with contextlib.suppress(OSError):
        files = sorted(Path("runs").glob("*/*.mcap"), key=lambda file: -file.stat().st_mtime)
        return _beginning_with(incomplete, dict.fromkeys(str(file.parent) for file in files))
    return []


def _beginning_with(incomplete: str, names: Iterable[str]) -> list[str]:
    return [name for name in names if name.startswith(incomplete)]
