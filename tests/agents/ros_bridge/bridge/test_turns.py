"""Work between two ticks: at once, one at a time, and not so much that a flood takes more than a tenth of a core."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from time import thread_time

import pytest

from agents.ros_bridge import RosBridge
from agents.ros_bridge.bridge.turns import Turns
from agents.ros_bridge.link.local import LocalLink, LocalRos
from dsr.agent import make_agent
from dsr.clock import WALL_CLOCK, Clock, ManualClock
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.network.keys import Keys
from dsr.network.local_transport import LocalNetwork
from tests.agents.ros_bridge.robot import Robot

BUSY = 0.02
"""s of a processor that work takes"""



class Woken:
    """Counts how often a tick was asked for."""

    def __init__(self) -> None:
        self.times = 0

    def __call__(self) -> None:
        self.times += 1


class WallTurns(Turns):
    """Of an agent on the machine's clock, which stands still."""

    def __init__(self, clock: Clock, wake: Woken) -> None:
        super().__init__(WALL_CLOCK, wake)
        self._clock = clock


@pytest.fixture
def woken() -> Woken:
    return Woken()


def work() -> None:
    end = thread_time() + BUSY
    while thread_time() < end:
        pass


def fail() -> None:
    raise ZeroDivisionError


def test_work_is_done_in_the_thread_that_brings_it(woken: Woken) -> None:
    done: list[int] = []
    WallTurns(ManualClock(), woken).do_now(lambda: done.append(threading.get_ident()))
    assert done == [threading.get_ident()] and woken.times == 0


def test_during_a_tick_nobody_else_works_and_one_more_tick_is_asked_for(woken: Woken) -> None:
    turns, done = WallTurns(ManualClock(), woken), []
    with turns.tick():
        thread = threading.Thread(target=lambda: turns.do_now(lambda: done.append(1)))
        thread.start()
        thread.join()
        turns.notify()
    assert not done and woken.times == 1


def test_after_work_others_rest_ten_times_as_long(woken: Woken) -> None:
    clock = ManualClock()
    turns, done = WallTurns(clock, woken), []
    turns.do_now(work)
    clock.advance(9.0 * BUSY)
    turns.do_now(lambda: done.append(1))
    assert not done and woken.times == 0
    clock.advance(3.0 * BUSY)
    turns.do_now(lambda: done.append(1))
    assert done == [1]


def test_after_a_tick_that_was_due_nobody_rests_and_after_one_that_was_asked_for_all_do(woken: Woken) -> None:
    turns, done = WallTurns(ManualClock(), woken), []
    with turns.tick():
        work()
    turns.do_now(lambda: done.append(1))
    assert done == [1]
    other = WallTurns(ManualClock(), woken)
    other.notify()
    with other.tick():
        work()
    other.do_now(lambda: done.append(2))
    assert done == [1]


def test_in_lockstep_all_waits_for_the_tick(woken: Woken) -> None:
    turns, done = Turns(ManualClock(), woken), []
    turns.do_now(lambda: done.append(1))
    turns.notify()
    assert not done and woken.times == 1


def test_a_failure_leaves_the_turn_to_others(woken: Woken) -> None:
    clock = ManualClock()
    turns, done = WallTurns(clock, woken), []
    with pytest.raises(ZeroDivisionError):
        turns.do_now(fail)
    clock.advance(1.0)
    turns.do_now(lambda: done.append(1))
    assert done == [1]


@contextmanager
def bridge(ros: LocalRos, woken: Woken) -> Iterator[RosBridge]:
    """On the machine's clock, and without anybody who ticks."""

    class LocalBridge(RosBridge):
        connect = staticmethod(lambda link, node: LocalLink(ros, node))

    transport = LocalNetwork(WALL_CLOCK).connect("ros_bridge-1")
    memory = Memory("ros", "ros_bridge", transport=transport, rid="ros_bridge-1")
    agent = make_agent(
        LocalBridge, name="ros_bridge", bus=transport, keys=Keys("ros"), clock=WALL_CLOCK, memory=memory
    )
    assert isinstance(agent, RosBridge)
    agent.wake = woken
    agent.setup()
    try:
        yield agent
    finally:
        agent.teardown()
        memory.close()


@pytest.mark.parametrize("static", [False, True])
def test_a_transform_is_an_edge_without_a_tick(static: bool, woken: Woken) -> None:
    ros = LocalRos()
    robot = Robot(ros)
    with bridge(ros, woken) as agent:
        stamp = 0.0 if static else WALL_CLOCK.now()
        robot.tf(("world", "base", stamp, Pose((1.0, 2.0, 3.0))), static=static)
        assert agent.memory.edge("world", "base", "RT")["pose"].t == (1.0, 2.0, 3.0)
        assert woken.times == 0, "what the bridge writes itself is nothing to be sent"
