"""`dsr days`, and times in words of `dsr tell` and `dsr ask`, of a running graph and of one that was saved."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

import dsr
from agents.replay import ask_cli, days_cli, tell_cli
from dsr import ConfigError, Memory
from dsr.cli.common import console
from dsr.clock import WALL_CLOCK
from dsr.timeline import SUMMARY, Chronicle, Consolidator

DAY = 86400.0


@pytest.fixture
def memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Memory]:
    """A kitchen in which the cup was on the shelf from two days ago until an hour ago, and ben moved it yesterday."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "runtime"))
    (tmp_path / "runtime").mkdir()
    monkeypatch.setattr(console, "width", 200)
    now = WALL_CLOCK.now()
    with dsr.connect("kitchen", agent="chronicler", must_exist=False) as memory:
        for name, kind in (("world", "world"), ("cup", "cup"), ("shelf", "table")):
            memory.add_node(name, kind)
        chronicle = Chronicle(memory)
        stay = chronicle.begin("on", ("cup", "shelf"), now - 2.0 * DAY, source="contact")
        chronicle.end(stay, now - 3700.0)
        chronicle.happened("Pick", ("cup", "ben"), now - DAY)
        chronicle.happened("explained", "cup", now - DAY, explanation="moved(cup)")
        Consolidator(memory).consolidate()
        chronicle.forget()
        yield memory


def run(app: Any, *arguments: str) -> Any:
    return CliRunner().invoke(app, list(arguments), catch_exceptions=False)


def test_what_is_remembered_of_each_period(memory: Memory) -> None:
    rows = json.loads(run(days_cli.app, "--json").stdout)
    assert {row["level"] for row in rows} == {"hour"} and sum(row["remembered"] for row in rows) == 3
    assert sum(row["surprises"] for row in rows) == 1 and all(row["bytes"] > 50 for row in rows)
    assert "hour" in run(days_cli.app, "--timezone", "UTC").stdout
    memory.add_node("summary_x", SUMMARY, kind="day", order=3, content="nonsense")
    assert "1 summaries cannot be read" in run(days_cli.app).stderr


def test_the_account_of_a_day(memory: Memory) -> None:
    text = run(days_cli.app, "--on", "yesterday", "--timezone", "UTC").stdout
    assert "cup rested on shelf" in text and "ben picked cup up" in text and "the robot concluded" in text
    rows = json.loads(run(days_cli.app, "--on", "yesterday", "--timezone", "UTC", "--json").stdout)
    assert {row["basis"] for row in rows} == {"believed", "own"}
    assert "Nothing of that time" in run(days_cli.app, "--on", "last month").stdout or "cup" in text
    for wrong, error in (("tomorrow", "expected one such as"), ("on 31 June", "day is out of range")):
        with pytest.raises(ConfigError, match=error):
            run(days_cli.app, "--on", wrong)
    with pytest.raises(ConfigError, match="no time zone"):
        run(days_cli.app, "--timezone", "Nowhere/Land")


def test_times_in_words(memory: Memory, tmp_path: Path) -> None:
    text = run(tell_cli.app, "--since", "yesterday", "--timezone", "UTC").stdout
    assert "ben picked cup up" in text
    assert "ben picked cup up" not in run(tell_cli.app, "--since", "-60").stdout
    for wrong in ("soon", "nan", "inf"):
        with pytest.raises(ConfigError):
            run(tell_cli.app, "--since", wrong)
    question = "where was the cup yesterday, and who moved it?"
    answer = json.loads(run(ask_cli.app, question, "--json", "--timezone", "UTC").stdout)
    assert answer["names"] == ["shelf", "ben"]
    saved = tmp_path / "scene.json"
    dsr.write_graph(dsr.GraphContent.of(memory), saved)
    assert {"hour"} == {row["level"] for row in json.loads(run(days_cli.app, str(saved), "--json").stdout)}
