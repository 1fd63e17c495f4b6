"""What a replica shows and holds, for comparison with others and with the plain model."""

from __future__ import annotations

from typing import Any

from benchmarks.years.knowledge import Shown
from dsr.graph.graph import Graph


def shown(graph: Graph) -> Shown:
    """Everything that a replica shows."""
    return {key: (e.type, dict(e)) for elements in (graph.nodes, graph.edges) for key, e in elements.items()}


def state(graph: Graph) -> dict[str, Any]:
    """Everything that two equal replicas have in common."""
    store = graph.store
    return {
        "context": store.context,
        "entries": {dot: (e.key, e.type, e.sources, e.destinations, e.registers) for dot, e in store.entries.items()},
        "fingerprint": store.fingerprint,
        "shown": shown(graph),
    }
