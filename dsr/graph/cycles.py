"""Frames hang below one another and never in a circle: edges that would close one are found before they are written."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Set

from dsr.crdt.delta import EdgeKey
from dsr.errors import CycleError
from dsr.frames.tree import WORLD
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


def without_circles(edges: Iterable[EdgeKey], geometric: Set[str]) -> tuple[list[EdgeKey], list[EdgeKey]]:
    """The edges by which frames do not hang in a circle, and the others: of a circle the edge that leads back up.

    That is seen from the root, type by type. Of the edges that stay, those of lower frames come first, so that nothing
    is above an edge that is made. Edges without a pose come last.
    """
    by_type: dict[str, list[EdgeKey]] = {type: [] for type in sorted(geometric)}
    others: list[EdgeKey] = []
    for key in edges:
        by_type.get(key[2], others).append(key)
    left_out: dict[EdgeKey, None] = {}
    ordered = [key for found in by_type.values() for key in _bottom_up(found, left_out)]
    return ordered + others, list(left_out)


def _bottom_up(edges: list[EdgeKey], left_out: dict[EdgeKey, None]) -> Iterator[EdgeKey]:
    below: dict[str, list[EdgeKey]] = {}
    for key in edges:
        below.setdefault(key[0], []).append(key)
    hung, done = {dst for _, dst, _ in edges}, set[str]()
    for top in [WORLD, *[name for name in below if name not in hung], *below]:
        way = {} if top in done or top not in below else {top: iter(below[top])}
        while way:
            frame = next(reversed(way))
            for key in way[frame]:
                if key[1] in way:
                    left_out[key] = None
                elif key[1] in below and key[1] not in done:
                    way[key[1]] = iter(below[key[1]])
                    break
            else:
                del way[frame]
                done.add(frame)
                yield from (key for key in below[frame] if key not in left_out)


def _error(type: str, src: str, dst: str, cycle: list[str]) -> CycleError:
    path = " -> ".join(map(repr, cycle))
    return CycleError(f"the {type} edge {src!r} -> {dst!r} closes a cycle of frames: {path}; remove another one first")
