"""`dsr visibility`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from dsr import ConfigError, Memory, Pose

Cli = Callable[..., Any]


def test_visibility_lists_who_sees_what(memory: Memory, cli: Cli, cli_json: Cli) -> None:
    memory.add_node("human_1", "person")
    memory.add_edge("world", "human_1", "RT", pose=Pose((-0.5, 0.0, 0.3)))
    memory.add_node("human_2", "person")
    memory.add_edge("world", "human_2", "RT", pose=Pose((-0.5, 0.0, 0.3), (0.0, 0.0, 1.0, 0.0)))
    rows = cli_json("visibility")
    assert {(row["perspective"], row["thing"], row["share"]) for row in rows} == {
        ("camera_overhead", "cube_3", 1.0), ("human_1", "cube_3", 1.0)
    }  # fmt: skip
    assert "human_1" in cli("visibility") and "100 %" in cli("visibility")
    everybody = cli_json("visibility", "--all", "--from", "human_2")
    assert [(row["perspective"], row["thing"], row["seen"]) for row in everybody] == [("human_2", "cube_3", False)]


def test_visibility_of_another_world(memory: Memory, cli_json: Cli) -> None:
    with pytest.raises(ConfigError, match="nowhere"):
        cli_json("visibility", "nowhere")
    idea = memory.fork("idea")
    idea.update_node("cube_3", present=False)
    assert cli_json("visibility", "idea") == []
    assert len(cli_json("visibility")) == 1
