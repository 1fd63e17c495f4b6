"""`dsr where` of a recording at a time, of a saved graph, and of what nobody knows."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

import dsr
from agents.replay.where_cli import app
from dsr import Alternative, LocalNetwork, Memory, Pose, Whereabouts
from dsr.believing.distribution import ATTRIBUTE, encoded
from dsr.cli.common import console
from dsr.persistence.content import GraphContent
from dsr.persistence.files import write_graph


@pytest.fixture(autouse=True)
def wide(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(console, "width", 200)


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    """A graph with a ball in a cup or in a hand, and a cube that was never seen."""
    memory = Memory("table", "me", transport=LocalNetwork().connect("me"))
    memory.add_node("world", "world")
    for name, kind in (("ball", "ball"), ("cup", "cup"), ("cube_1", "cube")):
        memory.add_node(name, kind)
    memory.add_node("table", "table")
    memory.add_edge("world", "table", "RT", pose=Pose((0.4, 0.0, 0.0)))
    memory.add_edge("world", "ball", "Virtual_RT", pose=Pose((0.3, 0.1, 0.05)))
    alternatives = (
        Alternative(weight=0.8, pose=Pose((0.3, 0.1, 0.05)), containers=("cup",)),
        Alternative(weight=0.2, pose=Pose((0.7, 0.0, 0.4)), hand="hand_0", reason="taken", worlds=(1,)),
    )
    memory.update_node("ball", **{ATTRIBUTE: encoded(Whereabouts("ball", alternatives, ("ball",), (0.8, 0.2)))})
    file = tmp_path / "table.json"
    write_graph(GraphContent.of(memory), file)
    return file


def run(*arguments: str) -> Any:
    return CliRunner().invoke(app, list(arguments), catch_exceptions=False)


def test_all_places_are_listed_with_their_probability(saved: Path) -> None:
    shown = run("ball", str(saved))
    assert shown.exit_code == 0
    rows = [line.split("  ") for line in shown.stdout.splitlines() if "%" in line]
    assert len(rows) == 2 and "80 %" in shown.stdout and "in hand_0, at x 0.70 m, y 0.00 m" in shown.stdout
    found = json.loads(run("BALL", str(saved), "--json").stdout)
    assert [row["probability"] for row in found] == [0.8, 0.2] and found[1]["reason"] == "taken"


def test_what_nobody_knows_exits_1_and_what_nobody_has_is_an_error(saved: Path) -> None:
    unknown = run("cube_1", str(saved))
    assert unknown.exit_code == 1 and "Nobody knows where cube_1 is." in unknown.stdout
    assert run("cube_1", str(saved), "--json").stdout.strip() == "[]"
    with pytest.raises(dsr.ConfigError, match="nothing is called 'bal'; did you mean 'ball'"):
        run("bal", str(saved))


def test_a_place_that_the_belief_does_not_weigh_is_told(saved: Path) -> None:
    table = run("table", str(saved))
    assert table.exit_code == 1
    assert "table is at x 0.40 m, y 0.00 m" in table.stdout
    assert "does not weigh where else table could be" in table.stdout
    (row,) = json.loads(run("table", str(saved), "--json").stdout)
    assert row["probability"] is None and row["place"] == [0.4, 0.0, 0.0] and row["rotation"] == [0.0, 0.0, 0.0, 1.0]


def test_a_recording_is_asked_as_of_a_time(hovering: Path) -> None:
    (row, *_) = json.loads(run("cube_3", str(hovering), "--at", "6", "--json").stdout)
    assert row["probability"] > 0.5 and row["place"] is not None
    with pytest.raises(dsr.ConfigError, match="--at 9999"):
        run("cube_3", str(hovering), "--at", "9999")
