"""A scenario with every agent a process over Zenoh: judged, recorded, and nothing left behind."""

from __future__ import annotations

import os
from pathlib import Path

from agents.scenario.run.runner import Silent, run_live
from agents.scenario.run.staging import make_run
from dsr.runtime.launcher import AgentRow

SCENARIO = """
name = "short_kill"
title = "The belief simulator is killed and comes back"
duration = 12.0
settle = 2.0

[sensor]
depth_bias = [0.010, 0.010]

[[object]]
name = "cube_3"
marker_id = 3
position = [0.36, 0.0, 0.02]

[[event]]
at = 3.0
do = "kill"
agent = "simulation_handler"

[[expect]]
check = "recovered"
agent = "simulation_handler"

[[expect]]
check = "belief_closer_than_percept"

[[expect]]
check = "resting"

[[expect]]
check = "resting_height"
"""


class Watcher(Silent):
    """Remembers the agents' processes."""

    def __init__(self) -> None:
        self.pids: set[int] = set()

    def starting(self, rows: list[AgentRow]) -> None:
        self.pids |= {row.pid for row in rows if row.pid is not None}


def is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_a_live_run_survives_the_death_of_an_agent(tmp_path: Path):
    file = tmp_path / "short_kill.toml"
    file.write_text(SCENARIO)
    watcher = Watcher()
    result = run_live(make_run(file, seed=4, sensor="poses", folder=tmp_path / "run"), watcher)
    assert [verdict.text for verdict in result.expectations if not verdict.passed] == []
    assert result.metrics["samples"] > 100
    assert (tmp_path / "run/recording.mcap").stat().st_size > 10_000
    assert (tmp_path / "run/simulation_handler.log").exists()
    assert len(watcher.pids) >= 6
    assert not any(map(is_alive, watcher.pids))
