"""Requests for spatial relations as edges: nodes of type `query`, which agents/spatial_relations answers."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import count

from dsr.memory import Memory
from dsr.spatial.definitions import SPATIAL
from dsr.spatial.scene import check_no_view, checked_relations
from dsr.timeline.entries import joined_names
from dsr.vocabulary.intentions import MIND

QUERY = "query"
"""Node type of a request."""
EDGE_TYPES = {name: "inside" if name == "in" else name for name in SPATIAL}
"""Type of the edges of each relation. Those of `in` have another name: `on` and `in` are written as contact has it."""
WRITTEN = tuple(EDGE_TYPES.values())
"""Types of the edges that can be requested."""
SOURCE = "geometry"
"""Attribute `source` of these edges."""


def request_relations(
    memory: Memory,
    relations: str | Iterable[str],
    things: str | Iterable[str] = (),
    others: str | Iterable[str] = (),
    *,
    viewpoint: str = "",
) -> str:
    """Ask for edges of these relations from `things` to `others`, kept up to date until the request is removed.

    Args:
        memory: where to.
        relations: some of `SPATIAL`; the edges have the types `EDGE_TYPES`.
        things: names of the sources; all things if none. Who is not there yet is waited for.
        others: names of the destinations; all things if none.
        viewpoint: camera or frame from which `in_front_of`, `behind`, `left_of` and `right_of` are seen.

    Returns:
        The name of the request, a node below `mind`; its `status` says how it goes. `memory.remove_node` ends it.

    Raises:
        ConfigError: for relations that are unknown, none, or in need of a viewpoint that is not given.
    """
    names = checked_relations(joined_names(relations).split(","))
    if not viewpoint:
        check_no_view(names, "name a viewpoint")
    name = next(name for number in count() if (name := f"{QUERY}_{memory.rid}_{number}") not in memory)
    with memory.batch():
        if MIND not in memory:
            memory.add_node(MIND, "mind")
        memory.add_node(
            name, QUERY, relations=",".join(names), things=joined_names(things), others=joined_names(others),
            viewpoint=viewpoint,
        )  # fmt: skip
        memory.add_edge(MIND, name, "has")
    return name
