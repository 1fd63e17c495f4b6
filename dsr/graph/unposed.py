"""Finds the geometric edges without a pose that keep two frames apart, to tell in an error."""

from __future__ import annotations

from collections.abc import Sequence

from dsr.errors import NoPathError
from dsr.frames.frame_chain import MOST_STEPS
from dsr.graph.elements import Edge
from dsr.graph.graph import Graph

_MOST_TOLD = 3
"""Edges that an error names."""


def with_unposed(error: NoPathError, graph: Graph, source: str, target: str, types: Sequence[str]) -> NoPathError:
    """`error`, which says that two frames are not connected, or a clearer one if only poses are lacking."""
    (above_source, found), (above_target, more_found) = (_above(graph, frame, types) for frame in (source, target))
    if above_source.isdisjoint(above_target):
        return error
    unposed = list({edge.key: f"{edge.type} edge {edge.src!r} -> {edge.dst!r}" for edge in found + more_found}.values())
    if not unposed:
        return error
    more = f" and {len(unposed) - _MOST_TOLD} more" if len(unposed) > _MOST_TOLD else ""
    verb = "has" if len(unposed) == 1 else "have"
    told = f"{', '.join(unposed[:_MOST_TOLD])}{more} {verb} no pose yet (update_edge writes one)"
    return NoPathError(f"no path from {source!r} to {target!r} over {' or '.join(types)} edges: {told}")


def _above(graph: Graph, frame: str, types: Sequence[str]) -> tuple[set[str], list[Edge]]:
    """The frames above `frame` by edges of these types, with itself; and those of the edges that have no pose.

    No more are looked at than a way may lead through.
    """
    waiting, seen, unposed = [frame], {frame}, []
    while waiting and len(seen) <= MOST_STEPS:
        for edge in list(graph.edges_in.get(waiting.pop(), {}).values()):
            if edge.type not in types:
                continue
            if "pose" not in edge:
                unposed.append(edge)
            if edge.src not in seen:
                seen.add(edge.src)
                waiting.append(edge.src)
    return seen, unposed
