"""The graph view: nodes and edges of the working memory, logged only when one comes or goes."""

from __future__ import annotations

import rerun as rr

from agents.viewer.layout import arrange
from dsr import Memory
from dsr.timeline import EVENT, SITUATION

ENTITY = "graph"
_LEFT_OUT = (EVENT, SITUATION)  # too many, and shown over time


class GraphView:
    """Logs the graph as boxes and arrows."""

    def __init__(self, recording: rr.RecordingStream) -> None:
        self._recording = recording
        self._shown: object = None

    def draw(self, memory: Memory) -> None:
        """Log the graph if nodes, their types or edges are others than before."""
        nodes = {node.name: node.type for node in memory.nodes() if node.type not in _LEFT_OUT}
        edges = [edge.key for edge in memory.edges() if edge.src in nodes and edge.dst in nodes]
        content = (nodes, sorted(edges))
        if content == self._shown:
            return
        self._shown = content
        boxes, arrows = arrange(nodes, edges)
        self._recording.log(
            ENTITY,  # one entity for both, or rerun draws the edges between nodes of its own
            rr.GraphNodes(
                [box.id for box in boxes],
                labels=[box.label for box in boxes],
                colors=[box.color for box in boxes],
                positions=[(box.x, box.y) for box in boxes],
                show_labels=True,
            ),
            rr.GraphEdges(arrows, graph_type="directed"),
        )
