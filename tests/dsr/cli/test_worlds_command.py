"""`dsr worlds`, and `--world` of the commands that look into a graph."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import dsr
from dsr import ConfigError, DsrError, Memory
from dsr.clock import WALL_CLOCK


def test_worlds_are_listed_with_where_they_come_from_and_how_large_they_are(
    memory: Memory, cli: Callable[..., str], cli_json: Callable[..., Any]
) -> None:
    memory.fork("idea").add_node("ball", "ball")
    memory.fork("view", follow=True)
    base, idea, view = cli_json("worlds")
    assert (base["name"], base["nodes"], base["parent"]) == ("base", 4, None)
    assert (idea["name"], idea["parent"], idea["follows"], idea["nodes"]) == ("idea", "base", False, 5)
    assert idea["creator"] == "owner" and idea["created"] > 0 and idea["held_by"] == 1
    assert (view["nodes"], view["follows"]) == (4, True)
    text = cli("worlds")
    assert "fork of base" in text and "follows base" in text


def test_worlds_are_deleted(memory: Memory, cli: Callable[..., str]) -> None:
    idea = memory.fork("idea")
    idea.fork("view", follow=True)
    with dsr.connect("scene", agent="other") as other:
        other.fork("left")
    for name, error in (("idaa", "did you mean 'idea'"), ("idea", "followed by view"), ("base", "cannot be deleted")):
        with pytest.raises(DsrError, match=error):
            cli("worlds", "--delete", name)
    cli("worlds", "--delete", "view", "--delete", "idea")
    assert json.loads(cli("worlds", "--delete", "left", "--json")) == [{"deleted": "left"}]
    assert memory.replica.wait_until(lambda: [world.name for world in memory.worlds()] == ["base"], 5.0)
    assert idea.closed


def test_other_worlds_are_looked_into_with_an_option(
    memory: Memory, cli: Callable[..., str], cli_json: Callable[..., Any], tmp_path: Path
) -> None:
    idea = memory.fork("idea")
    idea.remove_node("cube_3")
    idea.add_node("ball", "ball", mass=0.5)
    rows = cli_json("ls", "--all", "--world", "idea")
    assert {row["name"] for row in rows} == {"world", "table", "camera_overhead", "ball"}
    assert "0.5" in cli("show", "ball", "--world", "idea")
    assert "ball" in cli("tree", "-w", "idea") and "world idea" in cli("tree", "-w", "idea")
    file = tmp_path / "idea.json"
    cli("save", str(file), "--world", "idea")
    assert "ball" in {node["name"] for node in json.loads(file.read_text())["nodes"]}
    with pytest.raises(ConfigError, match="did you mean 'idea'"):
        cli("ls", "--world", "idae")


@pytest.mark.parametrize(
    "command",
    [("ls",), ("show", "cube_3"), ("tree",), ("watch",), ("save", "none.json"), ("visibility",), ("relations",),
     ("what-if",)],
)  # fmt: skip
def test_worlds_that_are_not_there_any_more_are_clear_errors(
    memory: Memory, cli: Callable[..., str], command: tuple[str, ...]
) -> None:
    memory.fork("gone")
    memory.delete_world("gone")
    with dsr.connect("scene", agent="other") as other:
        other.fork("left")
    option = [] if command == ("visibility",) else ["--world"]
    for world, error in (("gone", "no world 'gone'"), ("left", "world 'left' is listed, but nobody holds it")):
        with pytest.raises(ConfigError, match=error):
            cli(*command, *option, world)


def test_worlds_that_nobody_holds_are_listed_as_such(memory: Memory, cli_json: Callable[..., Any]) -> None:
    with dsr.connect("scene", agent="other") as other:
        other.fork("left")
    assert [(row["name"], row["held_by"]) for row in cli_json("worlds")] == [("base", 1), ("left", 0)]
    with pytest.raises(ConfigError, match="nobody holds it"):
        cli_json("diff", "base", "left")


def test_many_worlds_that_nobody_holds_take_no_longer_than_one(memory: Memory, cli_json: Callable[..., Any]) -> None:
    with dsr.connect("scene", agent="other") as other:
        for number in range(6):
            other.fork(f"left_{number}")
        other.fork("above", of="left_0", follow=True)
    memory.fork("idea")
    begin = WALL_CLOCK.monotonic()
    rows = cli_json("worlds")
    assert WALL_CLOCK.monotonic() - begin < 4.0
    assert {row["name"] for row in rows if row["held_by"]} == {"base", "idea"} and len(rows) == 9
