"""Frames hang below one another and never in a circle: edges that would close one are found before they are written."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from graphlib import CycleError as _Unsortable
from graphlib import TopologicalSorter

from dsr.crdt.delta import EdgeKey
from dsr.errors import CycleError
from dsr.graph.graph import Graph
from dsr.network.keys import agent_of


def check_new_edge(graph: Graph, src: str, dst: str, type: str) -> None:
    """Raise `CycleError` if a new edge closed a cycle with edges of its type, whichever of them are the newest.

    Only edges count that the same agent has made. Else others could keep an agent from writing what it measures, by one
    edge each. It costs a look at each edge above `src`, and nothing at all if nothing hangs below `dst`. The graph must
    be locked.
    """
    agent = agent_of(graph.rid)
    if src != dst and not any(key[2] == type for key in graph.edges_out.get(dst, {})):
        return
    below: dict[str, str] = {src: dst}
    """Frames from which the new edge comes down, with the next one on the way."""
    waiting = [src]
    while waiting and dst not in below:
        frame = waiting.pop()
        for (parent, _, kind), edge in graph.edges_in.get(frame, {}).items():
            if kind == type and parent not in below and any(agent_of(rid) == agent for rid, _ in edge.created):
                below[parent] = frame
                waiting.append(parent)
    if src == dst or dst in below:
        cycle = [dst]
        while len(cycle) == 1 or cycle[-1] != dst:
            cycle.append(below[cycle[-1]])
        raise _error(type, src, dst, cycle)


def check_edges(edges: Iterable[EdgeKey], geometric: Iterable[str]) -> None:
    """Raise `CycleError` if edges of a geometric type form a cycle."""
    parents: dict[str, dict[str, list[str]]] = {type: {} for type in geometric}
    for src, dst, type in edges:
        if type in parents:
            parents[type].setdefault(dst, []).append(src)
    for type in sorted(parents):
        _check_type(type, parents[type])


def _check_type(type: str, parents: Mapping[str, list[str]]) -> None:
    try:
        TopologicalSorter(parents).prepare()
    except _Unsortable as error:
        cycle: list[str] = error.args[1]  # each is a parent of the next, the first one is the last
        raise _error(type, cycle[-2], cycle[-1], cycle) from None


def _error(type: str, src: str, dst: str, cycle: list[str]) -> CycleError:
    path = " -> ".join(map(repr, cycle))
    return CycleError(f"the {type} edge {src!r} -> {dst!r} closes a cycle of frames: {path}; remove another one first")
