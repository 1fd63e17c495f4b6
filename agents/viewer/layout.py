"""Where to draw nodes and edges: a tree from left to right, the same for the same graph.

A node stands right of what it rests on, is part of, or is measured from. So a tower of cubes is a row of them, behind
the table. Labels are as large on the screen whatever the zoom, and stand below their nodes.
"""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from agents.viewer import palette
from agents.viewer.palette import Color

EdgeKey = tuple[str, str, str]
"""(source, destination, type)"""
Point = tuple[float, float]
"""px to the right, px down"""

_ROW = 48.0  # px from one row to the next: a node, and its label of 12 px below; all lengths below in px, too
_LETTER = 7.5  # width of a letter of a label of 12 px
_GAP = 36.0  # from the labels of one column to those of the next, for the arrows
_MARGIN = 30.0  # around everything, for labels at the border
_RADIUS = 9.0  # from the middle of a node to the ends of its arrows
_BESIDE = 6.0  # between arrows that join the same two nodes
_TALLEST = 6  # leaves below one another
_STRUCTURE = ("has", "next")
"""Types of edges of parts and plans. They have no label: where their nodes stand says enough."""
_TOWARDS_DESTINATION = ("on", "in")
_PARENTS = ("on", "in", "has", "next", "RT", "Virtual_RT")
"""Types of edges by which a node is placed, the best first."""
_FIRST = {"robot": 0, "camera": 1, "mind": 2, "table": 4}
"""Order of the nodes below the same parent, by type; of all others, 3."""


class DrawnNode(NamedTuple):
    """A node at its place."""

    name: str
    label: str
    color: Color
    at: Point


class DrawnEdge(NamedTuple):
    """An arrow from node to node."""

    key: EdgeKey
    label: str
    """Type of the edge; empty if another edge beside it says it already."""
    color: Color
    begin: Point
    end: Point


class Drawing(NamedTuple):
    """The elements of a drawing."""

    nodes: list[DrawnNode]
    edges: list[DrawnEdge]
    frame: tuple[Point, Point]
    """Corners of the rectangle that holds everything, labels included: the upper left and the lower right one."""


class _Item:
    """A node while it is being placed."""

    def __init__(self, name: str, label: str, type: str) -> None:
        self.name = name
        self.label = label
        self.type = type
        self.children: list[_Item] = []
        self.placed = False
        self.column = 0
        self.row = 0.0

    @property
    def order(self) -> tuple[int, list[str | int]]:
        return _FIRST.get(self.type, 3), _natural(self.name)


def arrange(nodes: Mapping[str, str], edges: Iterable[EdgeKey], labels: Mapping[str, str] | None = None) -> Drawing:
    """Draw a graph.

    Args:
        nodes: the type of each node, by name.
        edges: between these nodes.
        labels: of nodes that are called otherwise than by their names.
    """
    items = {name: _Item(name, (labels or {}).get(name, name), type) for name, type in nodes.items()}
    keys = sorted(edges)
    parents: dict[str, list[tuple[int, str]]] = defaultdict(list)
    for src, dst, type in keys:
        child, parent = (src, dst) if type in _TOWARDS_DESTINATION else (dst, src)
        parents[child].append((_PARENTS.index(type) if type in _PARENTS else len(_PARENTS), parent))
    _place(items, {name: [parent for _, parent in sorted(ranked)] for name, ranked in parents.items()})
    places = _places(list(items.values()))
    drawn = [DrawnNode(name, item.label, palette.of_node(item.type), places[name]) for name, item in items.items()]
    return Drawing(drawn, _arrows(keys, places), _frame(drawn))


def _place(items: Mapping[str, _Item], parents: Mapping[str, list[str]]) -> None:
    """Make a forest of the best parents and give every item its column and row."""
    for name, item in items.items():
        if parents.get(name):
            items[parents[name][0]].children.append(item)
    roots = sorted((item for name, item in items.items() if not parents.get(name)), key=lambda item: item.order)
    row = 0.0
    for item in [*roots, *sorted(items.values(), key=lambda item: item.order)]:  # the latter for cycles
        if not item.placed:
            row = _descend(item, 0, row)


def _descend(item: _Item, column: int, row: float) -> float:
    """Place a subtree whose first leaf is in `row`; returns the next free row."""
    item.placed, item.column, item.row = True, column, row
    children = sorted((child for child in item.children if not child.placed), key=lambda child: child.order)
    leaves = [child for child in children if not child.children]
    if len(leaves) <= _TALLEST:
        leaves = []
    free = row
    for child in children:
        if child not in leaves and not child.placed:
            free = _descend(child, column + 1, free)
    free = _place_grid(leaves, column + 1, free)
    if children:
        rows = [child.row for child in children]
        item.row = (min(rows) + max(rows)) / 2
    return free if children else row + 1


def _place_grid(leaves: list[_Item], column: int, row: float) -> float:
    """Place many leaves side by side; returns the next free row."""
    for index, leaf in enumerate(leaves):
        leaf.placed = True
        leaf.column, leaf.row = column + index // _TALLEST, row + index % _TALLEST
    return row + min(len(leaves), _TALLEST)


def _places(items: list[_Item]) -> dict[str, Point]:
    """The middle of each node."""
    widths: dict[int, float] = defaultdict(float)
    for item in items:
        widths[item.column] = max(widths[item.column], len(item.label) * _LETTER)
    centres, x = {}, 0.0
    for column in range(max(widths, default=0) + 1):
        centres[column] = x + widths[column] / 2
        x += widths[column] + _GAP
    return {item.name: (centres[item.column], item.row * _ROW) for item in items}


def _arrows(keys: list[EdgeKey], places: Mapping[str, Point]) -> list[DrawnEdge]:
    """The arrows; of those of one type at one node, the one in the middle has the label."""
    groups: dict[tuple[str, str], list[EdgeKey]] = defaultdict(list)
    pairs: dict[tuple[str, ...], list[EdgeKey]] = defaultdict(list)
    for key in keys:
        src, dst, type = key
        groups[dst if type in _TOWARDS_DESTINATION else src, type].append(key)
        pairs[tuple(sorted((src, dst)))].append(key)
    labelled = {same[len(same) // 2] for (_, type), same in groups.items() if type not in _STRUCTURE}
    arrows = []
    for src, dst, type in keys:
        beside = pairs[tuple(sorted((src, dst)))]
        shift = (beside.index((src, dst, type)) - (len(beside) - 1) / 2) * _BESIDE
        begin, end = _ends(places[src], places[dst], shift if src <= dst else -shift)
        label = type if (src, dst, type) in labelled else ""
        arrows.append(DrawnEdge((src, dst, type), label, palette.of_edge(type), begin, end))
    return arrows


def _ends(a: Point, b: Point, shift: float) -> tuple[Point, Point]:
    """Ends of an arrow outside of its nodes, moved sideways by `shift`; of an edge to itself, a short one below."""
    length = math.dist(a, b)
    if length <= 2 * _RADIUS:
        return (a[0] - _RADIUS, a[1] + _RADIUS), (a[0] + _RADIUS, a[1] + _RADIUS)
    along = (b[0] - a[0]) / length, (b[1] - a[1]) / length
    dx, dy = -along[1] * shift, along[0] * shift
    return (
        (a[0] + along[0] * _RADIUS + dx, a[1] + along[1] * _RADIUS + dy),
        (b[0] - along[0] * _RADIUS + dx, b[1] - along[1] * _RADIUS + dy),
    )


def _frame(nodes: list[DrawnNode]) -> tuple[Point, Point]:
    halves = [len(node.label) * _LETTER / 2 for node in nodes]
    left = min((node.at[0] - half for node, half in zip(nodes, halves, strict=True)), default=0.0)
    right = max((node.at[0] + half for node, half in zip(nodes, halves, strict=True)), default=0.0)
    top = min((node.at[1] for node in nodes), default=0.0)
    bottom = max((node.at[1] for node in nodes), default=0.0)
    return (left - _MARGIN, top - _MARGIN), (right + _MARGIN, bottom + 2 * _MARGIN)


def _natural(name: str) -> list[str | int]:
    """Sorts cube_10 after cube_9."""
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", name)]
