"""The graph view: nodes and edges of the working memory, with the attributes of the node that is selected."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from typing import Any

import rerun as rr

from agents.viewer.folding import Folded, fold
from agents.viewer.free_places import LINE
from agents.viewer.layout import Drawing, DrawnNode, arrange
from agents.viewer.palette import Color
from agents.viewer.routing import DrawnEdge, EdgeLabel
from agents.viewer.texts import drawable
from dsr import Change, Memory, Pose

ENTITY = "graph"
BACKGROUND: Color = (14, 16, 20)
"""Colour of the view, and so of the frame that keeps labels from being cut off."""
_TOLD_EVERY = 1.0  # s; poses change at every frame, and nobody reads faster
_POINT = 5.0  # px on the screen, whatever the zoom
_LINE = rr.Radius.ui_points(1.0)
_INVISIBLE = rr.Radius.ui_points(0.0)
_MEASURED = ("RT", "Virtual_RT")


class GraphView:
    """Logs each node as an entity that carries its attributes, and the edges of each type as one."""

    def __init__(self, recording: rr.RecordingStream) -> None:
        self._recording = recording
        self._shown: Folded | None = None
        self._types: set[str] = set()
        self._told: dict[str, dict[str, str]] = {}
        self._tell_at = 0.0

    def draw(self, memory: Memory, changes: Iterable[Change], now: float) -> None:
        """Log the graph if nodes or edges came or went, and attributes once a second at most."""
        if self._shown is None or any(change.kind != "updated" or change.type == "action" for change in changes):
            folded = fold(memory)
            if folded != self._shown:
                self._draw(folded)
        if now >= self._tell_at:
            self._tell_at = now + _TOLD_EVERY
            self._tell(memory)

    def _draw(self, folded: Folded) -> None:
        before = self._shown.nodes if self._shown is not None else {}
        for name in before.keys() - folded.nodes.keys():
            self._told.pop(name, None)
            self._recording.log(_node(name), rr.Clear(recursive=False))
        self._shown = folded
        drawing = arrange(folded.nodes, folded.edges, folded.labels)
        (left, top), (right, bottom) = drawing.frame
        corners = [(left, top), (right, top), (right, bottom), (left, bottom), (left, top)]
        self._recording.log([ENTITY, "frame"], rr.LineStrips2D([corners], colors=[BACKGROUND], radii=_LINE))
        for node in drawing.nodes:
            self._draw_node(node)
        self._draw_edges(drawing)

    def _draw_node(self, node: DrawnNode) -> None:
        """Each line of the label has a point of its own, all but the first invisible: rerun has labels of one line."""
        lines = node.label.split("\n")
        looks = rr.Points2D(
            [(node.at[0], node.at[1] + LINE * index) for index in range(len(lines))],
            radii=rr.Radius.ui_points([_POINT, *[0.0] * (len(lines) - 1)]),
            colors=[node.color] * len(lines),
            labels=lines,
            show_labels=True,
        )
        self._recording.log(_node(node.name), looks)

    def _draw_edges(self, drawing: Drawing) -> None:
        by_type: dict[str, list[DrawnEdge]] = defaultdict(list)
        for edge in drawing.edges:
            by_type[edge.key[2]].append(edge)
        for type in self._types - by_type.keys():
            self._recording.log(_edges(type), rr.Clear(recursive=True))
        self._types = set(by_type)
        for type, same in by_type.items():
            color = same[0].color
            self._recording.log(
                _edges(type), rr.LineStrips2D([edge.path[:-1] for edge in same], colors=[color], radii=_LINE)
            )
            ends = [edge.path[-2:] for edge in same]
            vectors = [(head[0] - tail[0], head[1] - tail[1]) for tail, head in ends]
            arrows = rr.Arrows2D(origins=[tail for tail, _ in ends], vectors=vectors, colors=[color], radii=_LINE)
            self._recording.log([*_edges(type), "ends"], arrows)
            self._draw_labels(type, [label for label in drawing.labels if label.text == type])

    def _draw_labels(self, type: str, labels: list[EdgeLabel]) -> None:
        """Beneath invisible points: labels of lines would be where rerun finds their middle."""
        points = rr.Points2D(
            [label.at for label in labels],
            colors=[label.color for label in labels],
            labels=[drawable(label.text) for label in labels],
            radii=_INVISIBLE,
            show_labels=True,
        )
        self._recording.log([*_edges(type), "labels"], points)

    def _tell(self, memory: Memory) -> None:
        """Log the attributes of each node, and where it is, for the panel that shows what is selected."""
        places: dict[str, dict[str, str]] = defaultdict(dict)
        for type in _MEASURED:
            for edge in memory.edges(type):
                pose = edge.get("pose")
                if isinstance(pose, Pose):
                    places[edge.dst][f"{type} in {edge.src} [m]"] = _numbers(pose.translation)
                    places[edge.dst][f"{type} in {edge.src} [xyzw]"] = _numbers(pose.rotation)
        for name in self._shown.nodes if self._shown is not None else ():
            node = memory.get_node(name)
            if node is None:
                continue
            told = {key: drawable(_value(value)) for key, value in sorted(node.attributes.items())}
            told = {"type": node.type, **told, **places.get(name, {})}
            before = self._told.get(name, {})
            if told != before:
                self._told[name] = told
                gone = dict.fromkeys(before.keys() - told.keys(), "")
                self._recording.log(_node(name), rr.DynamicArchetype("node", components={**told, **gone}))


def _node(name: str) -> list[object]:
    return [ENTITY, "nodes", name]


def _edges(type: str) -> list[object]:
    return [ENTITY, "edges", type]


def _numbers(values: Iterable[float]) -> str:
    """As many digits as the panel has room for: 1 mm, or 0.1 degrees."""
    return ", ".join(f"{value:.3f}" for value in values)


def _value(value: Any) -> str:
    if isinstance(value, bytes):
        return f"{len(value)} bytes"
    if isinstance(value, float):
        return f"{value:.6g}"
    return ", ".join(map(_value, value)) if isinstance(value, list | tuple) else str(value)
