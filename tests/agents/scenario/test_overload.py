"""On an overloaded machine, delays count the frames that came; what is wrong stays wrong; lockstep knows nothing."""

from __future__ import annotations

import io
import math
from collections.abc import Iterable
from typing import Any

import msgspec
import pytest
from rich.console import Console

from agents.scenario.format.scenario import parse_scenario
from agents.scenario.judge.findings import time_of
from agents.scenario.judge.judge import Judge, frame_keys
from agents.scenario.judge.overload import FRAMES_STOP, counted, moment, overload, standstills
from agents.scenario.judge.result import Result, Verdict
from agents.scenario.judge.verdicts import judge_check
from agents.scenario.run.report import show_result
from agents.scenario.truth.history import History, LateTicks, Sample
from dsr.clock import ManualClock
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.network.keys import Keys
from dsr.network.local_transport import LocalNetwork
from dsr.runtime.status import State, Status, encode_status

FILE = """
name = "moved"
title = "A cube is moved while the machine is busy"
duration = 16.0
linger = 2.0

[[object]]
name = "a"
position = [0.3, 0.0, 0.02]

[[event]]
at = 4.0
do = "slide"
object = "a"
by = [0.1, 0.0]

[[expect]]
"""
BEFORE, AFTER = {"a": Pose((0.3, 0.0, 0.02))}, {"a": Pose((0.4, 0.0, 0.02))}
FRAMES = [step / 10 for step in range(161)]
MOVED, STOPPED, CAME = 5.0, 5.2, 10.2
"""s: when the cube has been moved; last frame for a long time, in which it was not seen there; the next frame"""
GAP = [time for time in FRAMES if not STOPPED < time < CAME]
BUSY = [LateTicks(float(time), "plant", 0.6) for time in range(5, 12)]


def course(
    expectation: str, *, right_from: float = CAME + 0.5, frames: Iterable[float] = (), loads: Iterable[LateTicks] = ()
) -> History:
    """A run of 16 s in which the cube moves until 5 s and the belief is right from `right_from` (s) on."""
    history = History(parse_scenario(FILE + expectation))
    for step in range(321):
        time = step / 20
        beliefs = BEFORE if time < max(4.5, right_from) else AFTER
        moving = frozenset({"a"} if 4.0 < time < MOVED else ())
        truth = BEFORE if time < 4.5 else AFTER
        history.add(Sample(time=time, truth=truth, beliefs=beliefs, moving=moving, in_view=frozenset("a")))
    history.spans = {1: (4.0, 4.9)}
    history.frames, history.loads = list(frames), list(loads)
    return history


def verdict(expectation: str, **options: Any) -> Verdict:
    history = course(expectation, **options)
    return judge_check(history.scenario.expectations[0], history)


RECOVERED = "check = 'belief_recovered'\nwithin = 3.0"


def test_time_without_frames_counts_for_no_delay_and_is_told() -> None:
    found = verdict(RECOVERED, frames=GAP, loads=BUSY)
    assert found.passed
    assert "1.20 s, and 4.50 s without a frame" in found.actual


@pytest.mark.parametrize(
    ("frames", "loads"),
    [
        (FRAMES, BUSY),  # frames came all the time: the belief is late
        (GAP, ()),  # nobody waited for a processor: something else is wrong
        (GAP, [LateTicks(1.0, "plant", 0.6), LateTicks(15.0, "plant", 0.6)]),  # at other times only
        ((), BUSY),  # nothing is known of frames
    ],
)
def test_a_late_belief_fails_unless_an_overloaded_machine_brought_no_frames(
    frames: Iterable[float], loads: Iterable[LateTicks]
) -> None:
    found = verdict(RECOVERED, frames=frames, loads=loads)
    assert not found.passed and "5.70 s" in found.actual and "without a frame" not in found.actual


def test_a_belief_that_is_late_by_the_frames_that_came_fails() -> None:
    assert not verdict(RECOVERED, right_from=CAME + 3.5, frames=GAP, loads=BUSY).passed


@pytest.mark.parametrize(
    "expectation", [RECOVERED, "check = 'belief_error'", "check = 'belief_error'\nat = 3.0\nevent = 1"]
)
def test_a_wrong_belief_never_passes(expectation: str) -> None:
    assert not verdict(expectation, right_from=math.inf, frames=GAP, loads=BUSY).passed


def test_after_a_kill_the_start_of_the_agent_counts() -> None:
    history = course(RECOVERED, frames=GAP, loads=BUSY)
    history.kills = {2: 6.0}
    assert standstills(history, history.end) == []


def test_times_after_an_event_wait_for_frames() -> None:
    check = "check = 'belief_error'\nat = 1.5\nevent = 1"
    assert verdict(check, frames=GAP, loads=BUSY).passed
    assert not verdict(check, frames=FRAMES, loads=BUSY).passed
    history = course(check, frames=GAP, loads=BUSY)
    time = time_of(history.scenario.expectations[0], history)
    assert time == pytest.approx(MOVED + 1.5 + CAME - STOPPED - FRAMES_STOP)


def test_counting_and_its_inverse() -> None:
    history = course(RECOVERED, frames=GAP, loads=BUSY)
    assert standstills(history, history.end) == [(STOPPED + FRAMES_STOP, CAME)]
    for begin in (0.0, 4.0, 5.5, 7.0, 11.0):
        for seconds in (0.5, 1.0, 4.0):
            assert counted(history, begin, moment(history, begin, seconds, history.end)) == pytest.approx(seconds)


def test_a_gap_that_has_not_ended_counts_as_far_as_it_is_known() -> None:
    history = course(RECOVERED, frames=[time for time in FRAMES if time <= STOPPED], loads=BUSY)
    assert standstills(history, 8.0) == [(STOPPED + FRAMES_STOP, 8.0)]
    assert moment(history, 5.0, 2.0, 8.0) == pytest.approx(7.0 + 8.0 - STOPPED - FRAMES_STOP)


def test_without_overload_times_are_what_they_were_to_the_last_bit() -> None:
    history = course("check = 'belief_error'\nat = 1.1\nevent = 1")
    assert moment(history, 4.95, 1.1, history.end) == 4.95 + 1.1
    assert overload(history, passed=True) is None and overload(history, passed=False) is None


def test_overload_is_told_with_who_lagged() -> None:
    history = course(RECOVERED, frames=GAP, loads=[*BUSY, LateTicks(7.0, "arm", 0.3), LateTicks(-3.0, "arm", 0.9)])
    found = overload(history, passed=True)
    assert found is not None
    assert found.lagging_s == {"plant": 7.0, "arm": 1.0} and found.waiting["arm"] == 0.3
    assert found.frameless_s == pytest.approx(4.5)
    assert "plant for 7 s (waiting 60 % of them), arm for 1 s" in found.text and "no frame came for 4.5 s" in found.text


def test_of_a_run_that_failed_the_shortest_overload_is_told() -> None:
    """Frames came all the time, and yet nothing was heard of the arm for a moment: its action failed."""
    history = course(RECOVERED, frames=FRAMES, loads=BUSY[:1])
    assert overload(history, passed=True) is None
    found = overload(history, passed=False)
    assert found is not None and found.lagging_s == {"plant": 1.0} and found.frameless_s == 0.0


@pytest.mark.parametrize("passed", [True, False])
def test_the_verdict_says_so_instead_of_a_table_of_distances(passed: bool) -> None:
    history = course(RECOVERED, frames=GAP, loads=BUSY)
    result = Result(
        scenario="moved", seed=0, mode="live", sensor="pixels", passed=passed,
        expectations=[Verdict("belief_recovered", passed, "x")], metrics={}, notes=[],
        overload=overload(history, passed=passed),
    )  # fmt: skip
    stream = io.StringIO()
    show_result(result, history.scenario, Console(file=stream, width=200))
    text = stream.getvalue()
    assert "the machine was overloaded: agents waited for a processor" in text
    assert ("mean distance from the truth" in text) is passed
    assert ("run it again when the machine is less busy" in text) is not passed


def test_the_judge_notes_frames_and_overload_of_live_runs_only() -> None:
    clock = ManualClock(1000.0)
    network, keys = LocalNetwork(clock), Keys("test")
    plant = network.connect("plant")
    memory = Memory("test", "judge", transport=network.connect("judge"), clock=clock)
    scenario = parse_scenario(FILE + RECOVERED)
    live, lockstep = (Judge(scenario, memory, memory.transport, keys, live=is_live) for is_live in (True, False))
    for judge in (live, lockstep):
        judge.begin(1000.0)
    clock.advance(2.0)
    for key in frame_keys(keys):
        plant.publish(key.replace("*", "camera_overhead"), b"a frame")
    status = Status(agent="plant", rid="plant-1", pid=1, state=State.READY, stamp=clock.now(), waiting=0.6)
    for one in (status, msgspec.structs.replace(status, overloaded=True)):
        plant.publish(keys.status("plant"), encode_status(one))
    network.deliver()
    assert live.history.frames == [2.0, 2.0] and lockstep.history.frames == []
    assert live.history.loads == [LateTicks(2.0, "plant", 0.6)]


def test_a_run_lingers_for_frames() -> None:
    clock = ManualClock(1000.0)
    memory = Memory("test", "judge", transport=LocalNetwork(clock).connect("judge"), clock=clock)
    judge = Judge(parse_scenario(FILE + RECOVERED), memory, memory.transport, Keys("test"), live=True)
    judge.history = course(RECOVERED, frames=GAP, loads=BUSY)
    assert not judge.is_over(7.5)
    assert judge.is_over(4.9 + 2.0 + 4.5 + 0.1)
    judge.history = course(RECOVERED, frames=FRAMES, loads=BUSY)
    assert judge.is_over(7.5)
