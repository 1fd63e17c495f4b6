"""Where to draw nodes and edges: a tree from left to right, the same for the same graph.

rerun draws all edges alike and without labels. So an edge whose type matters runs through a small box with
its type's name and colour. Edges of one type at one node share the box, which keeps a graph with many
objects readable: `camera -> [RT] -> cubes`, `cubes -> [on] -> table`. Edges of the kinematic chain, of parts and of
plans are plain.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from agents.viewer import palette
from agents.viewer.palette import Color

EdgeKey = tuple[str, str, str]
"""(source, destination, type)"""

_ROW = 52.0  # px, all lengths below as well
_GAP = 24.0
_LETTER = 7.0
_MARGIN = 22.0
_TALLEST = 6  # leaves below one another
_LEFT_OUT = ("sees",)  # edges that images show better
_PLAIN = ("has", "next")  # edges of parts and plans, without a box
_TOWARDS_DESTINATION = ("on", "in")
_PARENTS = ("Virtual_RT", "RT", "has", "next", "in", "on")  # edge types by which a node is placed, best first
_FIRST = {"robot": 0, "camera": 1, "": 2, "table": 4}  # "" is a box of edges


class LabelBox(NamedTuple):
    """A labelled box."""

    id: str
    label: str
    color: Color
    x: float
    y: float


class Drawing(NamedTuple):
    """The elements of a drawing."""

    boxes: list[LabelBox]
    arrows: list[tuple[str, str]]
    """Arrows from box to box, by id."""


class _Item:
    """A box while it is being placed."""

    def __init__(self, id: str, label: str, type: str, color: Color) -> None:
        self.id = id
        self.label = label
        self.type = type
        """Node type; empty for a box of edges."""
        self.color = color
        self.children: list[_Item] = []
        self.placed = False
        self.column = 0
        self.row = 0.0

    @property
    def order(self) -> tuple[int, list[str | int]]:
        return _FIRST.get(self.type, 3), _natural(self.id)

    @property
    def width(self) -> float:
        return len(self.label) * _LETTER + _MARGIN


def arrange(nodes: Mapping[str, str], edges: Iterable[EdgeKey]) -> Drawing:
    """Draw `nodes` (type by name) and the edges between them."""
    items = {name: _Item(name, _label(name, type), type, palette.of_node(type)) for name, type in nodes.items()}
    arrows: dict[tuple[str, str], None] = {}
    parents: dict[str, list[tuple[int, str]]] = defaultdict(list)
    for src, dst, type in sorted(edges):
        rank = _PARENTS.index(type) if type in _PARENTS else len(_PARENTS)
        if type in _LEFT_OUT:
            continue
        if type in _PLAIN or (type == "RT" and nodes[src] != "camera"):
            arrows[src, dst] = None
            parents[dst].append((-1, src))
            continue
        anchor, other = (dst, src) if type in _TOWARDS_DESTINATION else (src, dst)
        box = f"{anchor} {type}"  # no node has a space in its name
        if box not in items:
            items[box] = _Item(box, type, "", palette.of_edge(type))
            parents[box].append((-1, anchor))
        arrows[src, box] = arrows[box, dst] = None
        parents[other].append((rank, box))
    _place(items, {name: [parent for _, parent in sorted(ranked)] for name, ranked in parents.items()})
    for item in items.values():
        if not item.type and item.label in _TOWARDS_DESTINATION:
            item.column = 1 + max(items[end].column for arrow in arrows if item.id in arrow for end in arrow)
    return Drawing(_boxes(list(items.values())), list(arrows))


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
    below = column + (3 if item.label == "Virtual_RT" and not item.type else 1)  # leaves room for the percepts' arrows
    children = sorted((child for child in item.children if not child.placed), key=lambda child: child.order)
    leaves = [child for child in children if not child.children]
    if len(leaves) <= _TALLEST:
        leaves = []
    free = row
    for child in children:
        if child not in leaves and not child.placed:
            free = _descend(child, below, free)
    free = _place_grid(leaves, below, free)
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


def _boxes(items: list[_Item]) -> list[LabelBox]:
    """The items with their places in px."""
    widths: dict[int, float] = defaultdict(float)
    for item in items:
        widths[item.column] = max(widths[item.column], item.width)
    centres, x = {}, 0.0
    for column in range(max(widths, default=0) + 1):
        centres[column] = x + widths[column] / 2
        x += widths[column] + _GAP
    return [LabelBox(item.id, item.label, item.color, centres[item.column], item.row * _ROW) for item in items]


def _label(name: str, type: str) -> str:
    """The name; for links of a robot only their number, since the chain says the rest."""
    number = re.fullmatch(r".*_link_(\d+)", name) if type == "body" else None
    return number[1] if number else name


def _natural(name: str) -> list[str | int]:
    """Sorts cube_10 after cube_9."""
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", name)]
