"""Drawings of graphs: complete, the same for the same graph, without overlap."""

from __future__ import annotations

import itertools

import pytest

from agents.viewer import palette
from agents.viewer.layout import Drawing, arrange, in_two_lines

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


@pytest.mark.parametrize("name", ["a²", "²", "٣", "9" * 250, "1a1", ""])
def test_a_name_with_any_digits_is_drawn(name: str) -> None:
    assert {node.name for node in arrange({**NODES, name: "cube"}, EDGES).nodes} == {*NODES, name}


def test_no_two_labels_overlap() -> None:
    assert overlapping(arrange(NODES, EDGES)) == []


def test_everything_is_in_the_frame_with_its_label() -> None:
    drawing = arrange(NODES, EDGES, {"cube_4": "a cube with a long name"})
    (left, top), (right, bottom) = drawing.frame
    for node in drawing.nodes:
        half = 7 * len(node.label) / 2
        assert left < node.at[0] - half and node.at[0] + half < right
        assert top < node.at[1] and node.at[1] + 30 < bottom


def test_long_names_take_two_lines_where_one_would_be_too_wide() -> None:
    """As wide as the view in a small window, the labels of what hangs on an arm do not touch; no letter is missing."""
    chain = ["mobile_base_footprint", "arm_shoulder_mount", "robotiq_85_left_knuckle", "camera_color_optical_frame"]
    boxes = [f"breakfast_cereal_package_{number}" for number in range(4)]
    nodes = {"world": "world"} | dict.fromkeys(chain, "body") | dict.fromkeys(boxes, "box")
    edges = [(a, b, "RT") for a, b in itertools.pairwise(["world", *chain])]
    edges += [(chain[-1], box, "RT") for box in boxes] + [("world", box, "Virtual_RT") for box in boxes]
    drawing = arrange(nodes, edges)
    (left, top), (right, bottom) = drawing.frame
    scale = min(1.0, 800.0 / (right - left), 290.0 / (bottom - top))
    for a, b in itertools.combinations(drawing.nodes, 2):
        apart = scale * abs(a.at[0] - b.at[0]) - 7 * (widest(a.label) + widest(b.label)) / 2
        rows = a.label.count("\n") + 1 if a.at[1] < b.at[1] else b.label.count("\n") + 1
        assert apart > 0 or scale * abs(a.at[1] - b.at[1]) > 16 * rows, (a.label, b.label)
    assert {node.name: node.label.replace("\n", "") for node in drawing.nodes} == {name: name for name in nodes}
    assert max(node.label.count("\n") for node in drawing.nodes) == 1


def widest(label: str) -> int:
    """Letters of the longest line."""
    return max(map(len, label.split("\n")))


@pytest.mark.parametrize(
    ("label", "lines"),
    [
        ("camera_wrist", ["camera_wrist"]),
        ("camera_overhead", ["camera_", "overhead"]),
        ("wrist_camera_color_optical", ["wrist_camera_", "color_optical"]),
        ("arm_of_the_left (7 links)", ["arm_of_the_", "left (7 links)"]),
        ("intention_of_mine (1 done)", ["intention_of_", "mine (1 done)"]),
        ("thenameofathingofonewordonly", ["thenameofathingofonewordonly"]),
        ("a_name_that_ends_so_", ["a_name_that_", "ends_so_"]),
    ],
)
def test_a_long_label_is_broken_between_words_near_its_middle(label: str, lines: list[str]) -> None:
    assert in_two_lines(label).split("\n") == lines


def test_names_of_a_drawing_that_fits_stay_on_one_line() -> None:
    assert not any("\n" in node.label for node in arrange(NODES, EDGES).nodes)


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
