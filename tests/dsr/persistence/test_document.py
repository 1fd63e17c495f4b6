"""Graph files of our own: they round-trip, a person can edit them, and every mistake is told with its place."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings

from dsr import ConfigError, Memory, Pose
from dsr.graph.schema import AttributeType, Schema
from dsr.persistence.content import GraphContent
from dsr.persistence.document import to_document
from dsr.persistence.files import read_graph, write_graph
from dsr.persistence.json_text import MAX_BYTES
from tests.dsr.conftest import Net
from tests.dsr.persistence.graphs import contents

BREAKFAST = Path(__file__).parents[3] / "etc" / "graphs" / "breakfast.json"


@pytest.fixture
def edited(tmp_path: Path) -> Callable[..., str]:
    """What reading the breakfast says after some text was replaced."""

    def error_after(old: str, new: str) -> str:
        text = BREAKFAST.read_text()
        assert old in text
        file = tmp_path / "scene.json"
        file.write_text(text.replace(old, new, 1))
        with pytest.raises(ConfigError) as caught:
            read_graph(file)
        return str(caught.value).replace(f"{file}:", "")

    return error_after


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=contents())
def test_every_graph_comes_back_exactly(tmp_path: Path, content: GraphContent) -> None:
    file = tmp_path / "g.json"
    write_graph(content, file)
    again = read_graph(file)
    assert again.nodes == content.nodes and again.edges == content.edges and again.graph == "g"
    assert repr(again.nodes) == repr({name: again_sorted(content, name) for name in sorted(content.nodes)})
    assert to_document(again) == file.read_text()


def again_sorted(content: GraphContent, name: str) -> Any:
    """A node with its attributes in the order of a file; its `repr` tells -0.0 from 0.0."""
    node = content.nodes[name]
    return node._replace(attributes=dict(sorted(node.attributes.items())))


def test_a_graph_written_by_hand_is_put_into_a_memory(net: Net) -> None:
    memory = net.join("a")
    read_graph(BREAKFAST).put_into(memory)
    assert {node.name: node.type for node in memory.nodes()} == {
        "world": "world", "table": "table", "plate_1": "plate", "cup_1": "cup", "camera_overhead": "camera",
    }  # fmt: skip
    assert memory.node("cup_1")["fill_level"] == 0.5
    assert memory.transform("world", "cup_1").t == pytest.approx((0.6, 0.15, 0.75))
    assert memory.edge("cup_1", "table", "on")["source"] == "setup"


def test_the_example_looks_as_it_is_written(tmp_path: Path) -> None:
    """Reading and writing it changes the order and fills in what may be left out, and then nothing more."""
    first, second = tmp_path / "1.json", tmp_path / "2.json"
    write_graph(read_graph(BREAKFAST), first)
    write_graph(read_graph(first), second)
    assert first.read_bytes() == second.read_bytes()
    assert '"attributes": {"size": [1.2, 0.8, 0.04]' in BREAKFAST.read_text()
    assert '{"name": "table", "type": "table", "attributes": {"color": [0.6, 0.4, 0.2], "size": [1.2, 0.8, 0.04]}}' in (
        first.read_text()
    )


def test_the_file_that_the_documentation_shows_is_read(tmp_path: Path) -> None:
    text = (Path(__file__).parents[3] / "docs/how-to/persistence.md").read_text()
    (tmp_path / "shown.json").write_text(text.split("```json\n")[1].split("```")[0])
    assert read_graph(tmp_path / "shown.json").nodes["cup_1"].attributes["fill_level"] == 0.5


def test_names_that_only_their_writer_registered_are_described_by_their_values(net: Net, tmp_path: Path) -> None:
    writer, reader = net.join("writer"), net.join("reader")
    writer.schema.register_node_type("drawer", "can be opened")
    writer.schema.register_edge_type("Assumed_RT", "guessed", geometric=True)
    values: dict[str, Any] = {
        "is_open": True, "count": 3, "depth": 0.5, "label": "cups", "code": b"\x00\xff", "axis": (0.0, 1.0),
        "goal_pose": Pose((1.0, 2.0, 3.0), stamp=4.0),
    }  # fmt: skip
    kinds = ("bool", "int", "float", "str", "bytes", "vector", "pose")
    for name, kind in zip(values, kinds, strict=True):
        writer.schema.register_attribute(name, AttributeType(kind))
    writer.add_node("d", "drawer", **values)
    writer.add_node("world", "world")
    writer.add_edge("world", "d", "Assumed_RT", pose=Pose((0.1, 0.0, 0.0)))
    net.pump(2.0)
    file = tmp_path / "g.json"
    write_graph(GraphContent.of(reader), file)
    again = read_graph(file)
    assert again.nodes["d"].attributes == values
    assert "Assumed_RT" in again.schema.geometric and not again.warnings


def test_a_value_that_no_schema_could_read_back_is_left_out_with_a_warning(net: Net) -> None:
    """Two agents gave one name different kinds."""
    memory, other = net.join("a"), net.join("b")
    memory.schema.register_attribute("level", AttributeType("float"))
    other.schema.register_attribute("level", AttributeType("str"))
    for name in ("cup_1", "cup_2"):
        memory.add_node(name, "cup", level=0.5)
    other.add_node("cup_3", "cup", level="half")
    net.pump(2.0)
    content = GraphContent.of(memory)
    assert content.warnings == ["cup 'cup_3': left out: attribute 'level': expected a finite float, got 'half'"]
    assert content.nodes["cup_3"].attributes == {}


def test_loading_adds_and_updates_and_leaves_the_rest(net: Net) -> None:
    memory = net.join("a")
    memory.add_node("cup_1", "cup", mass=9.0, note="mine")
    memory.add_node("ball_1", "ball")
    read_graph(BREAKFAST).put_into(memory)
    assert dict(memory.node("cup_1")) == {"mass": 0.2, "fill_level": 0.5, "note": "mine", "size": (0.08, 0.08, 0.1)}
    assert "ball_1" in memory


def test_replacing_removes_what_the_file_lacks(net: Net) -> None:
    memory, peer = net.join("a"), net.join("b")
    memory.add_node("cup_1", "ball", note="another type")
    memory.add_node("ball_1", "ball")
    memory.add_node("table", "table", note="gone afterwards")
    memory.add_edge("ball_1", "table", "on")
    content = read_graph(BREAKFAST)
    content.put_into(memory, replace=True)
    net.pump(2.0)
    for replica in (memory, peer):
        found = GraphContent.of(replica)
        assert found.nodes == content.nodes and found.edges == content.edges


def test_a_node_of_another_type_is_not_overwritten(net: Net) -> None:
    memory = net.join("a")
    memory.add_node("cup_1", "ball")
    with pytest.raises(ConfigError, match="nodes of other types: 'cup_1' is a ball, not a cup"):
        read_graph(BREAKFAST).put_into(memory)
    assert "table" not in memory


def test_a_custom_name_of_another_kind_is_refused_before_anything_is_written(net: Net) -> None:
    memory = net.join("a")
    memory.schema.register_attribute("fill_level", AttributeType("str"))
    with pytest.raises(ConfigError, match="'fill_level' is already a str, not a float"):
        read_graph(BREAKFAST).put_into(memory)
    assert memory.nodes() == []


@pytest.mark.parametrize(
    ("known", "said"),
    [
        (lambda schema: schema.register_attribute("battery", AttributeType("float", "%")), "already a float in %"),
        (lambda schema: schema.register_edge_type("tether", "a rope"), "'tether' is already one that is not geometric"),
    ],
)
def test_a_custom_name_of_another_meaning_is_refused_too(net: Net, known: Callable[[Schema], None], said: str) -> None:
    """A charge in V is not one in %: the values would be taken for what they are not."""
    content = GraphContent("g")
    content.schema.register_attribute("battery", AttributeType("float", "V"))
    content.schema.register_edge_type("tether", "pose of what hangs on it", geometric=True)
    memory = net.join("a")
    known(memory.schema)
    with pytest.raises(ConfigError, match=said):
        content.put_into(memory)


def test_a_large_graph_reaches_a_peer_complete(net: Net) -> None:
    content = GraphContent("g")
    memory: Memory = net.join("a")
    for number in range(1200):
        memory.add_node(f"cube_{number}", "cube", size=(0.04, 0.04, 0.04), mass=float(number))
    content = GraphContent.of(memory)
    net.memories.clear()
    other, peer = net.join("b"), net.join("c")
    content.put_into(other)
    net.pump(2.0)
    assert GraphContent.of(peer).nodes == content.nodes


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"type": "cup",', '"type": "cpu",',
         "13:5: nodes[3]: node 'cup_1': unknown node type 'cpu'; did you mean 'cup'?"),
        ('"mass": 0.2', '"mas": 0.2',
         "13:87: nodes[3].attributes.mas: unknown attribute 'mas'; did you mean 'mass'?"),
        ('"mass": 0.2', '"mass": "0.2"',
         "nodes[3].attributes.mass: attribute 'mass': expected a finite float in kg, got '0.2'"),
        ('"mass": 0.2', '"mass": NaN', "expected a finite float in kg, got nan"),
        ('"mass": 0.2', '"mass": 1e999', "expected a finite float in kg, got inf"),
        ('"mass": 0.2', f'"mass": {"9" * 400}', "expected a finite float in kg, got 999"),
        ('"mass": 0.2', r'"mass": "\ud800"', r"nodes[3].attributes.mass: '\ud800' holds half of a surrogate pair"),
        ('"mass": 0.2', r'"\ud800": 0.2', r"'\ud800' holds half of a surrogate pair"),
        ('[1.2, 0.8, 0.04]', '[1.2, 0.8]', "attribute 'size': expected a finite vector of 3 in m, got [1.2, 0.8]"),
        ('"width": 640', '"width": 640.5', "attribute 'width': expected a finite int in px, got 640.5"),
        ('"dst": "cup_1"', '"dst": "cpu_1"',
         "edges[2].dst: no node 'cpu_1' in this file; did you mean 'cup_1'?"),
        ('"type": "on"', '"type": "onn"', "edges[4].type: unknown edge type 'onn'; did you mean 'on'?"),
        ('"rotation": [1.0,', '"rotation": [2.0,',
         "edges[3].attributes.pose: rotation (2.0, 0.0, 0.0, 0.0): norm 2, expected 1 within 0.001"),
        ('"rotation": [1.0,', '"rotaton": [1.0,',
         "edges[3].attributes.pose.rotaton: unknown field 'rotaton'; did you mean 'rotation'?"),
        ('{"translation": [0.5, 0.0, 0.7]}', '[0.5, 0.0, 0.7]', "edges[0].attributes.pose: expected `object`"),
        ('{"translation": [0.5, 0.0, 0.7]}', '{"translation": [0.5, 0.0]}', "[0.5, 0.0]: expected 3 finite"),
        ('{"translation": [0.5, 0.0, 0.7]}', '{}', "pose: object missing required field `translation`"),
        ('"name": "plate_1"', '"name": "cup_1"', "nodes[3].name: a second node is called 'cup_1'"),
        ('"name": "cup_1"', '"name": "the cup"', "node name 'the cup': expected 1 to 128 letters"),
        ('"name": "cup_1"', '"nme": "cup_1"', "nodes[3].nme: unknown field 'nme'; did you mean 'name'?"),
        ('"src": "plate_1", "dst": "table", "type": "on"', '"src": "cup_1", "dst": "table", "type": "on"',
         "edges[5]: a second on edge from 'cup_1' to 'table'"),
        ('"name": "world", ', '"name": "world", "name": "earth", ', "10:14: nodes[0].name: stands here twice"),
        ('"kind": "float"', '"kind": "double"', "7:43: schema.attributes.fill_level.kind: invalid enum value 'double'"),
        ('"kind": "float",', '"kind": "bytes",', "nodes[3].attributes.fill_level: expected `object`, got `float`"),
        ('"fill_level": {"kind"', '"mass": {"kind": "str"}, "fill_level": {"kind"',
         "schema.attributes.mass: attribute 'mass' is already a float in kg, not a str"),
        ('"dsr-graph"', '"dsr-grpah"', "2:13: format: format 'dsr-grpah': this program reads 'dsr-graph'"),
        ('"version": 1', '"version": 2', "3:14: version: version 2: this program reads 1"),
        ('"nodes": [', '"nodes": 3, "ndes": [', "unknown field 'ndes'; did you mean 'nodes'?"),
        ('"format"', '"fromat"', 'expected a graph: an object with "format": "dsr-graph"'),
        ('{"name": "world", "type": "world"}', '7', "nodes[0]: expected `object`, got `int`"),
        ('"name": "world",', '"name": "world"', "10:22: not valid JSON: Expecting ',' delimiter"),
    ],
)  # fmt: skip
def test_a_mistake_is_told_with_its_place(edited: Callable[..., str], old: str, new: str, message: str) -> None:
    assert message in edited(old, new)


def test_base64_that_is_none_is_told(tmp_path: Path) -> None:
    file = tmp_path / "g.json"
    data = {
        "format": "dsr-graph", "version": 1, "schema": {"attributes": {"code": {"kind": "bytes"}}},
        "nodes": [{"name": "a", "type": "cube", "attributes": {"code": {"base64": "a"}}}],
    }  # fmt: skip
    file.write_text(json.dumps(data))
    with pytest.raises(ConfigError, match=r"nodes\[0\].attributes.code: not valid base64"):
        read_graph(file)


def test_several_problems_are_told_at_once_in_the_order_of_the_file(tmp_path: Path) -> None:
    file = tmp_path / "scene.json"
    file.write_text(BREAKFAST.read_text().replace('"mass": 0', '"mas": 0').replace('"dst": "table"', '"dst": "tabel"'))
    with pytest.raises(ConfigError) as caught:
        read_graph(file)
    lines = str(caught.value).splitlines()
    assert len(lines) == 5
    assert [line.split(":")[1] for line in lines] == ["12", "13", "21", "30", "31"]


def test_a_wrong_node_is_not_missed_by_its_edges(tmp_path: Path) -> None:
    file = tmp_path / "scene.json"
    file.write_text(BREAKFAST.read_text().replace('{"name": "table",', '{"name": "table", "colour": 1,'))
    with pytest.raises(ConfigError) as caught:
        read_graph(file)
    assert "unknown field 'colour'" in str(caught.value) and len(str(caught.value).splitlines()) == 1


def test_of_many_problems_only_the_first_are_told(tmp_path: Path) -> None:
    file = tmp_path / "scene.json"
    nodes = [{"name": f"cube_{number}", "type": "cbe"} for number in range(50)]
    file.write_text(json.dumps({"format": "dsr-graph", "version": 1, "nodes": nodes}))
    with pytest.raises(ConfigError) as caught:
        read_graph(file)
    assert str(caught.value).endswith(f"{file}: and more; this file was read no further")


@pytest.mark.parametrize("length", [0, 1, 20, 500, 1500])
def test_a_truncated_file_is_told_with_line_and_column(tmp_path: Path, length: int) -> None:
    file = tmp_path / "scene.json"
    file.write_text(BREAKFAST.read_text()[:length])
    with pytest.raises(ConfigError, match=r"scene.json:\d+:\d+: not valid JSON"):
        read_graph(file)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"\x89PNG\r\n\x1a\n\x00", r"is no UTF-8 text \(byte 0 is 0x89\)"),
        (b"[" * 100_000, "nested too deeply"),
        (b"[" * 101 + b"]" * 101, "nested too deeply"),
        (b"1" * 5000, "not valid JSON: an integer of thousands of digits"),
        (b"[]", "expected a graph"),
        (b'"text"', "expected a graph"),
    ],
)
def test_what_is_no_graph_file_is_told(tmp_path: Path, content: bytes, message: str) -> None:
    file = tmp_path / "file"
    file.write_bytes(content)
    with pytest.raises(ConfigError, match=message):
        read_graph(file)


def test_what_cannot_be_read_is_told(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.json: cannot be read: No such file"):
        read_graph(tmp_path / "none.json")
    with pytest.raises(ConfigError, match="cannot be read: Is a directory"):
        read_graph(tmp_path)
    huge = tmp_path / "huge.json"
    with huge.open("wb") as file:
        file.truncate(MAX_BYTES + 1)
    with pytest.raises(ConfigError, match=f"has {MAX_BYTES + 1} bytes"):
        read_graph(huge)


def test_a_byte_order_mark_is_read_over(tmp_path: Path) -> None:
    file = tmp_path / "scene.json"
    file.write_bytes(b"\xef\xbb\xbf" + BREAKFAST.read_bytes())
    assert "cup_1" in read_graph(file).nodes


def test_only_regular_files_are_replaced_and_links_stay(tmp_path: Path) -> None:
    content, pipe, link = read_graph(BREAKFAST), tmp_path / "pipe", tmp_path / "link.json"
    os.mkfifo(pipe)
    with pytest.raises(ConfigError, match="pipe: cannot be written: is no regular file"):
        write_graph(content, pipe)
    assert pipe.is_fifo()
    link.symlink_to("scene.json")
    write_graph(content, link)
    assert link.is_symlink() and read_graph(tmp_path / "scene.json").nodes == content.nodes


def test_a_file_that_cannot_be_written_leaves_the_old_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "scene.json"
    file.write_text("old")

    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(ConfigError, match=r"scene\.json: cannot be written: No space left on device"):
        write_graph(read_graph(BREAKFAST), file)
    assert [path.name for path in tmp_path.iterdir()] == ["scene.json"] and file.read_text() == "old"
