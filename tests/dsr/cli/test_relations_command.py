"""`dsr relations`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from dsr import ConfigError, Memory, Pose


@pytest.fixture(autouse=True)
def scene(memory: Memory) -> None:
    memory.add_node("cube_4", "cube", size=(0.04, 0.04, 0.04))
    memory.add_edge("world", "cube_4", "Virtual_RT", pose=Pose((0.4, 0.05, 0.02)))


def test_relations_of_one_thing_for_programs(cli_json: Callable[..., Any]) -> None:
    rows = cli_json("relations", "cube_4", "--from", "world")
    assert {(row["relation"], row["source"], row["destination"]) for row in rows} == {
        ("next_to", "cube_4", "cube_3"), ("close_to", "cube_4", "cube_3"), ("left_of", "cube_4", "cube_3"),
        ("above", "cube_4", "table"), ("on_top", "cube_4", "table"), ("close_to", "cube_4", "table"),
    }  # fmt: skip
    assert all(row["margin_m"] >= 0.0 for row in rows)
    assert [row["relation"] for row in cli_json("relations", "cube_4", "-r", "next_to")] == ["next_to"]


def test_relations_of_all_for_people(cli: Callable[..., str]) -> None:
    text = cli("relations")
    rows = [line.split()[:3] for line in text.splitlines()]
    assert ["cube_3", "next_to", "cube_4"] in rows and ["cube_4", "left_of", "cube_3"] not in rows


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [(("nobody",), "nobody"), (("world",), "not known to be somewhere"), (("-r", "left"), "did you mean 'left_of'"),
     (("-r", "left_of"), "left_of depends on who looks: name a camera or frame with --from"),
     (("--from", "nobody"), "nobody"), (("--from", "cube_free"), "cube_free")],
)  # fmt: skip
def test_wrong_names_are_told(
    memory: Memory, cli: Callable[..., str], arguments: tuple[str, ...], expected: str
) -> None:
    memory.add_node("cube_free", "cube")
    with pytest.raises(ConfigError, match=expected):
        cli("relations", *arguments)


def test_relations_in_another_world(memory: Memory, cli_json: Callable[..., Any]) -> None:
    memory.fork("idea").add_edge("world", "cube_4", "Virtual_RT", pose=Pose((0.4, 0.5, 0.02)))
    assert cli_json("relations", "cube_4", "-r", "next_to", "--world", "idea") == []
    assert len(cli_json("relations", "cube_4", "-r", "next_to")) == 1
