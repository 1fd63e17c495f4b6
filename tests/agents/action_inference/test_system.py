"""Actions in the simulated reality, inferred by the whole system in lockstep and compared with what was done."""

from __future__ import annotations

from pathlib import Path

from agents.scenario.judge.result import Result
from agents.scenario.run.runner import run_lockstep
from agents.scenario.run.staging import Policy, make_run

FILE = """
name = "handled"
title = "Cubes are lifted and dropped, carried, pushed; a full container is carried"
duration = 15.0
settle = 3.0

[sensor]
depth_bias = [0.005, 0.015]
depth_jitter = 0.003

[[object]]
name = "cube_3"
marker_id = 3
position = [0.45, 0.1, 0.02]

[[object]]
name = "cube_5"
marker_id = 5
position = [0.45, -0.1, 0.02]

[[object]]
name = "green"
model = "container_green"
known = true
position = [0.27, 0.1, 0.06]

[[object]]
name = "ball"
model = "ball"
known = true
position = [0.27, 0.1, 0.04]

[[event]]
at = 3.0
do = "lift"
object = "cube_3"
height = 0.15

[[event]]
at = 5.0
do = "drop"
object = "cube_3"

[[event]]
at = 6.5
do = "slide"
object = "cube_5"
by = [0.0, -0.1]

[[event]]
at = 8.5
do = "carry"
object = "green"
to = [0.27, -0.05, 0.06]
contents = false

[[expect]]
check = "actions"
sequence = ["Pick(cube_3)", "Release(cube_3)", "Pick(green)", "Place(green)"]
"""


def play(tmp_path: Path, policy: Policy | None) -> Result:
    file = tmp_path / "handled.toml"
    file.write_text(FILE)
    return run_lockstep(make_run(file, sensor="poses", policy=policy))


def test_what_is_done_is_inferred_and_nothing_else(tmp_path: Path):
    result = play(tmp_path, None)
    assert result.passed, result.expectations[0].actual
    assert result.metrics["action_precision"] == result.metrics["action_recall"] == 1.0
    assert result.metrics["pick_delay_max_s"] <= 0.45 and result.metrics["pick_time_error_max_s"] <= 0.15
    assert result.metrics["release_delay_max_s"] <= 0.3 and result.metrics["place_delay_max_s"] <= 1.0


def test_the_published_policy_is_later_and_takes_contents_for_picked(tmp_path: Path):
    result = play(tmp_path, "published")
    assert not result.passed and "Pick(ball)" in result.expectations[0].actual
    assert result.metrics["action_precision"] < 1.0
    assert result.metrics["pick_delay_max_s"] > 0.3
