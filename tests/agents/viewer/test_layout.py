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


def reaches(drawing: Drawing, src: str, dst: str, type: str) -> bool:
    """Whether an arrow leads from `src` to `dst`, at once or through a box that is labelled with the type."""
    if (src, dst) in drawing.arrows:
        return type in ("RT", "next", "has")
    boxes = [box.id for box in drawing.boxes if box.label == type]
    return any((src, box) in drawing.arrows and (box, dst) in drawing.arrows for box in boxes)


def overlapping(drawing: Drawing) -> list[tuple[str, str]]:
    """Pairs of boxes that cover each other."""
    return [
        (a.id, b.id)
        for a, b in itertools.combinations(drawing.boxes, 2)
        if abs(a.y - b.y) < 30 and abs(a.x - b.x) < 7 * (len(a.label) + len(b.label)) / 2 + 10
    ]


def test_every_node_and_edge_is_drawn() -> None:
    drawing = arrange(NODES, EDGES)
    assert {box.id for box in drawing.boxes} >= set(NODES)
    assert all(reaches(drawing, *edge) for edge in EDGES)


def test_no_two_boxes_overlap() -> None:
    assert overlapping(arrange(NODES, EDGES)) == []


@pytest.mark.parametrize("count", [1, 6, 7, 20, 60])
def test_many_objects_do_not_overlap_and_stay_compact(count: int) -> None:
    cubes = [f"cube_{number}" for number in range(count)]
    edges = [("world", "camera", "RT"), *(("world", cube, "Virtual_RT") for cube in cubes)]
    drawing = arrange({"world": "world", "camera": "camera"} | dict.fromkeys(cubes, "cube"), edges)
    assert overlapping(drawing) == []
    assert max(box.y for box in drawing.boxes) < 500


def test_the_drawing_does_not_depend_on_the_order() -> None:
    drawing = arrange(NODES, EDGES)
    again = arrange(dict(reversed(NODES.items())), EDGES[::-1])
    assert sorted(drawing.boxes) == sorted(again.boxes)
    assert sorted(drawing.arrows) == sorted(again.arrows)


def test_colours_say_the_type() -> None:
    boxes = {box.id: box for box in arrange(NODES, EDGES).boxes}
    assert boxes["camera"].color == palette.NODE_TYPES["camera"]
    assert {box.color for box in boxes.values() if box.label == "Virtual_RT"} == {palette.BELIEF}
    assert {box.color for box in boxes.values() if box.label == "RT"} == {palette.PERCEPT}


def test_a_stack_has_a_box_for_each_support() -> None:
    edges = [*EDGES, ("cube_4", "cube_3", "on")]
    drawing = arrange(NODES, edges)
    assert sum(box.label == "on" for box in drawing.boxes) == 2
    assert all(reaches(drawing, *edge) for edge in edges)
    assert overlapping(drawing) == []


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
    assert {box.id for box in drawing.boxes} >= {"a", "b", "c"}
    assert all(reaches(drawing, *edge) for edge in edges)


def test_an_empty_graph_is_an_empty_drawing() -> None:
    assert arrange({}, []) == Drawing([], [])
