"""Spark-DSG (C++): a layer of objects. It is shared as a whole; there is no merge."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import spark_dsg

from benchmarks import workload
from benchmarks.peers.documents import Document

_LAYER = spark_dsg.DsgLayers.OBJECTS


class SparkDocument(Document):
    """A `DynamicSceneGraph` with one layer of objects."""

    name = "Spark-DSG"

    def __init__(self) -> None:
        self._graph = _filled(workload.NODES)

    def insert(self) -> None:
        """`add_node` with five fields set."""
        _filled(workload.NODES)

    def insert_bare(self) -> None:
        """`add_node` with default fields."""
        graph = spark_dsg.DynamicSceneGraph()
        attributes = spark_dsg.ObjectNodeAttributes()
        for index in range(workload.NODES):
            graph.add_node(_LAYER, spark_dsg.NodeSymbol("n", index), attributes)

    def update(self) -> None:
        """Get the node and set a field."""
        for index in range(workload.NODES):
            self._graph.get_node(spark_dsg.NodeSymbol("n", index)).attributes.semantic_label = index

    def get_node(self) -> None:
        """`get_node`."""
        for index in range(workload.NODES):
            self._graph.get_node(spark_dsg.NodeSymbol("n", index))

    def snapshot(self, nodes: int) -> Callable[[], None]:
        """`from_binary`."""
        content = _filled(nodes).to_binary()
        return lambda: spark_dsg.DynamicSceneGraph.from_binary(content)


def _filled(count: int) -> spark_dsg.DynamicSceneGraph:
    graph = spark_dsg.DynamicSceneGraph()
    position = np.array([0.04, 0.05, 0.06])
    for index in range(count):
        attributes = spark_dsg.ObjectNodeAttributes()
        attributes.semantic_label = index
        attributes.name = f"number {index}"
        attributes.registered = index % 2 == 0
        attributes.position = position
        attributes.last_update_time_ns = index
        graph.add_node(_LAYER, spark_dsg.NodeSymbol("n", index), attributes)
    return graph
