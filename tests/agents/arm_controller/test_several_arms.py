"""One of several arms in a graph: its names, its actions, and an emergency stop of it alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing

import numpy as np
import pytest

from agents.arm_controller import ArmController
from agents.arm_controller.config import ArmControllerConfig
from agents.drivers import has_option
from dsr import LocalNetwork, ManualClock, Memory
from dsr.errors import ConfigError
from dsr.graph.access import Access, check_writers
from dsr.network.keys import Keys
from dsr.vocabulary.arms import (
    ARM,
    CONTROLLER,
    arm_nodes,
    arm_of_action,
    controller_of,
    first_arm,
    gripper_node_of,
    gripper_of,
)
from dsr.vocabulary.halting import HaltLatch, HaltOrder, halt_node, order_about, order_of, send_order, write_order
from tests.agents.arm_controller.conftest import HOME, Bench

AWAY = (0.5, 0.0, np.pi, -0.96, 0.0, -2.05, np.pi / 2)
ALL = HaltOrder("1", True, "anna", "", 1.0)
LEFT = HaltOrder("2", False, "ben", "", 2.0, "left")
RIGHT = HaltOrder("3", True, "ben", "it squeaks", 3.0, "right")


@pytest.fixture
def memory() -> Iterator[Memory]:
    clock = ManualClock()
    with closing(Memory("test", "mission", transport=LocalNetwork(clock).connect("mission"), clock=clock)) as memory:
        yield memory


@pytest.fixture
def left(make_bench: Callable[..., Bench]) -> Bench:
    return make_bench(arm="left")


def test_the_first_arm_has_the_names_of_an_only_one_and_others_have_their_own() -> None:
    assert (gripper_of(ARM), gripper_of("left"), halt_node(), halt_node("left")) == (
        "gripper", "left_gripper", "halt", "halt_left",
    )  # fmt: skip
    assert ArmControllerConfig().gripper == "gripper" and ArmControllerConfig(arm="left").gripper == "left_gripper"
    assert ArmControllerConfig(arm="left", gripper="hook").gripper == "hook"
    assert has_option("agents.plant.driver:PlantArm", "arm") and not has_option("agents.plant.driver:PlantPoses", "arm")


def test_nodes_tell_who_moves_an_arm(memory: Memory) -> None:
    assert first_arm(memory) == ARM
    memory.add_node("left", "arm", controller="left_controller", gripper="hook")
    memory.add_node("action_0", "action")
    memory.add_node("action_1", "action", arm="right")
    assert first_arm(memory) == arm_of_action(memory, memory.node("action_0")) == "left"
    memory.add_node("arm", "arm")
    left, first = memory.node("left"), memory.node("arm")
    assert [node.name for node in arm_nodes(memory)] == ["arm", "left"]
    assert (controller_of(left), gripper_node_of(left)) == ("left_controller", "hook")
    assert (controller_of(first), gripper_node_of(first)) == (CONTROLLER, "gripper")
    assert [arm_of_action(memory, memory.node(name)) for name in ("action_0", "action_1")] == ["arm", "right"]


def test_an_arm_is_written_under_its_name(left: Bench) -> None:
    left.run(0.1)
    node = left.memory.node("left")
    assert (node["controller"], node["gripper"]) == (CONTROLLER, "left_gripper")
    assert {"left_link_1", "left_gripper"} <= {edge.dst for edge in left.memory.edges("RT")}
    assert "arm" not in left.memory and "gripper" not in left.memory


def test_an_action_is_carried_out_by_its_arm_alone(left: Bench) -> None:
    left.memory.add_node("mind", "mind")
    values = {"skill": "stop", "status": "planned", "request": "run"}
    left.memory.add_node("arm", "arm")
    for name, arm in (("action_0", {"arm": "left"}), ("action_1", {"arm": "right"}), ("action_2", {})):
        left.memory.add_node(name, "action", **values, **arm)
    left.run(0.2)
    assert [left.memory.node(f"action_{k}")["status"] for k in range(3)] == ["done", "planned", "planned"]


@pytest.mark.parametrize(("order", "obeys"), [(ALL, True), (RIGHT, False)])
def test_an_arm_obeys_orders_to_all_and_to_itself(left: Bench, order: HaltOrder, obeys: bool) -> None:
    left.memory.update_node("left", target_joints=AWAY)
    left.run(0.2)
    send_order(left.memory.transport, Keys("test"), order)
    left.run(0.04)
    assert left.memory.node("left")["status"] == ("halted" if obeys else "moving")
    send_order(left.memory.transport, Keys("test"), LEFT)
    left.run(0.04)
    assert left.memory.node("left")["status"] == ("idle" if obeys else "moving")


def test_the_newest_order_about_an_arm_counts_in_the_graph(memory: Memory) -> None:
    for order in (ALL, RIGHT, LEFT):
        write_order(memory, order)
    assert order_of(memory.node("halt_left")) == LEFT and memory.node("halt_left").type == "halt"
    assert [order_about(memory, arm) for arm in ("arm", "left", "right")] == [ALL, LEFT, RIGHT]
    write_order(memory, HaltOrder("4", True, "anna", "", 2.0))
    assert order_about(memory, "left") == HaltOrder("4", True, "anna", "", 2.0), "at one time the halt counts"


def test_a_latch_does_not_mind_orders_about_another_arm(memory: Memory) -> None:
    told: list[HaltOrder] = []
    latch = HaltLatch(memory.transport, memory.keys, told.append, "left")
    assert not latch.take(RIGHT) and latch.take(ALL) and latch.reason and latch.take(LEFT) and not latch.reason
    assert told == [ALL, LEFT]
    latch.close()


def test_several_controllers_share_what_each_writes_of_its_own_arm() -> None:
    check_writers({"left": ArmController.writes, "right": ArmController.writes})
    other = Access(nodes=("arm",), attributes=("joint_positions",))
    with pytest.raises(ConfigError, match="must be the only writer"):
        check_writers({"left": ArmController.writes, "other": other})
    believer = Access(edges=("Virtual_RT",), exclusive=("Virtual_RT",))
    with pytest.raises(ConfigError, match="must be the only writer"):
        check_writers({"one": believer, "two": believer})


def test_an_arm_that_another_agent_moves_too_is_halted(bench: Bench) -> None:
    bench.memory.update_node("arm", target_joints=(0.5, *HOME[1:]))
    bench.run(0.3)
    assert bench.status == "moving"
    bench.memory.update_node("arm", controller="somebody")
    bench.run(0.1)
    assert bench.status == "moving", "nobody of that name runs"
    bench.memory.update_node("arm", controller="mission")
    bench.run(0.1)
    assert bench.arm.told[-1] == ("stop",) and bench.status == "halted"
    assert "mission moves this arm, too" in bench.memory.node("arm")["explanation"]


def test_a_second_controller_of_one_arm_does_not_start(bench: Bench) -> None:
    bench.runner.teardown()
    bench.own.close()
    bench.memory.update_node("arm", controller="mission")
    with pytest.raises(ConfigError, match="arm 'arm' is moved by 'mission', which runs"):
        bench.start(joining=0.5)


@pytest.mark.parametrize("ahead", [3600.0, 1e11])
def test_a_release_from_the_future_releases_nothing(memory: Memory, ahead: float) -> None:
    future = memory.clock.now() + ahead
    memory.add_node("halt_left", "halt", halted=False, halt_id="f", source="eve", since=future, arm="left")
    halt = HaltOrder("5", True, "anna", "a hand", memory.clock.now())
    memory.add_node("halt", "halt", halted=True, halt_id="5", source="anna", explanation="a hand", since=halt.stamp)
    assert order_about(memory, "left") == halt


@pytest.mark.parametrize("halted", [True, False])
@pytest.mark.parametrize(("forged", "arm"), [("halt", "left"), ("halt_left", ""), ("halt_left", "left")])
def test_whoever_orders_after_an_order_from_the_future_is_obeyed(
    memory: Memory, halted: bool, forged: str, arm: str
) -> None:
    memory.add_node(forged, "halt", halted=not halted, halt_id="f", source="eve", since=1e12)
    if forged != "halt":
        memory.update_node(forged, arm="left")
    order = HaltOrder("5", halted, "anna", "", memory.clock.now(), arm)
    write_order(memory, order)
    assert order_about(memory, "left") == order


def test_an_older_order_that_is_written_late_overtakes_none(memory: Memory) -> None:
    memory.add_node("halt_left", "halt", halted=True, halt_id="1", source="ben", since=2.0, arm="left")
    write_order(memory, HaltOrder("2", False, "anna", "", 1.0))
    assert order_about(memory, "left") == HaltOrder("1", True, "ben", "", 2.0, "left")


@pytest.mark.parametrize("stamp", [1e300, -1e300])
def test_an_order_with_any_time_is_obeyed_and_kept(left: Bench, stamp: float) -> None:
    """The controller died when it wrote that time, and after its restart knew of no halt."""
    send_order(left.memory.transport, Keys("test"), HaltOrder("7", True, "anna", "", stamp))
    left.run(1.0)
    assert left.runner.status().errors == 0 and left.memory.node("left")["status"] == "halted"
    kept = order_about(left.memory, "left")
    assert kept is not None and kept.halted and 0.0 <= kept.stamp <= left.clock.now()


@pytest.mark.parametrize("halted", [True, False])
def test_an_order_about_one_arm_makes_no_release_of_a_time_to_come_valid_for_another(
    memory: Memory, halted: bool
) -> None:
    memory.add_node("halt", "halt", halted=False, halt_id="f", source="eve", since=1e6)
    write_order(memory, HaltOrder("5", True, "anna", "a hand", memory.clock.now(), "right"))
    write_order(memory, HaltOrder("6", halted, "ben", "", memory.clock.now(), "left"))
    kept = order_about(memory, "right")
    assert kept is not None and kept.id == "5"


@pytest.mark.parametrize("stamp", [-1e300, 1.0])
def test_a_halt_of_all_arms_is_newer_than_releases_before_it_whatever_its_time(memory: Memory, stamp: float) -> None:
    memory.add_node("halt_left", "halt", halted=False, halt_id="1", source="ben", since=memory.clock.now(), arm="left")
    write_order(memory, HaltOrder("2", True, "anna", "a hand", stamp))
    kept = order_about(memory, "left")
    assert kept is not None and kept.halted
