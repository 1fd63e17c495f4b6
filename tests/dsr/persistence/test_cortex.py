"""Files of CORTEX: what they say arrives, and comes out again as it was."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dsr import ConfigError, Pose
from dsr.persistence.content import GraphContent, NodeContent
from dsr.persistence.files import read_graph, write_graph
from tests.dsr.conftest import Net
from tests.dsr.persistence.graphs import contents

KITCHEN = Path(__file__).parent / "kitchen.cortex.json"
DERIVED = {"level", "parent"}


def symbols_of(file: Path) -> dict[str, Any]:
    symbols: dict[str, Any] = json.loads(file.read_text())["DSRModel"]["symbols"]
    return symbols


def number(value: Any) -> Any:
    """A number that may stand with a decimal comma."""
    try:
        return float(value.replace(",", ".")) if isinstance(value, str) else value
    except ValueError:
        return value


def same_value(code: int, a: Any, b: Any) -> bool:
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(same_value(code, x, y) for x, y in zip(a, b, strict=True))
    if code in (7, 9):
        return int(a) == int(b)
    return bool(number(a) == number(b) if code in (2, 3, 8, 10, 11, 12, 13) else a == b)


def is_geometric(attributes: dict[str, Any]) -> bool:
    """Whether they hold a pose."""
    values = [attributes.get(name, {}).get("value") for name in ("rt_translation", "rt_rotation_euler_xyz")]
    return all(isinstance(value, list) and len(value) == 3 and None not in value for value in values)


def assert_same_attributes(a: dict[str, Any], b: dict[str, Any]) -> None:
    assert a.keys() == b.keys()
    for name, one in a.items():
        other = b[name]
        assert one["type"] == other["type"], name
        if name == "rt_rotation_euler_xyz" and is_geometric(a):
            angles = [[number(x) for x in attribute[name]["value"]] for attribute in (a, b)]
            between = Rotation.from_euler("XYZ", angles[0]).inv() * Rotation.from_euler("XYZ", angles[1])
            assert between.magnitude() < 1e-6
        elif name == "rt_translation" and is_geometric(a):
            places = [[number(x) for x in attribute[name]["value"]] for attribute in (a, b)]
            assert places[0] == pytest.approx(places[1], rel=1e-15, abs=1e-300)
        else:
            assert same_value(one["type"], one["value"], other["value"]), name
        assert one.keys() == other.keys()


def assert_same_model(a: dict[str, Any], b: dict[str, Any]) -> None:
    """Whether two files mean the same, but for what is derived."""
    assert a.keys() == b.keys()
    for id, one in a.items():
        other = b[id]
        rest = [{k: v for k, v in s.items() if k not in ("attribute", "links", "id")} for s in (one, other)]
        assert rest[0] == rest[1]
        kept = [{k: v for k, v in s["attribute"].items() if k not in DERIVED} for s in (one, other)]
        assert_same_attributes(*kept)
        links = [{(str(link["dst"]), link["label"]): link for link in s["links"]} for s in (one, other)]
        assert links[0].keys() == links[1].keys()
        for key in links[0]:
            assert_same_attributes(links[0][key].get("linkAttribute", {}), links[1][key]["linkAttribute"])


def again(file: Path, folder: Path) -> dict[str, Any]:
    """What a file of CORTEX says after it went through our graph and our own file format."""
    write_graph(read_graph(file), folder / "ours.json")
    write_graph(read_graph(folder / "ours.json"), folder / "theirs.json", "cortex")
    return symbols_of(folder / "theirs.json")


def test_a_realistic_file_arrives(net: Net) -> None:
    memory = net.join("a")
    content = read_graph(KITCHEN)
    content.put_into(memory)
    assert {node.name: node.type for node in memory.nodes()} == {
        "world": "world", "Viriato_robot": "omnirobot", "arm": "arm", "camera": "rgbd",
    }  # fmt: skip
    robot, camera = memory.node("Viriato_robot"), memory.node("camera")
    assert (robot["mass"], robot["port"], robot["timestamp_alivetime"]) == (35.0, 12238, 1632484738373)
    assert json.loads(robot["cortex.robot_ids"]) == ["1", "18446744073709551615"]
    assert (camera["cam_rgb"], camera["cam_on"], camera["cam_focal"]) == (b"\x00\x7f\xff", True, 617.3)
    assert (camera["cam_limits"], camera["cam_future"]) == ((0.1, 8.0), "as it is")
    assert memory.node("world")["pos_x"] == 79.99
    assert memory.node("world")["cortex.color"] == '"SeaGreen"' and memory.node("arm")["color"] == (0.5, 0.5, 0.5)
    assert memory.edge("Viriato_robot", "Viriato_robot", "has")
    assert memory.edge("world", "Viriato_robot", "in_view_of")


def test_the_chain_of_a_realistic_file_is_in_metres(net: Net) -> None:
    memory = net.join("a")
    read_graph(KITCHEN).put_into(memory)
    world_from_robot = Pose((1.2505, -0.3, 0.0), Rotation.from_euler("z", 90, degrees=True).as_quat())
    assert memory.edge("world", "Viriato_robot", "RT").pose.distance(world_from_robot) == pytest.approx(
        (0, 0), abs=1e-9
    )
    about_x = np.diag([1.0, -1.0, -1.0])
    camera_in_world = world_from_robot.apply(np.array([0, 0, 0.9]) + about_x @ [0.01025, 0.0, -0.0513])
    assert memory.transform("world", "camera").translation == pytest.approx(camera_in_world)
    turned = about_x @ Rotation.from_rotvec([0.1, 0, 0]).as_matrix()
    turned = (
        turned @ Rotation.from_rotvec([0, math.pi / 2, 0]).as_matrix() @ Rotation.from_rotvec([0, 0, 0.3]).as_matrix()
    )
    assert memory.transform("Viriato_robot", "camera").rotation_matrix == pytest.approx(turned, abs=1e-7)


def test_each_name_beyond_the_schema_is_told_once(net: Net) -> None:
    warnings = read_graph(KITCHEN).warnings
    assert "node type 'omnirobot' is not in the schema: kept as a custom one" in warnings
    assert "edge type 'in view of' is not in the schema: kept as a custom one, called 'in_view_of'" in warnings
    assert "attribute 'port' is not in the schema: kept as a custom int" in warnings
    assert "attribute 'color': some values of type 0 are kept as text in 'cortex.color'" in warnings
    assert "node 'Viriato robot' is called 'Viriato_robot': ours have other names" in warnings
    assert len(warnings) == len(set(warnings))
    assert not any("'mass'" in warning or "'arm'" in warning for warning in warnings)


def test_a_realistic_file_comes_out_as_it_was(tmp_path: Path) -> None:
    exported = again(KITCHEN, tmp_path)
    assert_same_model(symbols_of(KITCHEN), exported)
    for id, symbol in symbols_of(KITCHEN).items():
        assert {name: symbol["attribute"][name] for name in DERIVED} == {
            name: exported[id]["attribute"][name] for name in DERIVED
        }


def test_it_comes_out_as_it_was_after_it_travelled(net: Net, tmp_path: Path) -> None:
    memory, peer = net.join("a"), net.join("b")
    read_graph(KITCHEN).put_into(memory)
    net.pump(2.0)
    write_graph(GraphContent.of(peer), tmp_path / "theirs.json", "cortex")
    assert_same_model(symbols_of(KITCHEN), symbols_of(tmp_path / "theirs.json"))


def test_what_changed_meanwhile_comes_out_changed(net: Net, tmp_path: Path) -> None:
    memory = net.join("a")
    read_graph(KITCHEN).put_into(memory)
    memory.update_edge("world", "Viriato_robot", "RT", translation=(1.0, 2.0, 0.5), rotation=(0, 0, 0, 1), stamp=7.5)
    memory.update_node("Viriato_robot", mass=36.5)
    memory.add_node("cup_1", "cup", note="new", mass=0.2, perceived=True)
    memory.add_edge("arm", "cup_1", "RT", pose=Pose((0.1, 0.0, 0.0)))
    memory.remove_node("camera")
    write_graph(GraphContent.of(memory), tmp_path / "theirs.json", "cortex")
    symbols = symbols_of(tmp_path / "theirs.json")
    robot = next(link for link in symbols["100"]["links"] if link["label"] == "RT")["linkAttribute"]
    assert robot["rt_translation"] == {"type": 3, "value": [1000.0, 2000.0, 500.0]}
    assert robot["rt_rotation_euler_xyz"]["value"] == pytest.approx([0, 0, 0])
    assert robot["rt_stamp"] == {"type": 8, "value": 7.5}
    assert symbols["200"]["attribute"]["mass"] == {"type": 2, "value": 36.5}
    cup = symbols["205"]
    assert cup["attribute"] == {
        "level": {"type": 1, "value": 3}, "parent": {"type": 7, "value": "204"}, "mass": {"type": 8, "value": 0.2},
        "note": {"type": 0, "value": "new"}, "perceived": {"type": 4, "value": True},
    }  # fmt: skip
    assert symbols.keys() == {"100", "200", "204", "205"}


# ---- generated files

BACKSLASH_FREE = st.text(st.characters(exclude_categories=["Cs"]), max_size=12)
THEIR_NAMES = st.one_of(
    st.sampled_from(["mass", "color", "size", "pose", "stamp", "rotation", "cortex", "cortex.color", "pos x", "pos_x"]),
    st.sampled_from(["rt_translation", "rt_rotation_euler_xyz", "rt_stamp", "rt_covariance", "width", "note", "since"]),
    BACKSLASH_FREE,
).filter(lambda name: name not in DERIVED)
FLOATS = st.one_of(
    st.floats(-1e6, 1e6),
    st.integers(-1000, 1000),
    st.decimals(-100, 100, places=3).map(lambda d: str(d).replace(".", ",")),
)
UINT64 = st.integers(0, (1 << 64) - 1).map(str)


def vector(length: int) -> st.SearchStrategy[list[Any]]:
    return st.lists(FLOATS, min_size=length, max_size=length)


CODES: dict[int, st.SearchStrategy[Any]] = {
    0: BACKSLASH_FREE, 1: st.integers(-(1 << 31), (1 << 31) - 1), 2: st.one_of(FLOATS, st.none()),
    3: st.lists(st.one_of(FLOATS, st.none()), max_size=4), 4: st.booleans(),
    5: st.lists(st.integers(0, 255), max_size=5), 6: st.integers(0, (1 << 32) - 1), 7: UINT64, 8: FLOATS,
    9: st.lists(UINT64, max_size=3), 10: vector(2), 11: vector(3), 12: vector(4), 13: vector(6), 99: BACKSLASH_FREE,
}  # fmt: skip
ATTRIBUTES = st.dictionaries(
    THEIR_NAMES,
    st.sampled_from(sorted(CODES)).flatmap(
        lambda code: st.fixed_dictionaries({"type": st.just(code), "value": CODES[code]})
    ),
    max_size=5,
)
ANGLES = st.one_of(
    st.floats(-7, 7), st.sampled_from([0, math.pi / 2, -math.pi / 2, math.pi, 1.5707963, "-1,5707963267948966"])
)
RT = st.fixed_dictionaries(
    {
        "rt_translation": st.fixed_dictionaries({"type": st.sampled_from([3, 11]), "value": vector(3)}),
        "rt_rotation_euler_xyz": st.fixed_dictionaries(
            {"type": st.sampled_from([3, 11]), "value": st.lists(ANGLES, min_size=3, max_size=3)}
        ),
    }
)


@st.composite
def models(draw: st.DrawFn) -> dict[str, Any]:
    """A file of CORTEX with all type codes, odd names, and several links between two nodes."""
    ids = draw(st.lists(UINT64, unique=True, max_size=4))
    names = draw(st.lists(st.one_of(BACKSLASH_FREE, st.just("a b"), st.just("a_b")), unique=True, min_size=len(ids)))
    symbols: dict[str, Any] = {}
    for id, name in zip(ids, names, strict=False):
        keys = st.tuples(st.sampled_from(ids), st.one_of(st.sampled_from(["RT", "Virtual_RT", "has"]), BACKSLASH_FREE))
        links = []
        for dst, label in draw(st.lists(keys, unique=True, max_size=4)):
            attributes = draw(ATTRIBUTES)
            if label == "RT" and draw(st.booleans()):
                attributes |= draw(RT)
            links.append({"src": id, "dst": dst, "label": label, "linkAttribute": attributes})
        type = draw(st.one_of(st.sampled_from(["world", "robot"]), BACKSLASH_FREE))
        symbols[id] = {"id": id, "name": name, "type": type, "attribute": draw(ATTRIBUTES), "links": links}
    return symbols


@settings(max_examples=100, deadline=None, suppress_health_check=list(HealthCheck))
@given(symbols=models())
def test_every_file_comes_out_as_it_was(tmp_path: Path, symbols: dict[str, Any]) -> None:
    file = tmp_path / "in.json"
    file.write_text(json.dumps({"DSRModel": {"symbols": symbols}}))
    assert_same_model(symbols, again(file, tmp_path))


@settings(max_examples=100, deadline=None, suppress_health_check=list(HealthCheck))
@given(content=contents())
def test_every_graph_of_ours_can_be_written_and_read_again(tmp_path: Path, content: GraphContent) -> None:
    write_graph(content, tmp_path / "theirs.json", "cortex")
    found = read_graph(tmp_path / "theirs.json")
    assert {name: node.type for name, node in found.nodes.items()} == {
        n: node.type for n, node in content.nodes.items()
    }
    assert found.edges.keys() == content.edges.keys()
    for key, values in content.edges.items():
        if key[2] == "RT":
            pose, was = found.edges[key]["pose"], values["pose"]
            assert isinstance(pose, Pose) and isinstance(was, Pose)
            assert pose.t == pytest.approx(was.t, rel=1e-12) and pose.distance(was)[1] < 1e-6
            assert (pose.stamp, pose.cov) == (was.stamp, was.cov)


@pytest.mark.parametrize("number", ["NaN", "-Infinity", "1e999"])
def test_numbers_that_are_not_finite_become_null(tmp_path: Path, number: str) -> None:
    file = tmp_path / "in.json"
    symbol = {"id": "1", "name": "a", "type": "b", "attribute": {"a": {"type": 3, "value": [1.5, "?"]}}}
    file.write_text(json.dumps({"DSRModel": {"symbols": {"1": symbol}}}).replace('"?"', number))
    assert again(file, tmp_path)["1"]["attribute"]["a"] == {"type": 3, "value": [1.5, None]}


def test_text_that_is_nested_too_deeply_to_be_written_is_told(tmp_path: Path) -> None:
    content = GraphContent("")
    deep = "[" * 900 + "]" * 900
    note = {"attributes": {"note": {"code": 77, "text": True}}}
    content.nodes["a"] = NodeContent("cube", {"note": deep, "cortex": json.dumps(note)})
    with pytest.raises(ConfigError, match="nested too deeply"):
        write_graph(content, tmp_path / "out.json", "cortex")
    assert not list(tmp_path.iterdir())


# ---- mistakes


@pytest.fixture
def edited(tmp_path: Path) -> Callable[..., str]:
    """What reading the kitchen says after some text was replaced."""

    def error_after(old: str, new: str) -> str:
        assert old in KITCHEN.read_text()
        file = tmp_path / "k.json"
        file.write_text(KITCHEN.read_text().replace(old, new, 1))
        with pytest.raises(ConfigError) as caught:
            read_graph(file)
        return str(caught.value).replace(f"{file}:", "")

    return error_after


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"dst": "204"', '"dst": "240"',
         '47:32: DSRModel.symbols["200"].links[0].dst: no node \'240\' in this file; valid: '),
        ('"src": "204"', '"src": "200"', "links[0].src: src '200' of a link that stands with node '204'"),
        ('"label": "in view of"', '"label": "RT"', "links[1]: a second 'RT' link to '200'"),
        ('"id": "204"', '"id": "205"', "id '205' under '204'"),
        ('"name": "arm"', '"name": "world"', "a second node is called 'world'"),
        ('"name": "arm",', '', "object missing required field `name`"),
        ('{"type": 6, "value": 12238}', '{"type": 6, "value": "x"}',
         '40:50: DSRModel.symbols["200"].attribute.port.value: expected an integer, got \'x\' (type 6)'),
        ('{"type": 6, "value": 12238}', '{"type": 6}', "attribute.port: object missing required field `value`"),
        ('{"type": 6, "value": 12238}', '6', "attribute.port: expected an object with type, value"),
        ('"type": 10, "value": [0.1, 8]', '"type": 10, "value": [0.1]', "expected a list of 2 numbers, got [0.1]"),
        ('[0, 127, 255]', '[0, 127, 256]', "expected a list of integers from 0 to 255"),
        ('{"type": 6, "value": 12238}', '{"type": "6", "value": 1}', "attribute.port.type: expected `int`, got `str`"),
        ('{"type": 6, "value": 12238}', '{"type": 7, "value": "+-5"}', "expected an integer, got '+-5' (type 7)"),
        ('{"type": 6, "value": 12238}', f'{{"type": 7, "value": "{"9" * 5000}"}}', "expected an integer, got '999"),
        ('"name": "arm"', r'"name": "\ud800"', r'''["204"].name: '\ud800' holds half of a surrogate pair'''),
        ('"value": true', '"value": "on"', "expected true or false, got 'on'"),
        ('"value": 617.3', '"value": "6.1.7"', "expected a number, got '6.1.7'"),
        ('"symbols": {', '"symbol": {', 'DSRModel: expected an object with "symbols"'),
    ],
)  # fmt: skip
def test_a_mistake_is_told_with_its_place(edited: Callable[..., str], old: str, new: str, message: str) -> None:
    assert message in edited(old, new)


def test_a_value_that_no_graph_holds_is_told(edited: Callable[..., str]) -> None:
    message = edited("[0, 127, 255]", str([1] * ((1 << 20) + 1)))
    assert "attribute.cam_rgb: larger than a value may be (1048576 characters)" in message
    assert len(message) < 300
