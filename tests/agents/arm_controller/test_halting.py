"""The emergency stop of an arm: from the graph or as a message, in the middle of a skill, with half the system gone."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import msgspec
import numpy as np
import pytest

from agents.plant import Plant
from benchmarks.pick_bench import Bench as Simulated
from benchmarks.pick_bench import cubes
from dsr.network.keys import Keys
from dsr.network.transport import Qos
from dsr.vocabulary.halting import (
    HALT_NODE,
    HaltLatch,
    HaltOrder,
    HaltReport,
    decode_report,
    halt_key,
    halt_report_key,
    order_of,
    send_order,
    write_order,
)
from dsr.vocabulary.intentions import DONE, HALTED
from tests.agents.arm_controller.conftest import Bench, Table

KEYS = Keys("test")
HALT = HaltOrder("1", True, "anna", "a hand is in the way", 1.0)
RELEASE = HaltOrder("2", False, "ben", "", 2.0)
WHY = "halted by anna: a hand is in the way"
AWAY = (0.5, 0.0, np.pi, -0.96, 0.0, -2.05, np.pi / 2)
PLACES = [(0.42, 0.08, 0.4), (0.30, 0.08, -1.2)]
WITHIN = 0.1
"""s, of simulated time, from the order to the first command to stop"""


def stops(bench: Bench) -> int:
    return sum(command == ("stop",) for command in bench.arm.told)


def test_a_message_stops_a_motion_and_whatever_comes_is_refused(bench: Bench) -> None:
    bench.memory.update_node("arm", target_joints=AWAY)
    bench.run(0.2)
    assert bench.status == "moving"
    send_order(bench.memory.transport, KEYS, HALT)
    bench.run(0.04)
    assert stops(bench) == 1
    assert (bench.status, bench.memory.node("arm")["explanation"]) == ("halted", WHY)
    assert "target_joints" not in bench.memory.node("arm")
    assert bench.runner.status().last_error == WHY
    told = len(bench.arm.told)
    bench.memory.update_node("arm", target_joints=AWAY)
    bench.memory.update_node("gripper", target_opening=0.02)
    bench.run(0.5)
    assert bench.arm.told[told:] == []
    assert (bench.status, bench.memory.node("arm")["explanation"]) == ("refused", f"target_joints: {WHY}")
    assert bench.memory.node("gripper")["status"] == "refused"


def test_nothing_moves_by_a_release_alone_and_everything_when_it_is_asked_anew(bench: Bench) -> None:
    bench.memory.update_node("arm", target_joints=AWAY)
    bench.run(0.2)
    send_order(bench.memory.transport, KEYS, HALT)
    bench.run(0.1)
    told = len(bench.arm.told)
    send_order(bench.memory.transport, KEYS, RELEASE)
    bench.run(0.5)
    assert bench.arm.told[told:] == [] and bench.status == "idle"
    assert bench.runner.status().last_error == ""
    bench.memory.update_node("arm", target_joints=AWAY)
    bench.run(2.0)
    assert bench.status == "reached"


def test_a_repetition_of_an_order_that_was_released_halts_nothing(bench: Bench) -> None:
    for order in (HALT, RELEASE, HALT):
        send_order(bench.memory.transport, KEYS, order)
        bench.run(0.04)
    assert bench.status == "idle"
    send_order(bench.memory.transport, KEYS, HaltOrder("3", True, "anna"))
    bench.run(0.04)
    assert bench.memory.node("arm")["explanation"] == "halted by anna"


def test_an_order_in_the_graph_is_obeyed_too(bench: Bench) -> None:
    bench.memory.update_node("arm", target_joints=AWAY)
    bench.run(0.2)
    write_order(bench.memory, HALT)
    bench.run(0.06)
    assert stops(bench) == 1 and bench.status == "halted"
    write_order(bench.memory, RELEASE)
    bench.run(0.06)
    assert bench.status == "idle"


def test_the_controller_writes_the_order_and_answers_each_message(bench: Bench) -> None:
    heard: list[HaltReport] = []
    bench.memory.transport.subscribe(halt_report_key(KEYS), lambda _, payload: heard.append(decode_report(payload)))
    bench.memory.update_node("arm", target_joints=AWAY)
    bench.run(0.2)
    send_order(bench.memory.transport, KEYS, HALT)
    bench.run(0.04)
    assert order_of(bench.memory.node(HALT_NODE)) == HALT
    bench.run(0.5)
    send_order(bench.memory.transport, KEYS, HALT)
    bench.run(0.04)
    assert heard == [
        HaltReport("arm_controller", "1", True, True),
        HaltReport("arm_controller", "1", True, False),
    ]


def test_a_controller_that_starts_later_stays_still_and_forgets_old_targets(bench: Bench) -> None:
    bench.memory.update_node("arm", target_joints=AWAY)
    bench.run(0.2)
    bench.runner.teardown()
    bench.own.close()
    write_order(bench.memory, HALT)
    bench.start()
    told = len(bench.arm.told)
    bench.run(0.5)
    assert {command[0] for command in bench.arm.told[told:]} <= {"stop"}
    assert bench.status == "halted" and "target_joints" not in bench.memory.node("arm")


def test_a_halted_controller_gives_the_driver_no_sign_of_life(bench: Bench) -> None:
    bench.run(0.1)
    assert bench.arm.alive_at == pytest.approx(bench.clock.now(), abs=0.03)
    send_order(bench.memory.transport, KEYS, HALT)
    bench.run(0.04)
    last = bench.arm.alive_at
    bench.run(0.5)
    assert bench.arm.alive_at == last


@pytest.mark.parametrize("step", ["approach", "rise"])
def test_a_skill_ends_halted_and_the_next_one_is_not_begun(make_bench: Callable[..., Bench], step: str) -> None:
    table = make_bench(Table)
    assert isinstance(table, Table)
    table.lay()
    name = table.request("pick", target="cube_3")
    for _ in range(1000):
        table.run(0.02)
        if table.agent._actions.step == step:  # type: ignore[attr-defined]
            break
    send_order(table.memory.transport, KEYS, HALT)
    table.run(0.04)
    assert table.said(name) == (HALTED, WHY)
    assert table.act("observe") == (HALTED, WHY)
    send_order(table.memory.transport, KEYS, RELEASE)
    table.run(0.04)
    assert table.act("observe")[0] == DONE


@pytest.mark.parametrize("payload", [b"", b"\xc1", msgspec.msgpack.encode({"id": "", "halted": True, "by": "x"}),
                                     msgspec.msgpack.encode({"id": "1", "halted": True, "by": "x", "stamp": math.nan}),
                                     msgspec.msgpack.encode({"id": "1", "halted": 1, "by": "x"})])  # fmt: skip
def test_what_is_no_order_changes_nothing(bench: Bench, payload: bytes) -> None:
    latch = HaltLatch(bench.own.transport, KEYS)
    bench.memory.transport.publish(halt_key(KEYS), payload, Qos.RELIABLE)
    bench.run(0.1)
    assert (latch.malformed, latch.order) == (1, None) and bench.status == "idle"


# ---- with the simulated arm, under faults


@pytest.fixture
def simulated() -> Iterator[Simulated]:
    with Simulated(cubes(PLACES)) as bench:
        yield bench


def arm_of(bench: Simulated) -> Any:
    plant = bench.lockstep.runner("plant").agent
    assert isinstance(plant, Plant)
    return plant._reality.arm


def kill_controller(bench: Simulated) -> None:
    bench.lockstep.kill("arm_controller")


FAULTS: dict[str, Callable[[Simulated], None]] = {
    "nothing": lambda bench: None,
    "the controller is dead": kill_controller,
}


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("after", [0.5, 1.0, 1.4])
def test_the_simulated_arm_brakes_at_once_whatever_has_failed(simulated: Simulated, fault: str, after: float) -> None:
    simulated.request("pick", target="cube_3")
    simulated.run(after)
    FAULTS[fault](simulated)
    arm = arm_of(simulated)
    fastest = max(map(abs, arm.velocities))
    assert fastest > 0.05
    send_order(simulated.lockstep.bus, simulated.lockstep.keys, HALT)
    simulated.run(WITHIN)
    braking = max(map(abs, arm.velocities))
    assert braking < fastest or fastest < 0.1
    simulated.run(0.5)
    assert max(map(abs, arm.velocities)) < 0.01
    here = arm.positions
    simulated.run(1.0)
    assert arm.positions == pytest.approx(here, abs=2e-3)
