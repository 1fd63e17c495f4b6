"""`dsr topology` and `dsr diff`."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from typing import Any

import pytest
from typer.testing import CliRunner

from dsr import ConfigError, Memory, Pose
from dsr.cli.main import app
from dsr.runtime.agent_process import StopSignal, run_agent
from dsr.worlds import Filter


class Copy(Filter):
    name = "copy"
    reads = ("base",)
    writes = "copied"


def diff(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["diff", *arguments])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.exit_code, result.output


def test_diff_tells_by_its_exit_code_whether_worlds_are_equal(memory: Memory) -> None:
    idea = memory.fork("idea")
    assert diff("base", "idea") == (0, "base and idea are equal\n")
    idea.update_node("cube_3", mass=2.0)
    idea.add_node("cube_9", "cube")
    idea.update_edge("world", "cube_3", "Virtual_RT", pose=Pose((0.4, 0.1, 0.02)))
    idea.remove_edge("cube_3", "table", "on")
    code, text = diff("base", "idea")
    assert code == 1
    assert "- cube_3 --on--> table" in text and "+ cube cube_9" in text
    assert "! cube cube_3  mass: unset | 2" in text
    assert "! world --Virtual_RT--> cube_3  pose: 100.00 mm" in text and "~ cube_3: 100.00 mm" in text
    code, text = diff("base", "idea", "--json")
    found = json.loads(text)
    assert code == 1 and not found["equal"]
    assert found["only_second"] == [{"name": "cube_9", "type": "cube"}]
    assert found["attributes"][0]["second"] == 2.0
    assert found["nodes"][0]["metres"] == pytest.approx(0.1)
    with pytest.raises(ConfigError, match="did you mean 'idea'"):
        diff("base", "ideas")


def test_topology_shows_agents_and_other_processes(
    memory: Memory, cli: Callable[..., str], cli_json: Callable[..., Any]
) -> None:
    stop = StopSignal()
    options = {"graph": "scene", "name": "copy", "config": {}, "router": None, "seed": 0, "stop": stop}
    thread = threading.Thread(target=run_agent, args=(Copy,), kwargs=options)
    thread.start()
    try:
        changes = memory.watch(node_type="world_record")
        assert changes.next(timeout=20) is not None
        copied = memory.world("copied")
        memory.update_node("cube_3", mass=1.0)
        found = cli_json("topology")
        worlds = {world["info"]["name"]: world for world in found["worlds"]}
        assert worlds["copied"]["providers"] == ["copy"] and worlds["copied"]["readers"] == ["owner"]
        assert worlds["base"]["readers"] == ["copy", "owner"]
        assert worlds["copied"]["last_write"] is not None
        text = cli("topology")
        assert "copied" in text and "copy" in text and "ready" in text
        assert "cube_3" in copied
        assert diff("base", "copied")[0] == 0
    finally:
        stop.set()
        thread.join()
