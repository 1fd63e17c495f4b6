"""Cameras that are bumped while the system runs, in lockstep: found out, told from moved cubes, and adopted by all."""

from __future__ import annotations

import pytest

from agents.scenario.judge.result import Result
from agents.scenario.run.runner import run_lockstep
from agents.scenario.run.staging import make_run


def failures(result: Result) -> list[str]:
    return [f"{verdict.text}: {verdict.actual}" for verdict in result.expectations if not verdict.passed]


@pytest.mark.parametrize(
    "name",
    [
        "camera_bumped",
        "camera_bumped_wrist",
        "camera_bumped_cube_moved",
        "camera_bumped_while_building",
        "cubes_moved_alike",
        "cubes_all_moved_alike",
        "cubes_all_moved_alike_overhead",
    ],
)
def test_the_camera_is_calibrated_if_and_only_if_it_moved(name: str) -> None:
    result = run_lockstep(make_run(name, sensor="poses", seed=1))
    assert failures(result) == []


def test_from_images_too() -> None:
    result = run_lockstep(make_run("camera_bumped_wrist", sensor="pixels", seed=0))
    assert failures(result) == []
    assert result.metrics["camera_recovery_time_s"] < 4.0
