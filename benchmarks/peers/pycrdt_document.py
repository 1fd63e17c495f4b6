"""pycrdt (Yjs in Rust): a shared map of nodes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pycrdt import Doc, Map

from benchmarks import workload
from benchmarks.peers.documents import Replicated

_Nodes = Any  # pycrdt's Map of Maps; its own types say no more


class PycrdtDocument(Replicated):
    """A `Map` of `Map`s."""

    name = "pycrdt"

    def __init__(self) -> None:
        self._doc, self._nodes = _filled(workload.NODES)
        self._other: Doc[Any] = Doc()
        self._other.apply_update(self._doc.get_update())
        self._written = 0

    def insert(self) -> None:
        """One transaction a node."""
        _filled(workload.NODES)

    def insert_bare(self) -> None:
        """One transaction a node."""
        _doc, nodes = _empty()
        for index in range(workload.NODES):
            nodes[workload.name(index)] = Map({})

    def update(self) -> None:
        """One transaction an attribute."""
        self._written += 1
        for index in range(workload.NODES):
            self._nodes[workload.name(index)]["order"] = self._written

    def replicate(self) -> None:
        """`get_update` since the other's state, `apply_update`."""
        self._written += 1
        state = self._other.get_state()
        for index in range(workload.NODES):
            self._nodes[workload.name(index)]["order"] = self._written
            self._other.apply_update(self._doc.get_update(state))
            state = self._doc.get_state()

    def get_node(self) -> None:
        """The map of each node."""
        for index in range(workload.NODES):
            self._nodes[workload.name(index)]

    def snapshot(self, nodes: int) -> Callable[[], None]:
        """`apply_update` of the whole history."""
        update = _filled(nodes)[0].get_update()
        return lambda: Doc().apply_update(update)


def _empty() -> tuple[Doc[Any], _Nodes]:
    doc: Doc[Any] = Doc()
    nodes: _Nodes = Map({})
    doc["nodes"] = nodes
    return doc, nodes


def _filled(count: int) -> tuple[Doc[Any], _Nodes]:
    doc, nodes = _empty()
    for index in range(count):
        attributes = workload.attributes(index)
        nodes[workload.name(index)] = Map({**attributes, "size": list(attributes["size"])})
    return doc, nodes
