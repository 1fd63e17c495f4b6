"""Expectations and metrics about cameras, on made-up runs."""

from __future__ import annotations

import math

import pytest

from agents.scenario.format.scenario import parse_scenario
from agents.scenario.judge.cameras import camera_metrics
from agents.scenario.judge.verdicts import judge_check
from agents.scenario.truth.history import Error, History, Sample
from dsr.math3d.transforms import Pose

FILE = """
name = "bump"
title = "A camera is bumped"
duration = 10.0

[[object]]
name = "a"
position = [0.3, 0.0, 0.02]

[[event]]
at = 4.0
do = "camera_bump"
translation = [0.02, 0.0, 0.0]

[[expect]]
"""
TRUE = {"a": Pose((0.3, 0.0, 0.02))}


NEAR = Error(0.002, 0.003)


def run(expectation: str, error: Error | None = NEAR, *, calibrations: int = 1) -> tuple[bool, str]:
    history = history_of(expectation, error)
    history.calibrations = [(6.0, "found")] * calibrations
    verdict = judge_check(history.scenario.expectations[0], history)
    return verdict.passed, verdict.actual


def history_of(expectation: str, last: Error | None) -> History:
    history = History(parse_scenario(FILE + expectation))
    history.spans = {1: (4.0, 4.0)}
    for step in range(101):
        time = step / 10
        error = Error(0.0, 0.0) if time < 4.0 else Error(0.02, 0.0) if time < 6.5 else last
        history.add(Sample(time=time, truth=TRUE, camera_error=error))
    return history


def test_the_error_of_the_camera_is_judged_in_both_ways() -> None:
    assert run('check = "camera_error"') == (True, "2.00 mm, 0.17 deg")
    assert not run('check = "camera_error"\ntolerance = 0.001')[0]
    assert not run('check = "camera_error"\nangle = 0.001')[0]
    assert not run('check = "camera_error"\nat = 5.0')[0]
    assert run('check = "camera_error"', None) == (False, "the camera is nowhere")


def test_calibrations_are_counted() -> None:
    assert run('check = "calibrations"\nleast = 1\nmost = 1') == (True, "1; found")
    assert not run('check = "calibrations"\nmost = 0')[0]
    assert run('check = "calibrations"\nmost = 0\nat = 5.0')[0]
    assert not run('check = "calibrations"\nleast = 1', calibrations=0)[0]


def test_how_long_the_camera_was_wrong() -> None:
    metrics = camera_metrics(history_of('check = "camera_error"', Error(0.001, 0.002)))
    assert metrics["camera_error_m"] == 0.001 and metrics["camera_error_rad"] == 0.002
    assert metrics["camera_recovery_time_s"] == pytest.approx(2.5)
    assert "camera_recovery_time_s" not in camera_metrics(history_of('check = "camera_error"', Error(0.1, math.pi)))


def test_runs_without_anything_about_cameras_have_no_such_metrics() -> None:
    history = History(parse_scenario(FILE.partition("[[event]]")[0]))
    history.add(Sample(time=1.0, truth=TRUE, camera_error=Error(0.0, 0.0)))
    assert camera_metrics(history) == {}
