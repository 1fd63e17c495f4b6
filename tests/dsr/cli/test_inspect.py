"""`dsr ls`, `dsr show`, `dsr tree`."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

import pytest

import dsr
from dsr import AttributeType, ConfigError, Memory, Pose
from dsr.cli import inspect


def test_ls_tells_where_things_were_perceived_and_are_believed_to_be(
    memory: Memory, cli_json: Callable[..., Any]
) -> None:
    assert [row["name"] for row in cli_json("ls")] == ["cube_3"]
    rows = {row["name"]: row for row in cli_json("ls", "--all")}
    assert set(rows) == {"world", "table", "camera_overhead", "cube_3"}
    assert rows["cube_3"]["perceived_at_m"] == pytest.approx([0.4, 0.0, 0.03])
    assert rows["cube_3"]["believed_at_m"] == pytest.approx([0.4, 0.0, 0.02])
    assert rows["table"]["believed_at_m"] is None
    assert rows["cube_3"]["attributes"] == ["perceived", "size"]
    assert rows["cube_3"]["notes"] == []
    memory.update_node("cube_3", perceived=False)
    while not (notes := next(row["notes"] for row in cli_json("ls") if row["name"] == "cube_3")):
        pass
    assert notes == ["not seen"]


def test_things_of_types_of_ones_own_are_listed(memory: Memory, cli_json: Callable[..., Any]) -> None:
    memory.schema.register_node_type("drone", "it flies")
    memory.add_node("drone_1", "drone")
    while [row["name"] for row in cli_json("ls")] != ["cube_3", "drone_1"]:
        pass


def test_ls_says_if_there_is_nothing_to_list(memory: Memory, cli: Callable[..., str]) -> None:
    assert cli("ls", "--type", "cup") == "there are no nodes of type cup\n"
    memory.remove_node("cube_3")
    while "no things" not in (text := cli("ls")):
        pass
    assert text == "there are no things\n3 other nodes: --all\n"


def test_ls_of_one_type_for_people(memory: Memory, cli: Callable[..., str]) -> None:
    text = cli("ls", "--type", "cube")
    assert "cube_3" in text and "0.0300" in text and "table" not in text


@pytest.mark.parametrize("columns", [80, 120])
def test_names_and_heights_are_whole_in_a_narrow_terminal(
    memory: Memory, cli: Callable[..., str], columns: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = "container_of_many_colours_1"
    memory.add_node(name, "container", perceived=False, surprising=True)
    for edge_type, z in (("RT", -12.3456), ("Virtual_RT", -65.4321)):
        memory.add_edge("world", name, edge_type, pose=dsr.Pose((-11.1111, -22.2222, z)))
    monkeypatch.setattr(inspect.console, "_width", columns)
    text = cli("ls")
    assert all(len(line) <= columns for line in text.splitlines())
    assert "-12.3456" in text and "-65.4321" in text and "3 other nodes: --all" in text
    assert name in "".join(line[1:].split(" ")[0] for line in text.splitlines())


def test_the_environment_may_name_the_graph(
    memory: Memory, cli_json: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DSR_GRAPH", "kitchen")
    with pytest.raises(ConfigError, match="no graph 'kitchen' runs on this machine"):
        cli_json("ls")
    monkeypatch.setenv("DSR_GRAPH", memory.graph_name)
    assert [row["name"] for row in cli_json("ls")] == ["cube_3"]


def test_an_unknown_type_is_an_error_with_the_valid_ones(memory: Memory, cli: Callable[..., str]) -> None:
    with pytest.raises(ConfigError, match="did you mean 'cube'"):
        cli("ls", "--type", "cubee")
    with pytest.raises(ConfigError, match="did you mean 'cube'"):
        cli("watch", "--type", "cubee")


def test_show_tells_attributes_with_units_and_edges(
    memory: Memory, cli: Callable[..., str], cli_json: Callable[..., Any]
) -> None:
    text = cli("show", "cube_3")
    assert "(0.04, 0.04, 0.04)" in text
    assert "camera_overhead --RT--> cube_3" in text
    shown = cli_json("show", "cube_3")
    assert shown["attributes"] == {"perceived": True, "size": [0.04, 0.04, 0.04]}
    assert {(edge["src"], edge["type"], edge["dst"]) for edge in shown["edges"]} == {
        ("cube_3", "on", "table"),
        ("camera_overhead", "RT", "cube_3"),
        ("world", "Virtual_RT", "cube_3"),
    }
    (belief,) = [edge for edge in shown["edges"] if edge["type"] == "Virtual_RT"]
    assert belief["attributes"]["pose"]["translation"] == [0.4, 0.0, 0.02]


def test_show_tells_what_was_written_with_units(memory: Memory, cli: Callable[..., str]) -> None:
    memory.schema.register_attribute("temperature", AttributeType("float", "K", "measured"))
    memory.update_node("table", temperature=293.15, target_pose=Pose((0.25, 0.0, 0.125)))
    memory.update_edge("cube_3", "table", "on", since=12.25)
    text = cli("show", "table")
    assert "293.15" in text and "quaternion" in text
    assert "cube_3 --on--> table  since 12.25 s" in text
    assert "edges; a pose is x y z in m, then the quaternion x y z w of its rotation" in text
    assert "pose (0.4, 0, 0.02) m, (0, 0, 0, 1) xyzw" in cli("show", "cube_3")


def test_show_of_an_unknown_node_suggests_one(memory: Memory, cli: Callable[..., str]) -> None:
    with pytest.raises(ConfigError, match="did you mean 'cube_3'"):
        cli("show", "cube3")


def test_tree_goes_from_the_world_down_to_the_cube(
    memory: Memory, cli: Callable[..., str], cli_json: Callable[..., Any]
) -> None:
    (world,) = cli_json("tree")
    assert [child["name"] for child in world["children"]] == ["camera_overhead", "table"]
    (cube,) = world["children"][0]["children"]
    assert (cube["name"], cube["edge"], cube["believed"], cube["relations"]) == ("cube_3", "RT", True, ["on table"])
    text = cli("tree")
    assert text.index("world") < text.index("camera_overhead") < text.index("cube_3")


def test_tree_shows_each_node_once_even_in_a_circle(memory: Memory, cli_json: Callable[..., Any]) -> None:
    memory.add_node("body", "body")
    memory.add_node("mind", "mind")
    memory.add_edge("body", "mind", "has")
    memory.add_edge("mind", "body", "has")

    def names(branches: list[dict[str, Any]]) -> list[str]:
        return [name for branch in branches for name in (branch["name"], *names(branch["children"]))]

    assert sorted(names(cli_json("tree"))) == sorted(node.name for node in memory.nodes())


def test_reading_a_graph_that_does_not_run_says_so_and_starts_none(cli: Callable[..., str]) -> None:
    with pytest.raises(ConfigError, match="no graph runs"):
        cli("ls")
    with pytest.raises(ConfigError, match="no graph 'kitchen' runs on this machine; running: none"):
        cli("ls", "--graph", "kitchen")


def test_the_graph_behind_a_router_must_be_named(cli: Callable[..., str], caplog: pytest.LogCaptureFixture) -> None:
    with pytest.raises(ConfigError, match=r"name one that is reached at tcp/127.0.0.1:1 with --graph"):
        cli("ls", "--connect", "tcp/127.0.0.1:1")
    with pytest.raises(ConfigError, match=r"nobody holds graph 'kitchen', or the router tcp/127.0.0.1:1 cannot be"):
        cli("ls", "--connect", "tcp/127.0.0.1:1", "--graph", "kitchen")
    assert not [record for record in caplog.records if record.levelno >= logging.WARNING]


def test_of_two_graphs_one_must_be_chosen(memory: Memory, cli: Callable[..., str]) -> None:
    with dsr.connect("other", agent="owner"):
        with pytest.raises(ConfigError, match=r"2 graphs run here: other, scene; name one with --graph$"):
            cli("ls")
        assert "cube_3" in cli("ls", "--graph", "scene")
