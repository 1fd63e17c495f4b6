"""`dsr parts`, and `--interest` of all commands: what is in parts of the graph is shown to who asks for it."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator

import pytest
from typer.testing import CliRunner

import dsr
from dsr import ConfigError, Memory, Pose
from dsr.cli.main import app
from dsr.connecting import INTEREST


@pytest.fixture
def house(monkeypatch: pytest.MonkeyPatch) -> Iterator[Memory]:
    monkeypatch.setenv(INTEREST, "")
    with dsr.connect("house", agent="owner", interest=(), must_exist=False) as memory:
        memory.add_node("world", "world")
        memory.create_part("kitchen", types=("ball",))
        memory.create_part("hall")
        memory.add_node("cup", "cube", "kitchen", mass=0.2)
        memory.add_edge("world", "cup", "RT", pose=Pose((1, 2, 3)))
        memory.leave_part("hall")
        yield memory


@pytest.mark.usefixtures("house")
def test_parts_are_listed_with_their_types_and_holders(cli: Callable[..., str]) -> None:
    rows = json.loads(cli("parts", "--json"))
    assert [(row["name"], row["types"], row["creator"], row["held_by"]) for row in rows] == [
        ("hall", [], "owner", []), ("kitchen", ["ball"], "owner", ["owner"]),
    ]  # fmt: skip
    assert "nobody" in cli("parts") and "ball" in cli("parts")


def test_a_graph_without_parts_says_so(memory: Memory, cli: Callable[..., str]) -> None:
    assert "there are no parts" in cli("parts")


@pytest.mark.usefixtures("house")
def test_what_is_in_a_part_is_shown_to_who_asks_for_it() -> None:
    def run(*arguments: str) -> tuple[str, str]:
        result = CliRunner().invoke(app, list(arguments), catch_exceptions=False)
        return result.stdout, result.stderr

    listed, told = run("ls", "--json")
    assert json.loads(listed) == [] and "without 2 parts of the graph: hall, kitchen" in told
    for interest in ("kitchen", "kitchen, hall", "*"):
        listed, told = run("--interest", interest, "ls", "--json")
        assert [row["name"] for row in json.loads(listed)] == ["cup"], interest
        assert ("without 1 part of the graph: hall" in told) == (interest == "kitchen")
        assert os.environ[INTEREST] == interest
    assert "mass" in run("show", "cup")[0] and "cup" in run("tree")[0]


@pytest.mark.usefixtures("house")
def test_wrong_names_are_told() -> None:
    for interest, said in (("cellar", "no part 'cellar'"), ("the kitchen", "'the kitchen'")):
        with pytest.raises(ConfigError, match=said):
            CliRunner().invoke(app, ["--interest", interest, "ls"], catch_exceptions=False)


def test_what_the_environment_names_is_held_by_all_who_are_told_no_other(
    house: Memory, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(INTEREST, " kitchen,cellar ")
    with dsr.connect("house", agent="a") as one, dsr.connect("house", agent="b", interest=()) as other:
        assert "cup" in one and one.interest == ("kitchen", "cellar") and "cup" not in other
    monkeypatch.setenv(INTEREST, "the kitchen")
    with pytest.raises(ConfigError, match="'the kitchen'"):
        dsr.connect("house", agent="c")
