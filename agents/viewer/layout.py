"""Where to draw nodes and edges: a tree from left to right, the same for the same graph.

A node stands right of what it rests on, is part of, or is measured from. So a tower of cubes is a row of them, behind
the table. Labels are as large on the screen whatever the zoom, and stand below their nodes. So those of a drawing that
is wider than its view would touch: long names take two lines then.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from agents.viewer import palette
from agents.viewer.free_places import LINE, Column
from agents.viewer.palette import Color
from agents.viewer.routing import (
    LETTER,
    TOWARDS_DESTINATION,
    DrawnEdge,
    EdgeKey,
    EdgeLabel,
    Place,
    Point,
    label_gaps,
    route,
)

_ROW = 52.0  # px from one row to the next: a node, its label of 12 px, and arrows that pass below; px all below, too
_GAP = 44.0  # from the labels of one column to those of the next, for the arrows
_ASPECT = 2.8  # width over height up to which gaps are widened: that of the view in a window of 1280 by 720 px
_VIEW = 800.0
"""Width of the view in a window of 1280 by 720 px; a wider drawing is shrunk, but its labels are not"""
_SHORT = 12
"""Letters of a label that always stands on one line: no wider than the arrows beside a node"""
_WIDEST = 160.0  # by which a gap is widened at most
_MARGIN = 30.0  # around everything, for labels at the border
_TALLEST = 6  # leaves below one another, unless there are very many
_DEEPEST = 100  # columns; what stands deeper begins anew at the left
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


class Drawing(NamedTuple):
    """The elements of a drawing."""

    nodes: list[DrawnNode]
    edges: list[DrawnEdge]
    labels: list[EdgeLabel]
    """Types of edges, one for each bundle."""
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
    def width(self) -> float:
        """Of the label, px."""
        return max(map(len, self.label.split("\n"))) * LETTER

    @property
    def lines(self) -> int:
        """Of the label."""
        return self.label.count("\n") + 1

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
    _place(items, _parents(keys))
    gaps = label_gaps(keys, {name: item.column for name, item in items.items()})
    if _is_too_wide(items.values(), gaps):
        for item in items.values():
            item.label = in_two_lines(item.label)
    row = _ROW + LINE * (max((item.lines for item in items.values()), default=1) - 1)
    columns = _columns(items.values(), gaps, row)
    places = {name: Place(item.column, (columns[item.column].middle, item.row * row)) for name, item in items.items()}
    drawn = [DrawnNode(name, item.label, palette.of_node(item.type), places[name].at) for name, item in items.items()]
    arrows, told = route(keys, places, columns)
    return Drawing(drawn, arrows, told, _frame(drawn, arrows, told))


def _parents(keys: Iterable[EdgeKey]) -> dict[str, list[str]]:
    """What each node may stand right of, the best first."""
    found: dict[str, list[tuple[int, str]]] = defaultdict(list)
    for src, dst, type in keys:
        child, parent = (src, dst) if type in TOWARDS_DESTINATION else (dst, src)
        found[child].append((_PARENTS.index(type) if type in _PARENTS else len(_PARENTS), parent))
    return {name: [parent for _, parent in sorted(ranked)] for name, ranked in found.items()}


def _place(items: Mapping[str, _Item], parents: Mapping[str, list[str]]) -> None:
    """Make a forest of the best parents and give every item its column and row."""
    for name, item in items.items():
        if parents.get(name):
            items[parents[name][0]].children.append(item)
    ordered = sorted(items.values(), key=lambda item: item.order)
    row = 0.0
    for item in [*(root for root in ordered if not parents.get(root.name)), *ordered]:  # the latter for cycles
        if not item.placed:
            row = _descend(item, 0, row)


def _descend(item: _Item, column: int, row: float) -> float:
    """Place a subtree whose first leaf is in `row`; returns the next free row."""
    item.placed, item.column, item.row = True, column, row
    below = item.children if column < _DEEPEST else []
    children = sorted((child for child in below if not child.placed), key=lambda child: child.order)
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
    tallest = max(_TALLEST, -(-len(leaves) // _DEEPEST))
    for index, leaf in enumerate(leaves):
        leaf.placed = True
        leaf.column, leaf.row = column + index // tallest, row + index % tallest
    return row + min(len(leaves), tallest)


def in_two_lines(label: str) -> str:
    """A long label broken behind the mark between two of its words that is nearest to its middle, if there is one."""
    breaks = [match.end() for match in re.finditer(r"[^a-zA-Z0-9()]+", label[:-1])]
    if len(label) <= _SHORT or not breaks:
        return label
    at = min(breaks, key=lambda place: (max(place, len(label) - place), place))
    return f"{label[:at].rstrip()}\n{label[at:]}"


def _is_too_wide(items: Iterable[_Item], gaps: Mapping[int, float]) -> bool:
    """Whether a drawing with every label on one line is wider than its view, and is not as high, too."""
    columns = _columns(items, gaps, _ROW)
    width = columns[-1].right if columns else 0.0
    height = max((row for column in columns for row in column.rows), default=0.0) + _ROW
    return width > max(_VIEW, _ASPECT * height)


def _columns(items: Iterable[_Item], gaps: Mapping[int, float], row: float) -> list[Column]:
    """The columns from left to right, each with the gap that follows; rows are `row` (px) apart."""
    widths: dict[int, float] = defaultdict(float)
    rows: dict[int, list[float]] = defaultdict(list)
    lines: dict[int, int] = defaultdict(int)
    for item in items:
        widths[item.column] = max(widths[item.column], item.width)
        rows[item.column].append(item.row * row)
        lines[item.column] = max(lines[item.column], item.lines)
    numbers = range(max(widths, default=-1) + 1)
    all_gaps = [max(_GAP, gaps.get(number, 0.0)) for number in numbers]
    height = max((y for ys in rows.values() for y in ys), default=0.0) + row
    spare = (_ASPECT * height - sum(widths.values()) - sum(all_gaps)) / max(1, len(all_gaps))
    columns, left = [], 0.0
    for number in numbers:
        gap = all_gaps[number] + min(max(0.0, spare), _WIDEST)
        columns.append(Column(left, left + widths[number], gap, tuple(sorted(rows[number])), lines[number]))
        left += widths[number] + gap
    return columns


def _frame(nodes: list[DrawnNode], edges: list[DrawnEdge], labels: list[EdgeLabel]) -> tuple[Point, Point]:
    named = [(node.label, node.at) for node in nodes] + [(label.text, label.at) for label in labels]
    halves = [(max(map(len, text.split("\n"))) * LETTER / 2, at[0]) for text, at in named]
    xs = [x + side * half for half, x in halves for side in (-1, 1)]
    xs += [point[0] for edge in edges for point in edge.path]
    ys = [at[1] + LINE * text.count("\n") for text, at in named] + [at[1] for _, at in named]
    ys += [point[1] for edge in edges for point in edge.path]
    left, right, top, bottom = min(xs, default=0.0), max(xs, default=0.0), min(ys, default=0.0), max(ys, default=0.0)
    return (left - _MARGIN, top - _MARGIN), (right + _MARGIN, bottom + 2 * _MARGIN)


def _natural(name: str) -> list[str | int]:
    """Sorts cube_10 after cube_9."""
    return [int(part) if part.isdecimal() else part for part in re.split(r"(\d+)", name)]
