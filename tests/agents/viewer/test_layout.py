"""Drawings of graphs: complete, the same for the same graph, without overlap."""

from __future__ import annotations

import itertools

import pytest

from agents.viewer import palette
from agents.viewer.layout import Drawing, arrange

NODES = {"world": "world", "robot": "robot", "body": "body", "camera": "camera", "table": "table"} | {
    f"cube_{number}": "cube" for number in range(3, 7)
}
EDGES = [("world", "robot", "RT"), ("world", "camera", "RT"), ("world", "table", "RT"), ("robot", "body", "has")] + [
    edge
    for number in range(3, 7)
    for cube in [f"cube_{number}"]
    for edge in [("camera", cube, "RT"), ("world", cube, "Virtual_RT"), (cube, "table", "on")]
]


def overlapping(drawing: Drawing) -> list[tuple[str, str]]:
    """Pairs of nodes whose labels of 12 px cover each other, in a view that is as large as the drawing."""
    return [
        (a.name, b.name)
        for a, b in itertools.combinations(drawing.nodes, 2)
        if abs(a.at[1] - b.at[1]) < 30 and abs(a.at[0] - b.at[0]) < 7 * (len(a.label) + len(b.label)) / 2 + 10
    ]


def test_every_node_and_edge_is_drawn() -> None:
    drawing = arrange(NODES, EDGES)
    assert {node.name for node in drawing.nodes} == set(NODES)
    assert sorted(edge.key for edge in drawing.edges) == sorted(EDGES)


def test_no_two_labels_overlap() -> None:
    assert overlapping(arrange(NODES, EDGES)) == []


def test_everything_is_in_the_frame_with_its_label() -> None:
    drawing = arrange(NODES, EDGES, {"cube_4": "a cube with a long name"})
    (left, top), (right, bottom) = drawing.frame
    for node in drawing.nodes:
        half = 7 * len(node.label) / 2
        assert left < node.at[0] - half and node.at[0] + half < right
        assert top < node.at[1] and node.at[1] + 30 < bottom


def test_what_lies_on_something_stands_right_of_it() -> None:
    edges = [("cube_3", "cube_4", "on"), *(edge for edge in EDGES if edge[:2] != ("cube_3", "table"))]
    places = {node.name: node.at for node in arrange(NODES, edges).nodes}
    assert places["table"][0] < places["cube_4"][0] < places["cube_3"][0]
    assert places["cube_4"][1] == places["cube_3"][1]


@pytest.mark.parametrize("count", [1, 6, 7, 20, 60])
def test_many_objects_do_not_overlap_and_stay_compact(count: int) -> None:
    cubes = [f"cube_{number}" for number in range(count)]
    edges = [("world", "camera", "RT"), *(("world", cube, "Virtual_RT") for cube in cubes)]
    drawing = arrange({"world": "world", "camera": "camera"} | dict.fromkeys(cubes, "cube"), edges)
    assert overlapping(drawing) == []
    assert max(node.at[1] for node in drawing.nodes) < 500


def test_the_drawing_does_not_depend_on_the_order() -> None:
    drawing = arrange(NODES, EDGES)
    again = arrange(dict(reversed(NODES.items())), EDGES[::-1])
    assert sorted(drawing.nodes) == sorted(again.nodes)
    assert drawing.edges == again.edges and drawing.labels == again.labels


def test_colours_say_the_type() -> None:
    drawing = arrange(NODES, EDGES)
    assert {node.color for node in drawing.nodes if node.name == "camera"} == {palette.NODE_TYPES["camera"]}
    for type in ("RT", "Virtual_RT", "on"):
        assert {edge.color for edge in drawing.edges if edge.key[2] == type} == {palette.EDGE_TYPES[type]}
        assert {label.color for label in drawing.labels if label.text == type} == {palette.EDGE_TYPES[type]}


@pytest.mark.parametrize(
    "edges",
    [
        [("a", "b", "RT"), ("b", "a", "RT")],
        [("a", "b", "on"), ("b", "a", "on")],
        [("a", "a", "next")],
        [("a", "b", "my_own_type"), ("b", "c", "my_own_type")],
        [],
    ],
)
def test_odd_graphs_are_drawn_too(edges: list[tuple[str, str, str]]) -> None:
    drawing = arrange({"a": "thing", "b": "thing", "c": "thing"}, edges)
    assert {node.name for node in drawing.nodes} == {"a", "b", "c"}
    assert sorted(edge.key for edge in drawing.edges) == sorted(edges)
    assert all(edge.path[0] != edge.path[-1] for edge in drawing.edges)


def test_an_empty_graph_is_an_empty_drawing() -> None:
    drawing = arrange({}, [])
    assert drawing.nodes == [] and drawing.edges == [] and drawing.labels == []


def test_a_chain_is_drawn_however_long_it_is() -> None:
    names = [f"link_{number}" for number in range(5000)]
    drawing = arrange(dict.fromkeys(names, "link"), [(*pair, "RT") for pair in itertools.pairwise(names)])
    assert len({node.at for node in drawing.nodes}) == 5000 and len(drawing.edges) == 4999
