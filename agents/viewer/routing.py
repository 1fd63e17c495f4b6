"""How arrows run between the columns of nodes: bundled by type and hub, and across no label of a node.

Arrows run level across columns, between a node's label and the next node, and slant in the gaps between columns only.
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from agents.viewer import palette
from agents.viewer.free_places import BESIDE, Column, FreeHeights, FreeLevels
from agents.viewer.palette import Color

EdgeKey = tuple[str, str, str]
"""(source, destination, type)"""
Point = tuple[float, float]
"""px to the right, px down"""

LETTER = 7.5
"""px, width of a letter of a label of 12 px."""
TOWARDS_DESTINATION = ("on", "in")
"""Types of edges whose many ends meet at the destination; those of all others at the source."""
_STRUCTURE = ("has", "next")
"""Types of edges of parts and plans. They have no label: where their nodes stand says enough."""
_RADIUS = 9.0  # px from the middle of a node to the ends of its arrows; px all below, too
_BEND = 12.0  # from a column to an arrow between two of its nodes
_ROOM = 16.0  # beside the label of a bundle, within its gap


class Place(NamedTuple):
    """Where a node stands."""

    column: int
    at: Point


class DrawnEdge(NamedTuple):
    """An arrow from node to node."""

    key: EdgeKey
    color: Color
    path: tuple[Point, ...]
    """From source to destination; the head is at the end of the last piece."""


class EdgeLabel(NamedTuple):
    """The type of a bundle of edges, which stands below one of them."""

    text: str
    color: Color
    at: Point


class _Bundle(NamedTuple):
    """Edges of one type that meet at one node, and lead to one side of it."""

    hub: str
    type: str
    side: int
    """1: to the right, -1: to the left, 0: within the column of the hub."""


_Bundles = dict[_Bundle, list[EdgeKey]]


def label_gaps(keys: Iterable[EdgeKey], columns: Mapping[str, int]) -> dict[int, float]:
    """The width (px) that the gap after each column needs for the labels of edges.

    Args:
        keys: of the edges.
        columns: of the nodes.
    """
    widths: dict[int, float] = defaultdict(float)
    for bundle in _bundles(keys, columns):
        if bundle.type not in _STRUCTURE:
            gap = _gap_of(bundle, columns)
            widths[gap] = max(widths[gap], len(bundle.type) * LETTER + _ROOM)
    return widths


def route(
    keys: Sequence[EdgeKey], places: Mapping[str, Place], columns: Sequence[Column]
) -> tuple[list[DrawnEdge], list[EdgeLabel]]:
    """The arrows, and the labels of their bundles.

    Args:
        keys: of the edges, sorted.
        places: of the nodes.
        columns: from left to right.
    """
    bundles = _bundles(keys, {name: place.column for name, place in places.items()})
    ports = _ports(keys, places)
    passes = _passes(bundles, places, columns)
    drawn = []
    for bundle, same in bundles.items():
        through = passes.get(bundle, {})
        drawn += [DrawnEdge(key, palette.of_edge(key[2]), _path(key, places, columns, ports, through)) for key in same]
    return sorted(drawn), _labels(bundles, places, columns, {edge.key: edge.path for edge in drawn})


def _bundles(keys: Iterable[EdgeKey], columns: Mapping[str, int]) -> _Bundles:
    found: _Bundles = defaultdict(list)
    for key in keys:
        hub, other = _hub(key)
        found[_Bundle(hub, key[2], _sign(columns[other] - columns[hub]))].append(key)
    return found


def _hub(key: EdgeKey) -> tuple[str, str]:
    """Where the edge meets others of its bundle, and its other end."""
    src, dst, type = key
    return (dst, src) if type in TOWARDS_DESTINATION else (src, dst)


def _sign(number: float) -> int:
    return (number > 0) - (number < 0)


def _gap_of(bundle: _Bundle, columns: Mapping[str, int]) -> int:
    """The gap beside the hub through which the bundle runs, called by the column before it."""
    return columns[bundle.hub] - (bundle.side < 0)


def _ports(keys: Iterable[EdgeKey], places: Mapping[str, Place]) -> dict[tuple[str, int, str], float]:
    """How far above a node's middle arrows end, by (node, side, type): those that come from above, above."""
    others: dict[tuple[str, int], dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    for src, dst, type in keys:
        for name, other in ((src, dst), (dst, src)):
            side = _side(places[name].column, places[other].column)
            others[name, side][type].append(places[other].at[1])
    ports: dict[tuple[str, int, str], float] = {}
    for (name, side), types in others.items():
        lowest_first = sorted(types, key=lambda type: (-sum(types[type]) / len(types[type]), type))
        ports |= {(name, side, type): -BESIDE * index for index, type in enumerate(lowest_first)}
    return ports


def _side(column: int, other: int) -> int:
    """The side of a node at which an edge to a node of another column ends: 1 right, -1 left."""
    return 1 if other >= column else -1


def _passes(
    bundles: _Bundles, places: Mapping[str, Place], columns: Sequence[Column]
) -> dict[_Bundle, dict[int, float]]:
    """The y at which each bundle passes each column on its way: near the straight way, where nothing else is."""
    passes: dict[_Bundle, dict[int, float]] = defaultdict(dict)
    free = {number: FreeLevels(column) for number, column in enumerate(columns)}
    for bundle, same in bundles.items():
        hub = places[bundle.hub]
        ends = [places[_hub(key)[1]] for key in same]
        farthest = max((end.column for end in ends), key=lambda column: abs(column - hub.column))
        for column in range(hub.column + bundle.side, farthest, bundle.side or 1):
            beyond = [end for end in ends if (end.column - column) * bundle.side > 0]
            straight = [_between(hub, end, column) for end in beyond]
            passes[bundle][column] = free[column].take(sum(straight) / len(straight))
    return passes


def _between(a: Place, b: Place, column: int) -> float:
    """The y of the straight line from a to b in a column between them."""
    return a.at[1] + (b.at[1] - a.at[1]) * (column - a.column) / (b.column - a.column)


def _path(
    key: EdgeKey,
    places: Mapping[str, Place],
    columns: Sequence[Column],
    ports: Mapping[tuple[str, int, str], float],
    through: Mapping[int, float],
) -> tuple[Point, ...]:
    src, dst, type = key
    begin, end = places[src], places[dst]
    side = _side(begin.column, end.column)
    if begin.column == end.column:
        return _bracket(begin, end, columns[begin.column].right + _BEND, ports[src, 1, type], src == dst)
    points = [_at_node(begin, side, ports[src, side, type]), _at_border(begin, side, columns, ports[src, side, type])]
    for column in range(begin.column + side, end.column, side):
        level = through[column]
        near, far = columns[column].left, columns[column].right
        points += [(near, level), (far, level)] if side > 0 else [(far, level), (near, level)]
    side, port = -side, ports[dst, -side, type]
    return (*points, _at_border(end, side, columns, port), _at_node(end, side, port))


def _at_node(place: Place, side: int, port: float) -> Point:
    return place.at[0] + side * _RADIUS, place.at[1] + port


def _at_border(place: Place, side: int, columns: Sequence[Column], port: float) -> Point:
    """Where the arrow leaves the column; outside of the node's own end of the arrow, if the labels are short."""
    column = columns[place.column]
    half = max(column.right - column.middle, 2 * _RADIUS)
    return column.middle + side * half, place.at[1] + port


def _bracket(begin: Place, end: Place, x: float, port: float, is_loop: bool) -> tuple[Point, ...]:
    """From a node to another one of the same column, or to itself: out of the column, along it and back."""
    out, back = begin.at[1] + port, end.at[1] + port
    if is_loop:
        back -= 2 * BESIDE
    near = begin.at[0] + _RADIUS
    return (near, out), (x, out), (x, back), (near, back)


def _labels(
    bundles: _Bundles, places: Mapping[str, Place], columns: Sequence[Column], paths: Mapping[EdgeKey, Sequence[Point]]
) -> list[EdgeLabel]:
    """One for each bundle in the gap beside its hub: below its lowest arrow there, or a free place near that."""
    columns_of = {name: place.column for name, place in places.items()}
    wanted: list[tuple[list[float], _Bundle, float]] = []
    for bundle, same in bundles.items():
        if bundle.type not in _STRUCTURE:
            gap = _gap_of(bundle, columns_of)
            x = columns[gap].right + columns[gap].gap / 2
            wanted.append((sorted({_height(paths[key], x) for key in same}, reverse=True), bundle, x))
    labels: list[EdgeLabel] = []
    free: dict[float, FreeHeights] = defaultdict(FreeHeights)
    for heights, bundle, x in sorted(wanted, key=lambda one: len(one[0])):  # those with the least choice first
        labels.append(EdgeLabel(bundle.type, palette.of_edge(bundle.type), (x, free[x].take(heights, len(wanted)))))
    return labels


def _height(path: Sequence[Point], x: float) -> float:
    """The y of a path at `x`; of its middle, if it does not get there."""
    for (x1, y1), (x2, y2) in itertools.pairwise(path):
        if min(x1, x2) <= x <= max(x1, x2) and x1 != x2:
            return y1 + (y2 - y1) * (x - x1) / (x2 - x1)
    return (path[0][1] + path[-1][1]) / 2
