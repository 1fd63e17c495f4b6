"""Loro (Rust): a shared map of nodes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import loro

from benchmarks import workload
from benchmarks.peers.documents import Replicated


class LoroDocument(Replicated):
    """A `LoroMap` of `LoroMap`s."""

    name = "Loro"

    def __init__(self) -> None:
        self._doc = _filled(workload.NODES)
        self._other = loro.LoroDoc()
        self._other.import_(self._doc.export(loro.ExportMode.Snapshot()))
        self._maps = [_node(self._doc, index) for index in range(workload.NODES)]
        self._written = 0

    def insert(self) -> None:
        """One commit a node."""
        _filled(workload.NODES)

    def insert_bare(self) -> None:
        """One commit a node."""
        doc = loro.LoroDoc()
        nodes = doc.get_map("nodes")
        for index in range(workload.NODES):
            nodes.insert_container(workload.name(index), loro.LoroMap())
            doc.commit()

    def update(self) -> None:
        """One commit an attribute."""
        self._written += 1
        for node in self._maps:
            node.insert("order", self._written)
            self._doc.commit()

    def replicate(self) -> None:
        """`export` since the other's version, `import_`."""
        self._written += 1
        for node in self._maps:
            seen = self._doc.oplog_vv
            node.insert("order", self._written)
            self._doc.commit()
            self._other.import_(self._doc.export(loro.ExportMode.Updates(seen)))

    def get_node(self) -> None:
        """The map of each node."""
        for index in range(workload.NODES):
            _node(self._doc, index)

    def snapshot(self, nodes: int) -> Callable[[], None]:
        """`import_` of a snapshot, and one read, as it is decoded lazily."""
        snapshot = _filled(nodes).export(loro.ExportMode.Snapshot())

        def load() -> None:
            doc = loro.LoroDoc()
            doc.import_(snapshot)
            doc.get_deep_value()

        return load


def _node(doc: loro.LoroDoc, index: int) -> Any:
    """The map of a node."""
    found = doc.get_map("nodes").get(workload.name(index))
    return found.container


def _filled(count: int) -> loro.LoroDoc:
    doc = loro.LoroDoc()
    nodes = doc.get_map("nodes")
    for index in range(count):
        node = nodes.insert_container(workload.name(index), loro.LoroMap())
        for attribute, value in workload.attributes(index).items():
            node.insert(attribute, list(value) if isinstance(value, tuple) else value)
        doc.commit()
    return doc
