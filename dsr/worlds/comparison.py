"""Compares two worlds: nodes, edges, attributes, poses."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

import msgspec

from dsr.frames.tree import BELIEVED
from dsr.graph.elements import Edge, Node
from dsr.math3d.transforms import Pose
from dsr.worlds.registry import ROOT, VIA

if TYPE_CHECKING:
    from dsr.memory import Memory


class Tolerance(msgspec.Struct, frozen=True):
    """Differences up to which values count as equal."""

    metres: float = 1e-3
    radians: float = 1e-2
    numbers: float = 1e-9
    """Relative difference of other floating point numbers, by the greater one."""


class ElementName(msgspec.Struct, frozen=True, order=True):
    """A node, or an edge by its type and ends."""

    name: str
    """The node's; of an edge `source destination`."""
    type: str


class ChangedAttribute(msgspec.Struct, frozen=True):
    """An attribute whose values differ; None stands for one that is not set."""

    element: ElementName
    attribute: str
    first: Any
    second: Any


class MovedEdge(msgspec.Struct, frozen=True):
    """A geometric edge whose poses differ."""

    element: ElementName
    metres: float
    radians: float


class MovedNode(msgspec.Struct, frozen=True):
    """A node that is elsewhere in the world, whichever edge is to blame."""

    name: str
    metres: float
    """Distance (m) between the poses; infinite if the node has a place in one of the worlds only."""
    radians: float


class Difference(msgspec.Struct, frozen=True):
    """The differences between a first and a second world; empty lists if there are none."""

    only_first: list[ElementName]
    """Nodes and edges that only the first world has. Edges at nodes that only it has are left out."""
    only_second: list[ElementName]
    retyped: list[tuple[ElementName, ElementName]]
    """Nodes of one name and two types."""
    attributes: list[ChangedAttribute]
    edges: list[MovedEdge]
    nodes: list[MovedNode]

    @property
    def equal(self) -> bool:
        """Whether nothing differs."""
        return not any(
            (self.only_first, self.only_second, self.retyped, self.attributes, self.edges, self.nodes)
        )  # fmt: skip


def difference(
    first: Memory, second: Memory, tolerance: Tolerance | None = None, *, ignore: Iterable[str] = ()
) -> Difference:
    """Compare two worlds as they are now.

    Poses are compared by distance and angle only, edge by edge and node by node in the frame `world` (as believed,
    else as perceived). How elements came into their world (attribute `via`) and attributes in `ignore` do not count.
    """
    limits, left_out = tolerance or Tolerance(), frozenset(ignore) | {VIA}
    nodes = [{node.name: node for node in memory.nodes()} for memory in (first, second)]
    edges = [{edge.key: edge for edge in memory.edges()} for memory in (first, second)]
    both_nodes = [(nodes[0][name], nodes[1][name]) for name in sorted(nodes[0].keys() & nodes[1].keys())]
    both_edges = [(edges[0][key], edges[1][key]) for key in sorted(edges[0].keys() & edges[1].keys())]
    pairs: list[tuple[Node, Node] | tuple[Edge, Edge]] = [*both_nodes, *both_edges]
    return Difference(
        only_first=list(_only(nodes[0], nodes[1], edges[0], edges[1])),
        only_second=list(_only(nodes[1], nodes[0], edges[1], edges[0])),
        retyped=[(_named(one), _named(other)) for one, other in both_nodes if one.type != other.type],
        attributes=[found for one, other in pairs for found in _attributes(one, other, limits, left_out)],
        edges=[moved for one, other in both_edges if (moved := _moved_edge(one, other, limits))],
        nodes=[gone for one, _ in both_nodes if (gone := _moved_node(one.name, first, second, limits))],
    )


def _only(
    nodes: dict[str, Node],
    other_nodes: dict[str, Node],
    edges: dict[tuple[str, str, str], Edge],
    other_edges: dict[tuple[str, str, str], Edge],
) -> Iterator[ElementName]:
    yield from (_named(nodes[name]) for name in sorted(nodes.keys() - other_nodes.keys()))
    for key in sorted(edges.keys() - other_edges.keys()):
        if key[0] in other_nodes and key[1] in other_nodes:
            yield _named(edges[key])


def _named(element: Node | Edge) -> ElementName:
    name = element.name if isinstance(element, Node) else f"{element.src} {element.dst}"
    return ElementName(name, element.type)


def _attributes(
    one: Node | Edge, other: Node | Edge, limits: Tolerance, left_out: frozenset[str]
) -> Iterator[ChangedAttribute]:
    mine, theirs = one.attributes, other.attributes
    for name in sorted((mine.keys() | theirs.keys()) - left_out):
        first, second = mine.get(name), theirs.get(name)
        if isinstance(one, Edge) and isinstance(first, Pose) and isinstance(second, Pose):
            continue
        if not _are_equal(first, second, limits):
            yield ChangedAttribute(_named(one), name, first, second)


def _are_equal(first: Any, second: Any, limits: Tolerance) -> bool:
    if isinstance(first, Pose) and isinstance(second, Pose):
        return _is_near(*first.distance(second), limits)
    if isinstance(first, float) and isinstance(second, float | int):
        return math.isclose(first, second, rel_tol=limits.numbers)
    if isinstance(first, tuple) and isinstance(second, tuple):
        return len(first) == len(second) and all(_are_equal(a, b, limits) for a, b in zip(first, second, strict=True))
    return type(first) is type(second) and bool(first == second)


def _is_near(metres: float, radians: float, limits: Tolerance) -> bool:
    return metres <= limits.metres and radians <= limits.radians


def _moved_edge(one: Edge, other: Edge, limits: Tolerance) -> MovedEdge | None:
    first, second = one.get("pose"), other.get("pose")
    if not (isinstance(first, Pose) and isinstance(second, Pose)):
        return None
    metres, radians = first.distance(second)
    return None if _is_near(metres, radians, limits) else MovedEdge(_named(one), metres, radians)


def _moved_node(name: str, first: Memory, second: Memory, limits: Tolerance) -> MovedNode | None:
    here, there = (world.get_transform(ROOT, name, types=BELIEVED) for world in (first, second))
    if here is None and there is None:
        return None
    if here is None or there is None:
        return MovedNode(name, math.inf, 0.0)
    metres, radians = here.distance(there)
    return None if _is_near(metres, radians, limits) else MovedNode(name, metres, radians)
