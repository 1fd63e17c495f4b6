"""Agents tell that they lag because other work keeps them from their processor, and only then."""

from __future__ import annotations

import logging
import math
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator

import pytest

from dsr.agent import Agent, make_agent
from dsr.clock import ManualClock
from dsr.network.keys import Keys
from dsr.network.local_transport import LocalNetwork
from dsr.runtime.contention import OVERLOADED, WARN_AFTER, Contention, longest_waited, time_waited
from dsr.runtime.runner import Runner


class Waits:
    """A thread that waits for a processor as the test says."""

    def __init__(self) -> None:
        self.waited = 0.0
        self.now = 100.0
        self.missed = 0
        self.contention = Contention(lambda: self.waited)
        self.contention.note(self.now, self.missed)

    def second(self, waited: float, missed: int) -> Contention:
        """A second in which it waited for so long (s), and left out so many ticks."""
        self.now += 1.0
        self.waited += waited
        self.missed += missed
        self.contention.note(self.now, self.missed)
        return self.contention


@pytest.mark.parametrize(
    ("waited", "missed", "overloaded"),
    [(0.5, 3, True), (OVERLOADED, 1, True), (0.5, 0, False), (0.1, 3, False), (math.nan, 3, False)],
)
def test_who_waits_and_leaves_out_ticks_is_overloaded(waited: float, missed: int, overloaded: bool) -> None:
    found = Waits().second(waited, missed)
    assert found.overloaded is overloaded
    assert found.waiting == (0.0 if math.isnan(waited) else pytest.approx(waited))


def test_it_lasts_until_a_good_second() -> None:
    waits = Waits()
    assert [waits.second(share, 1).lasts for share in (0.5, 0.5, 0.0, 0.5)] == [1.0, 2.0, 0.0, 1.0]


def test_statuses_in_quick_succession_share_a_window() -> None:
    waits = Waits()
    waits.second(0.5, 2)
    waits.now += 0.01
    waits.contention.note(waits.now, waits.missed)
    assert waits.contention.overloaded and waits.contention.waiting == pytest.approx(0.5)


def test_another_thread_begins_anew() -> None:
    waits = Waits()
    waits.waited = 1e-9  # of the other thread

    def look() -> None:
        waits.second(0.0, 5)

    thread = threading.Thread(target=look)
    thread.start()
    thread.join()
    assert not waits.contention.overloaded and waits.contention.waiting == 0.0


@pytest.fixture
def burners() -> Iterator[list[subprocess.Popen[bytes]]]:
    """Twice as many processes as this one may use processors, all of which compute."""
    program = [sys.executable, "-c", "while True: pass"]
    found = [subprocess.Popen(program) for _ in range(2 * len(os.sched_getaffinity(0)))]
    yield found
    for process in found:
        process.kill()
        process.wait()


@pytest.mark.usefixtures("burners")
def test_the_kernel_counts_the_time_for_which_a_thread_waits() -> None:
    before, began, worked = time_waited(), time.monotonic(), time.thread_time()
    if math.isnan(before):
        pytest.skip("this kernel does not tell")
    while time.thread_time() < worked + 0.2:
        pass
    waited, passed = time_waited() - before, time.monotonic() - began
    assert 0.1 < waited <= passed  # of all processes together, this one has at most half of a processor


def test_the_time_for_which_another_process_waits_is_that_of_its_slowest_thread(
    burners: list[subprocess.Popen[bytes]],
) -> None:
    if math.isnan(time_waited()):
        pytest.skip("this kernel does not tell")
    began, before = time.monotonic(), [longest_waited(process.pid) for process in burners]
    time.sleep(0.5)
    passed = time.monotonic() - began
    waited = [longest_waited(process.pid) - was for process, was in zip(burners, before, strict=True)]
    assert max(waited) > 0.1 and all(0.0 <= time <= passed for time in waited)
    assert longest_waited(2**22 + 1) == 0.0  # there is no such process


class Still(Agent):
    """Does nothing."""

    name = "still"
    uses_memory = False

    def tick(self, now: float) -> None:
        pass


def runner(pid: int) -> Runner:
    bus = LocalNetwork().connect("still")
    agent = make_agent(Still, name="still", bus=bus, keys=Keys("g"), clock=ManualClock(), memory=None)
    return Runner(agent, rid="still-1", pid=pid)


def test_an_agent_says_so_in_its_status_and_once_in_its_log(caplog: pytest.LogCaptureFixture) -> None:
    tested, waits = runner(pid=7), Waits()
    tested._contention = Contention(lambda: waits.waited)
    caplog.set_level(logging.WARNING)
    for second in range(2 * int(WARN_AFTER)):
        waits.waited += 0.4
        tested.missed += 1
        tested.agent.clock.advance(1.0)  # type: ignore[attr-defined]
        tested.tell()
        found = tested.status()  # two statuses make a second
        assert found.overloaded is (second > 0) and found.waiting == pytest.approx(0.4 * (second > 0))
    assert [record.message for record in caplog.records] == [
        "this machine is overloaded: the agent waited 40 % of the last second for a processor, and left out ticks "
        "(logged once)"
    ]


def test_in_lockstep_nobody_waits() -> None:
    tested = runner(pid=0)
    tested.missed = 100
    tested.tell()
    assert (tested.status().waiting, tested.status().overloaded) == (0.0, False)
