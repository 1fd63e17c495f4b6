"""Finds the geometric edges without a pose that keep two frames apart, to tell in an error."""

from __future__ import annotations

from collections.abc import Iterable

from dsr.errors import NoPathError
from dsr.graph.elements import Edge
from dsr.graph.graph import Graph

_MOST_TOLD = 3
"""Edges that an error names."""


def with_unposed(error: NoPathError, graph: Graph, frames: Iterable[str], types: Iterable[str]) -> NoPathError:
    """`error`, which says why `frames` are not connected, with the edges above them that have no pose yet."""
    found = [f"{edge.type} edge {edge.src!r} -> {edge.dst!r}" for edge in _unposed_above(graph, frames, set(types))]
    if not found:
        return error
    more = f" and {len(found) - _MOST_TOLD} more" if len(found) > _MOST_TOLD else ""
    verb = "has" if len(found) == 1 else "have"
    return NoPathError(f"{error}; {', '.join(found[:_MOST_TOLD])}{more} {verb} no pose yet (update_edge writes one)")


def _unposed_above(graph: Graph, frames: Iterable[str], types: set[str]) -> list[Edge]:
    """All edges of these types without a pose from which a chain of such edges leads down to one of the frames."""
    waiting, found = list(frames), []
    seen = set(waiting)
    while waiting:
        for edge in list(graph.edges_in.get(waiting.pop(), {}).values()):
            if edge.type not in types:
                continue
            if "pose" not in edge:
                found.append(edge)
            if edge.src not in seen:
                seen.add(edge.src)
                waiting.append(edge.src)
    return found
