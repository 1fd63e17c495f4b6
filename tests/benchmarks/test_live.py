"""The benchmark of the whole system: what counts as the answer to a percept, what counts as bounded, and its scene."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from agents.scenario.format.scenario import load_scenario
from benchmarks.live.__main__ import how_far
from benchmarks.live.crowd import write_crowd
from benchmarks.live.day import SETTLED, Size, is_bounded
from benchmarks.live.hearing import MOVED, Delays, Heard, rate_in_motion
from benchmarks.live.processes import Machine, Usage
from dsr.math3d.transforms import Pose
from dsr.runtime.system import AgentSpec, System
from simulation_handler.agent import SimulationHandler
from surprise.agent import SurpriseDetector

HERE = Pose.identity()


def _percept(written: float, x: float = 0.0) -> Heard:
    return Heard(written + 0.001, written, "camera", "cube", Pose((x, 0.0, 0.0), stamp=written - 0.03))


def _belief(stepped: float, at: float, x: float = 0.0) -> Heard:
    return Heard(at, at, "", "cube", Pose((x, 0.0, 0.0), stamp=stepped))


def test_a_percept_is_answered_by_the_next_change_of_the_belief() -> None:
    delays = Delays()
    delays.percept(_percept(1.0), HERE)
    delays.belief(_belief(1.02, 1.05, x=0.001), perceived=True)
    delays.belief(_belief(1.07, 1.10, x=0.002), perceived=True)
    assert delays.changed == [pytest.approx(0.05)] and delays.seen == [pytest.approx(0.08)]


def test_a_belief_of_before_the_same_belief_again_and_one_without_sight_answer_nothing() -> None:
    delays = Delays()
    delays.belief(_belief(0.9, 0.95), perceived=True)
    delays.percept(_percept(1.0), HERE)
    delays.belief(_belief(0.99, 1.03, x=0.001), perceived=True)
    delays.belief(_belief(1.04, 1.05, x=0.001), perceived=True)
    delays.belief(_belief(3.0, 3.05, x=0.3), perceived=False)
    assert delays.changed == []


def test_an_object_elsewhere_is_followed_when_the_belief_is_there() -> None:
    delays = Delays()
    far = 2 * MOVED
    delays.belief(_belief(0.9, 0.95), perceived=True)
    for written in (1.0, 1.1, 1.2):
        delays.percept(_percept(written, x=far), HERE)
    delays.belief(_belief(1.22, 1.25, x=far / 2), perceived=True)
    delays.belief(_belief(1.27, 1.30, x=far), perceived=True)
    assert delays.followed == [pytest.approx(0.30)]


def test_a_single_false_percept_is_not_waited_for() -> None:
    delays = Delays()
    delays.belief(_belief(0.9, 0.95), perceived=True)
    delays.percept(_percept(1.0, x=2 * MOVED), HERE)
    delays.percept(_percept(1.1), HERE)
    delays.belief(_belief(5.0, 5.05, x=2 * MOVED), perceived=True)
    assert delays.followed == []


@pytest.mark.parametrize("objects", [1, 4, 100])
def test_a_crowd_is_a_scenario(tmp_path: Path, objects: int) -> None:
    scenario = load_scenario(write_crowd(tmp_path, objects, seconds=21.0, period=4.0))
    assert len(scenario.objects) == objects
    assert len(scenario.events) == (5 if objects > 1 else 0)


def test_growth_after_the_first_hours_is_seen() -> None:
    size = Size(1, resident_mb=300.0, blocks=1, nodes=1, edges=1, snapshot_kb=1.0)
    before = [dataclasses.replace(size, resident_mb=100.0 * hour) for hour in range(1, SETTLED)]
    assert is_bounded([*before, *[size] * 20])
    assert not is_bounded([*before, *[size] * 20, dataclasses.replace(size, resident_mb=331.0)])


def test_processor_time_is_that_since_the_first_look() -> None:
    usage, machine = Usage(), Machine()
    usage.look(os.getpid(), memory=True)
    before = usage.last
    while usage.spent < 0.05:
        sum(range(10_000))
        usage.look(os.getpid(), memory=False)
    assert usage.spent == pytest.approx(usage.last - before) and usage.memory[0] > 1.0
    assert machine.busy() > 0.0
    usage.look(2**22 + 1, memory=True)
    assert len(usage.memory) == 1


def test_pauses_of_joints_count_while_they_move_only() -> None:
    """Of three stretches at 50 Hz the arm stands still between the first two, and samples are lost in the third."""

    def moving(begin: float, place: float) -> list[tuple[float, NDArray[np.float64]]]:
        return [(begin + 0.02 * k, np.array([place + 0.01 * k, 0.0])) for k in range(10)]

    still = [*moving(0.0, 0.0), *moving(0.4, 0.0901)]
    assert rate_in_motion(still, 50.0) == pytest.approx(50.0)
    lost = [sample for k, sample in enumerate(moving(0.0, 0.0)) if k % 3]
    assert rate_in_motion(lost, 50.0) == pytest.approx(100 / 3, rel=0.1)
    assert rate_in_motion(still[:1], 50.0) is None


def test_a_run_tells_how_far_it_is_and_who_lags_most() -> None:
    system = System(
        "crowd", (AgentSpec("surprise", SurpriseDetector), AgentSpec("simulation_handler", SimulationHandler))
    )
    assert how_far(4.2, 30.0, {}, system) == "4 of 30 s"
    rates = {"surprise": [2.0, 19.5], "simulation_handler": [20.0, 2.0]}
    assert how_far(12.0, 30.0, rates, system) == "12 of 30 s; simulation_handler at 2.0 of 20 Hz"
