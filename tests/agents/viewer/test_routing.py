"""Arrows of the graph view: from node to node, across no label, bundled, each bundle told by its label."""

from __future__ import annotations

import itertools
import math

import pytest

from agents.viewer.layout import Drawing, DrawnNode, arrange
from agents.viewer.routing import LETTER, EdgeKey, Point

Graph = tuple[dict[str, str], list[EdgeKey]]


def tabletop(*, towers: int, height: int, cameras: int) -> Graph:
    """Towers of cubes on a table, all of which every camera sees."""
    nodes = {"world": "world", "table": "table", "robot": "robot", "gripper": "gripper"}
    edges = [("world", "table", "RT"), ("world", "robot", "RT"), ("robot", "gripper", "RT")]
    seen_by = [f"camera_{number}" for number in range(cameras)]
    nodes |= dict.fromkeys(seen_by, "camera")
    edges += [("world", camera, "RT") for camera in seen_by]
    for tower in range(towers):
        below = "table"
        for level in range(height):
            cube = f"cube_{tower}_{level}"
            nodes[cube] = "cube"
            edges += [("world", cube, "Virtual_RT"), (cube, below, "on")]
            edges += [(camera, cube, "RT") for camera in seen_by]
            below = cube
    edges += [("gripper", "cube_0_0", "grasping"), ("cube_0_0", "cube_0_0", "my_own_type")]
    return nodes, edges


GRAPHS = [
    tabletop(towers=2, height=2, cameras=1),
    tabletop(towers=20, height=1, cameras=2),
    tabletop(towers=4, height=5, cameras=3),
    (
        {"mind": "mind", **{f"action_{number}": "action" for number in range(4)}},
        [("mind", f"action_{number}", "has") for number in range(4)]
        + [(f"action_{number}", f"action_{number + 1}", "next") for number in range(3)],
    ),
]


def label_box(node: DrawnNode) -> tuple[float, float, float, float]:
    """Left, right, top, bottom of a label of 12 px below its node, in a view as large as the drawing."""
    half = len(node.label) * LETTER / 2
    return node.at[0] - half, node.at[0] + half, node.at[1] + 8, node.at[1] + 28


def crosses(begin: Point, end: Point, box: tuple[float, float, float, float]) -> bool:
    """Whether a piece of an arrow touches a box, at one of a hundred points of it."""
    left, right, top, bottom = box
    points = ([a + (b - a) * step / 100 for a, b in zip(begin, end, strict=True)] for step in range(101))
    return any(left < x < right and top < y < bottom for x, y in points)


def crossed(drawing: Drawing) -> list[tuple[EdgeKey, str]]:
    return [
        (edge.key, node.name)
        for edge in drawing.edges
        for node in drawing.nodes
        if any(crosses(*piece, label_box(node)) for piece in itertools.pairwise(edge.path))
    ]


@pytest.mark.parametrize("graph", GRAPHS)
def test_arrows_join_their_nodes(graph: Graph) -> None:
    drawing = arrange(*graph)
    places = {node.name: node.at for node in drawing.nodes}
    for edge in drawing.edges:
        src, dst, _ = edge.key
        assert math.dist(edge.path[0], places[src]) < 25 and math.dist(edge.path[-1], places[dst]) < 25


@pytest.mark.parametrize("graph", GRAPHS)
def test_no_arrow_crosses_the_label_of_a_node(graph: Graph) -> None:
    assert crossed(arrange(*graph)) == []


@pytest.mark.parametrize("graph", GRAPHS)
def test_labels_of_edges_cover_neither_each_other_nor_those_of_nodes(graph: Graph) -> None:
    drawing = arrange(*graph)
    named = [(node.label, node.at) for node in drawing.nodes] + [(label.text, label.at) for label in drawing.labels]
    for (text, at), (other, there) in itertools.combinations(named, 2):
        beside = abs(at[0] - there[0]) >= (len(text) + len(other)) * LETTER / 2
        assert beside or abs(at[1] - there[1]) >= 20, (text, other)


def test_one_label_tells_the_type_of_a_bundle() -> None:
    labels = [label.text for label in arrange(*tabletop(towers=20, height=1, cameras=2)).labels]
    assert sorted(labels) == ["RT"] * 4 + [
        "Virtual_RT",
        "grasping",
        "my_own_type",
        "on",
    ]  # of world, robot, two cameras


def test_parts_and_plans_need_no_labels() -> None:
    assert arrange(*GRAPHS[-1]).labels == []


def test_a_bundle_passes_columns_as_one() -> None:
    drawing = arrange(*tabletop(towers=20, height=1, cameras=1))
    table = next(node.at[0] for node in drawing.nodes if node.name == "table")
    levels = {
        begin[1]
        for edge in drawing.edges
        if edge.key[2] == "Virtual_RT"
        for begin, end in itertools.pairwise(edge.path)
        if begin[0] <= table <= end[0]
    }
    assert len(levels) == 1


def test_edges_that_join_the_same_nodes_run_side_by_side() -> None:
    edges = [("a", "b", "RT"), ("a", "b", "Virtual_RT"), ("b", "a", "on")]
    ends = [
        {point for point in (edge.path[0], edge.path[-1]) if point[0] < 50}
        for edge in arrange({"a": "thing", "b": "thing"}, edges).edges
    ]
    assert all(math.dist(*one, *other) >= 4 for one, other in itertools.combinations(ends, 2))
