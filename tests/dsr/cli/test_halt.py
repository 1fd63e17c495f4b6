"""`dsr halt`: reaches whoever drives an arm, also while nobody else answers, and tells what came of it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import msgspec
import pytest
from typer.testing import CliRunner

import dsr
from dsr import Memory
from dsr.cli.main import app
from dsr.network.keys import Keys
from dsr.vocabulary.halting import HALT_NODE, HaltLatch, HaltOrder, HaltReport, halt_report_key, order_of

HOLDER = """
import sys, threading
import dsr
memory = dsr.connect(sys.argv[1], agent="holder", must_exist=False)
memory.add_node("world", "world")
print("holds", flush=True)
threading.Event().wait()
"""


class Driver:
    """Drives an arm: obeys orders and answers them, as an arm controller does at each tick."""

    def __init__(self, memory: Memory, moving: bool = False) -> None:
        self.memory, self.moving = memory, moving
        self.orders: list[HaltOrder] = []
        self._over = threading.Event()
        self._latch = HaltLatch(memory.transport, memory.keys, self.orders.append)
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        answered = 0
        while not self._over.wait(0.02):
            order = self._latch.order
            if order is not None and answered != self._latch.heard:
                answered = self._latch.heard
                report = HaltReport("arm_controller", order.id, order.halted, self.moving)
                key = halt_report_key(Keys(self.memory.graph_name), "arm_controller")
                self.memory.transport.publish(key, msgspec.msgpack.encode(report))

    def close(self) -> None:
        self._over.set()
        self._thread.join()
        self._latch.close()


@contextmanager
def driven(memory: Memory, *, moving: bool = False) -> Iterator[Driver]:
    driver = Driver(memory, moving)
    try:
        yield driver
    finally:
        driver.close()


def halt(*arguments: str) -> tuple[int, dict[str, Any]]:
    result = CliRunner().invoke(app, ["halt", *arguments, "--json"], catch_exceptions=False)
    return result.exit_code, json.loads(result.stdout)


def test_an_order_is_heard_answered_and_written(memory: Memory) -> None:
    with driven(memory) as driver:
        code, told = halt("a hand is in the way")
        assert code == 0
        id = driver.orders[0].id
        assert told["answers"] == [{"agent": "arm_controller", "id": id, "halted": True, "moving": False}]
        assert (driver.orders[0].halted, driver.orders[0].why) == (True, "a hand is in the way")
        assert told["written"] and order_of(memory.node(HALT_NODE)) == driver.orders[0]
        code, told = halt("--release")
        assert code == 0 and not told["halted"]
        assert [order.halted for order in driver.orders] == [True, False]
        assert memory.node(HALT_NODE)["halted"] is False


def test_one_arm_is_halted_alone(memory: Memory) -> None:
    with driven(memory) as driver:
        code, told = halt("--arm", "left")
        assert code == 1 and told["arm"] == "left" and told["answers"] == [] and not driver.orders
        assert memory.node("halt_left")["halted"] is True and HALT_NODE not in memory
        code, told = halt("--arm", "arm")
        assert code == 0 and driver.orders[0].arm == "arm"
        result = CliRunner().invoke(app, ["halt", "--arm", "arm"], catch_exceptions=False)
        assert "to allow motion again: dsr halt --release --arm arm" in result.output


def test_an_arm_that_still_moves_is_a_failure(memory: Memory) -> None:
    with driven(memory, moving=True):
        result = CliRunner().invoke(app, ["halt"], catch_exceptions=False)
    assert result.exit_code == 1 and "arm_controller: still moves" in result.output


def test_nobody_who_drives_an_arm_is_a_failure_and_later_ones_learn_of_it_all_the_same(memory: Memory) -> None:
    code, told = halt("nobody there")
    assert code == 1 and told["answers"] == []
    assert memory.node(HALT_NODE)["explanation"] == "nobody there"


def test_a_graph_that_does_not_answer_is_no_reason_to_move_on() -> None:
    graph = f"halt-{os.getpid()}"
    holder = subprocess.Popen([sys.executable, "-c", HOLDER, graph], stdout=subprocess.PIPE, text=True)
    try:
        assert holder.stdout is not None and holder.stdout.readline() == "holds\n"
        with dsr.connect(graph, agent="arm_controller") as memory:
            os.kill(holder.pid, signal.SIGSTOP)
            with driven(memory) as driver:
                code, told = halt("--graph", graph, "everything hangs")
            assert code == 0 and [order.why for order in driver.orders] == ["everything hangs"]
            assert [report["agent"] for report in told["answers"]] == ["arm_controller"]
    finally:
        os.kill(holder.pid, signal.SIGCONT)
        holder.kill()
        holder.wait()


@pytest.mark.parametrize("arguments", [["halt", "--graph", "no-such-graph-runs"]])
def test_a_graph_that_does_not_run_is_wrong_input(arguments: list[str]) -> None:
    from dsr.errors import ConfigError

    with pytest.raises(ConfigError, match="no graph 'no-such-graph-runs' runs"):
        CliRunner().invoke(app, arguments, catch_exceptions=False)
