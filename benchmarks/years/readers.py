"""A reader that follows a graph by its changes alone, as a user of `Memory.watch` does."""

from __future__ import annotations

from benchmarks.years.knowledge import Shown
from dsr.crdt.delta import Key
from dsr.graph.graph import Graph
from dsr.graph.watch import Change, Watch


class Reader:
    """What somebody knows who reads a watch now and then."""

    def __init__(self, watch: Watch) -> None:
        self.watch = watch
        self.seen: Shown = {}

    def read(self, graph: Graph) -> Shown:
        """What is known after all changes until now."""
        for change in self.watch.poll():
            self._apply(change, graph)
        return self.seen

    def _apply(self, change: Change, graph: Graph) -> None:
        key: Key = change.name if change.element == "node" else (change.src, change.dst, change.type)
        if change.kind == "removed":
            del self.seen[key]
            return
        if change.kind == "added":
            assert key not in self.seen, f"{key} was told twice"
            self.seen[key] = (change.type, {})
        element = graph.nodes.get(key) if isinstance(key, str) else graph.edges.get(key)
        for name in change.attributes:
            self.seen[key][1].pop(name, None)
            if element is not None and name in element:
                self.seen[key][1][name] = element[name]
