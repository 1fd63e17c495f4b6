"""`dsr mission` with a planner and an arm as threads of this process, over a real network."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.testing import CliRunner, Result

import dsr
from dsr import Memory
from dsr.agent import Agent, make_agent
from dsr.clock import WALL_CLOCK
from dsr.errors import ConfigError
from dsr.vocabulary.intentions import add_intention
from planner import Planner, cli
from tests.planner.table import TOWERS, FakeArm, set_table, supports

Command = Callable[..., Result]


@pytest.fixture(autouse=True)
def runtime(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))


@pytest.fixture
def memory() -> Iterator[Memory]:
    with dsr.connect("table", agent="owner") as memory:
        set_table(memory)
        yield memory


@pytest.fixture
def robot(memory: Memory) -> Iterator[None]:
    """A planner and an arm that live until the end of the test."""
    end = threading.Event()

    def live(kind: type[Agent], config: dict[str, Any]) -> None:
        with dsr.connect("table", agent=kind.name) as mine:
            agent = make_agent(
                kind,
                name=kind.name,
                config=config,
                bus=mine.transport,
                keys=mine.keys,
                clock=WALL_CLOCK,
                memory=mine,
            )
            agent.setup()
            while not end.wait(0.02):
                agent.tick(WALL_CLOCK.now())
            agent.teardown()

    threads = [
        threading.Thread(target=live, args=(FakeArm, {})),
        threading.Thread(target=live, args=(Planner, {"return_within": 1.0, "patience": 1.0, "belief_agents": ()})),
    ]
    for thread in threads:
        thread.start()
    yield
    end.set()
    for thread in threads:
        thread.join()


@pytest.fixture
def mission() -> Command:
    group = typer.Typer()
    group.add_typer(cli.app, name="mission")
    group.command("other")(lambda: None)
    return lambda *words: CliRunner().invoke(group, ["mission", *words])


@pytest.mark.usefixtures("robot")
def test_a_mission_is_followed_until_it_is_reached(memory: Memory, mission: Command) -> None:
    result = mission(TOWERS, "--timeout", "60")
    assert result.exit_code == 0, result.output
    lines = result.output.splitlines()
    assert lines[-1] == "intention_0: reached"
    assert any("action 1 of 5: pick cube_3" in line for line in lines)
    assert supports(memory)["cube_3"] == "cube_4" and supports(memory)["cube_6"] == "cube_5"


@pytest.mark.usefixtures("robot")
def test_a_mission_that_is_given_up_says_why(mission: Command) -> None:
    result = mission("on(cube_3,cube_4) & on(cube_4,cube_3)", "--json")
    assert result.exit_code == 1
    outcome = json.loads(result.stdout)
    assert outcome["status"] == "unsolvable" and "exclude each other" in outcome["explanation"]
    told = mission("on(table,cube_4)")
    assert told.exit_code == 1 and "intention_1: invalid" in told.stderr
    assert "until dsr mission --cancel intention_1" in told.stderr


@pytest.mark.usefixtures("robot")
def test_a_maintained_mission_ends_the_command_and_is_cancelled_later(memory: Memory, mission: Command) -> None:
    assert mission("ontable(cube_3)", "--maintain").exit_code == 0
    assert memory.node("intention_0")["status"] == "maintained"
    listed = mission("--list", "--json")
    assert [row["status"] for row in json.loads(listed.stdout)] == ["maintained"]
    assert "intention_0" in mission("--list").output
    assert mission("--cancel").exit_code == 0
    assert memory.nodes("intention") == []


@pytest.mark.usefixtures("robot")
def test_why_a_mission_is_given_up_is_told_once(mission: Command) -> None:
    result = mission("on(cube_3,cube_4) & on(cube_4,cube_3)")
    assert result.exit_code == 1 and result.output.count("exclude each other") == 1
    assert "unsolvable" not in result.stdout and "exit code" not in result.output


@pytest.mark.usefixtures("robot")
def test_what_a_mission_waits_for_is_told_at_once(memory: Memory, mission: Command) -> None:
    memory.add_node("cube_9", "cube", size=(0.04, 0.04, 0.04))
    result = mission("on(cube_3,cube_9)", "--timeout", "30")
    assert result.exit_code == 1
    assert "intention_0: waiting (never seen: cube_9; gives up after 1 s)" in result.stdout
    assert "intention_0: failed: never seen: cube_9; waited 1 s" in result.stderr


def test_a_tag_that_may_come_into_view_is_no_wrong_name_while_somebody_looks(memory: Memory, mission: Command) -> None:
    unknown = mission("clear(cube_44)", "--no-wait")
    assert isinstance(unknown.exception, ConfigError)
    with dsr.connect("table", agent="scene_estimator"), dsr.connect("table", agent="simulation_handler"):
        assert mission("clear(cube_44)", "--no-wait").exit_code == 0
        assert memory.node("intention_0")["goal"] == "clear(cube_44)"
        assert isinstance(mission("clear(cub_44)", "--no-wait").exception, ConfigError)


def test_without_a_planner_it_says_so_and_gives_up_waiting(memory: Memory, mission: Command) -> None:
    result = mission(TOWERS, "--timeout", "1")
    assert result.exit_code == 1 and "no agent 'planner' runs" in result.output
    assert memory.node("intention_0")["status"] == "wanted"


def test_a_system_that_ends_meanwhile_is_told_of(
    memory: Memory, mission: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cli, "_ALONE", 0.5)
    ending = threading.Timer(2.0, memory.close)
    ending.start()
    result = mission(TOWERS, "--timeout", "20")
    ending.join()
    assert result.exit_code == 1 and "the system has ended" in result.output


def test_no_wait_only_writes_the_intention(memory: Memory, mission: Command) -> None:
    result = mission("clear(cube_3)", "--no-wait", "--json", "--priority", "3")
    assert result.exit_code == 0 and json.loads(result.stdout) == {"intention": "intention_0"}
    assert memory.node("intention_0")["priority"] == 3


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["on(cube_3 cube_4)"], "expected ',' or '\\)'"),
        (["on(cube_3,cube_44)"], "there is no 'cube_44'; valid: cube_3, cube_4"),
        ([], "what is wanted"),
        (["--cancel"], "nothing is wanted"),
        (["--cancel", "intention_7"], "no intention 'intention_7'"),
    ],
)
@pytest.mark.usefixtures("memory")
def test_what_is_wrong_is_said_before_anything_is_written(words: list[str], message: str, mission: Command) -> None:
    result = mission(*words)
    assert isinstance(result.exception, ConfigError)
    with pytest.raises(ConfigError, match=message):
        raise result.exception


def test_cancel_asks_which(memory: Memory, mission: Command) -> None:
    for _ in range(2):
        add_intention(memory, "handempty")
    result = mission("--cancel")
    assert "which intention? valid: intention_0, intention_1" in str(result.exception)
    assert mission("--cancel", "intention_1").exit_code == 0
    assert [node.name for node in memory.nodes("intention")] == ["intention_0"]
