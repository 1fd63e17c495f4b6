"""What goes wrong around an arm, one thing at a time: it is refused or halted within 0.1 s, with a clear reason."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from agents.arm_controller.model.arm_model import load_arm
from agents.arm_controller.model.figure import Figure
from agents.arm_controller.model.kinematics import JointChain
from agents.arm_controller.safety.intruders import Intruders
from agents.arm_controller.scene import Obstacle
from agents.drivers import ArmState
from dsr import Pose
from dsr.crdt.delta import Add, Delta, Write
from dsr.crdt.hlc import stamp_at
from dsr.math3d.quaternions import Vector3
from dsr.math3d.shapes import Part, to_numbers
from dsr.network.keys import Keys
from dsr.vocabulary.arms import MOST_ARMS
from dsr.vocabulary.halting import HaltOrder, send_order
from tests.agents.arm_controller.conftest import DOWN, GEN3, HOME, PERIOD, Bench, Table
from tests.agents.arm_controller.test_watchdog import AWAY, WITHIN, Liar, stops

MakeBench = Callable[..., Any]
ASIDE = (-0.9, *HOME[1:])
"""Joint positions to the left of the arm as it stands at home."""


# ---- drivers that lie from the start, or about time

OTHER_CLOCKS: dict[str, tuple[float, str]] = {
    "far ahead": (100.0, "stamped 100.0 s ahead of the clock of this agent"),
    "a little ahead": (0.4, "stamped 0.40 s further ahead than before"),
    "far behind": (-100.0, "stamped 100.0 s behind the clock of this agent"),
}


@pytest.mark.parametrize("clock", OTHER_CLOCKS)
def test_stamps_that_jump_stop_the_arm(bench: Bench, monkeypatch: pytest.MonkeyPatch, clock: str) -> None:
    ahead, said = OTHER_CLOCKS[clock]
    bench.arm.__class__ = Liar
    bench.memory.update_node("arm", target_joints=AWAY)
    bench.run(0.3)
    monkeypatch.setattr(Liar, "lie", staticmethod(lambda state: replace(state, stamp=state.stamp + ahead)))
    bench.run(WITHIN)
    assert stops(bench) >= 1 and said in bench.memory.node("arm")["explanation"]


@pytest.mark.parametrize("ahead", [100.0, -100.0])
def test_a_driver_with_another_clock_moves_nothing(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, ahead: float
) -> None:
    bench.arm.__class__ = Liar
    monkeypatch.setattr(Liar, "lie", staticmethod(lambda state: replace(state, stamp=state.stamp + ahead)))
    bench.memory.update_node("arm", target_joints=AWAY)
    bench.run(1.0)
    assert {command[0] for command in bench.arm.told} <= {"stop"}
    assert "the clock of this agent" in bench.runner.status().last_error


def test_a_joint_that_is_told_twice_is_refused(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    def twice(state: ArmState) -> ArmState:
        return replace(state, names=(*state.names, "joint_1"), positions=(*state.positions, 0.3),
                       velocities=(*state.velocities, 0.0))  # fmt: skip

    bench.arm.__class__ = Liar
    monkeypatch.setattr(Liar, "lie", staticmethod(twice))
    bench.memory.update_node("arm", target_joints=AWAY)
    bench.run(0.5)
    assert {command[0] for command in bench.arm.told} <= {"stop"}
    assert "the driver tells joint 'joint_1' twice" in bench.runner.status().last_error


# ---- frames that others hang in a circle

def test_an_arm_goes_on_where_others_hang_its_frames_in_a_circle(bench: Bench) -> None:
    """One message takes an edge away and hangs the link above from one below."""
    bench.run(0.3)
    memory = bench.memory
    store = memory.replica.graph.store
    gripper, link = (tuple(store.by_key[name]) for name in ("gripper", "arm_link_3"))
    key, dot = ("gripper", "arm_link_3", "RT"), ("liar-1", 1)
    forged = Delta([Add(dot, key, "RT", gripper, link)], removed=list(store.by_key["arm_link_3", "arm_link_4", "RT"]))
    late = Pose(stamp=memory.clock.now() + 60.0)
    forged.writes = [Write(dot, "pose", stamp_at(memory.clock.now()), "liar-1", ("liar-1", 2), late)]
    forged.context = [("liar-1", 1, 2)]
    memory.replica.graph.join(forged, memory.clock.now())
    memory.update_node("arm", target_joints=AWAY)
    bench.run(1.5)
    assert bench.runner.status().errors == 0 and memory.get_edge("arm_link_3", "arm_link_4", "RT") is not None
    assert memory.get_transform("world", "gripper") is None
    memory.remove_edge(*key)
    bench.run(1.0)
    assert bench.runner.status().errors == 0 and memory.get_transform("world", "gripper") is not None


# ---- an agent that is not well

def test_an_agent_whose_ticks_fail_gives_its_device_no_sign_of_life(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench.memory.update_node("arm", target_joints=AWAY)
    bench.run(0.3)

    def fail(joints: object) -> None:
        raise ValueError("a graph that nobody understands")

    monkeypatch.setattr(bench.agent._holding, "tick", fail)  # type: ignore[attr-defined]
    last = bench.arm.alive_at
    for _ in range(4):
        bench.exchange(PERIOD)
        bench.arm.advance(bench.clock.now())
        bench.runner.tick(bench.clock.now())
    assert bench.arm.alive_at == last


def test_a_halt_is_answered_by_an_agent_whose_ticks_fail(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    bench.memory.update_node("arm", target_joints=AWAY)
    bench.run(0.3)
    monkeypatch.setattr(bench.agent._body, "write", lambda joints: 1 / 0)  # type: ignore[attr-defined]
    send_order(bench.memory.transport, Keys("test"), HaltOrder("1", True, "anna", "a hand", 1.0))
    for _ in range(3):
        bench.exchange(PERIOD)
        bench.arm.advance(bench.clock.now())
        bench.runner.tick(bench.clock.now())
    assert bench.arm.told[-1] == ("stop",)
    assert bench.memory.node("halt")["explanation"] == "a hand"


WRONG_WAYS: dict[str, dict[str, Any]] = {
    "too short": {"way": (1.0, 2.0), "way_times": (0.0, 1e9)},
    "no size": {"way": (0.4, 0.1, 0.2, 0.0, 0.0, 0.0, 1.0, 0.1, 0.1, -0.1), "way_times": (1e9,)},
    "back in time": {"way": (0.4, 0.1, 0.2, 0.0, 0.0, 0.0, 1.0, 0.1, 0.1, 0.1) * 2, "way_times": (1e9, 0.0)},
    "no rotation": {"way": (0.4, 0.1, 0.2, 0.0, 0.0, 0.0, 0.0, 0.1, 0.1, 0.1), "way_times": (1e9,)},
}


@pytest.mark.parametrize("way", WRONG_WAYS)
def test_an_arm_does_not_set_out_while_nobody_can_read_where_another_one_goes(bench: Bench, way: str) -> None:
    bench.memory.add_node("left", "arm", way_since=0.0, **WRONG_WAYS[way])
    bench.memory.update_node("arm", target_joints=AWAY)
    bench.run(2.0)
    assert bench.status == "moving" and bench.memory.node("arm")["explanation"] == "stands still: left is near"
    assert [told for told in bench.arm.told if told[0] == "follow"] == []
    bench.memory.remove_attribute("left", "way")
    bench.run(4.0)
    assert bench.status == "reached"


def test_an_arm_stops_when_another_one_announces_what_nobody_can_read_and_gives_up_after_a_while(bench: Bench) -> None:
    bench.memory.add_node("left", "arm")
    bench.memory.update_node("arm", target_joints=AWAY)
    bench.run(0.4)
    assert [told[0] for told in bench.arm.told] == ["follow"]
    bench.memory.update_node("left", way_since=0.0, **WRONG_WAYS["too short"])
    bench.run(WITHIN)
    assert bench.arm.told[-1] == ("stop",)
    bench.run(4.0)
    assert (bench.status, bench.memory.node("arm")["explanation"]) == ("stopped", "left is in the way")
    bench.memory.update_node("arm", target_joints=AWAY)
    bench.run(35.0)
    assert bench.memory.node("arm")["explanation"] == "nobody can read the way that left has announced"


def test_an_arm_does_not_set_out_while_there_are_more_arms_than_it_looks_at(bench: Bench) -> None:
    for number in range(MOST_ARMS):
        bench.memory.add_node(f"left_{number}", "arm")
    bench.memory.update_node("arm", target_joints=AWAY)
    bench.run(35.0)
    assert [told for told in bench.arm.told if told[0] == "follow"] == []
    said = f"more than {MOST_ARMS} arms are there, and nobody looks at the way of "
    assert bench.memory.node("arm")["explanation"].startswith(said)
    bench.memory.remove_node("left_0")
    bench.memory.update_node("arm", target_joints=AWAY)
    bench.run(4.0)
    assert bench.status == "reached"


# ---- targets by hand and for actions

@pytest.mark.parametrize(
    ("pose", "said"),
    [
        (Pose((0.42, 0.08, 0.0), DOWN), "cube_3 is in the way"),
        (Pose((0.36, 0.2, -0.05), DOWN), "table is in the way"),
        (Pose((3.0, 0.0, 0.3), DOWN), "target_pose"),
        (Pose((1e12, 0.0, 0.3), DOWN), "target_pose"),
    ],
)
def test_a_target_by_hand_that_cannot_be_is_refused(table: Table, pose: Pose, said: str) -> None:
    table.memory.update_node("arm", target_pose=pose)
    table.run(WITHIN)
    assert table.status == "unreachable" and said in table.memory.node("arm")["explanation"]
    assert {command[0] for command in table.arm.told} <= {"stop"}


@pytest.mark.parametrize("speed", [0.0, -0.5, 1.5])
def test_an_action_at_no_speed_is_refused(table: Table, speed: float) -> None:
    table.memory.update_node("arm", target_speed=speed)
    table.run(PERIOD)
    assert table.act("pick", target="cube_3") == (
        "failed", f"target_speed {speed:g}: expected more than 0, at most 1",
    )  # fmt: skip
    assert {command[0] for command in table.arm.told} <= {"stop"}


# ---- what comes into the way of a moving arm

def forbid(table: Table) -> None:
    table.memory.add_node("fence", "zone", size=(0.6, 0.3, 0.8))
    table.memory.add_edge("world", "fence", "RT", pose=Pose((0.4, 0.35, 0.4)))


def put(table: Table) -> None:
    table.believe("cube_9", Pose((0.3, 0.3, 0.3)), (0.4, 0.2, 0.6))


@pytest.mark.parametrize(("how", "what"), [(forbid, "fence"), (put, "cube_9")], ids=["zone", "thing"])
def test_what_comes_into_the_way_of_a_target_by_hand_stops_the_arm(
    table: Table, how: Callable[[Table], None], what: str
) -> None:
    table.memory.update_node("arm", target_joints=ASIDE)
    table.run(0.3)
    assert table.status == "moving"
    how(table)
    table.run(WITHIN)
    assert table.arm.told[-1] == ("stop",)
    assert (table.status, table.memory.node("arm")["explanation"]) == ("stopped", f"{what} is in the way")


@pytest.mark.parametrize(("how", "what"), [(forbid, "fence"), (put, "cube_9")], ids=["zone", "thing"])
def test_what_comes_into_the_way_of_an_action_stops_the_arm_and_another_way_is_sought(
    table: Table, how: Callable[[Table], None], what: str
) -> None:
    name = table.request("move", target_pose=Pose((0.3, 0.35, 0.3), DOWN))
    table.run(0.4)
    assert table.arm.told[-1][0] == "follow"
    how(table)
    table.run(WITHIN)
    assert table.arm.told[-1] == ("stop",)
    assert table.finish(name) == ("failed", f"{what} is in the way")


def test_what_comes_elsewhere_stops_nothing(table: Table) -> None:
    name = table.request("move", target_pose=Pose((0.4, -0.25, 0.3), DOWN))
    table.run(0.3)
    forbid(table)
    table.believe("cube_3", Pose((0.42, 0.2, 0.02)))
    assert table.finish(name) == ("done", "")
    assert ("stop",) not in table.arm.told


def test_what_came_into_the_way_since_it_was_planned_is_noticed_before_the_arm_moves(table: Table) -> None:
    name = table.request("pick", target="cube_3")
    table.run_to("open")
    table.believe("cube_9", Pose((0.42, 0.08, 0.25)), (0.3, 0.3, 0.3))
    assert table.finish(name) == ("failed", "there is no room for the gripper around cube_3: cube_9 is in the way")
    assert [command for command in table.arm.told if command[0] == "follow"] == []


BOARD = (0.02, 0.9, 0.3)
"""m"""


@pytest.mark.parametrize(
    ("pose", "size", "is_new"),
    [
        (Pose((0.4, 0.005, 0.3)), BOARD, False),
        (Pose((0.4, 0.02, 0.3)), BOARD, True),
        (Pose.from_rotvec((0.4, 0.0, 0.3), (0.0, 0.0, 0.01)), BOARD, False),
        (Pose.from_rotvec((0.4, 0.0, 0.3), (0.0, 0.0, 0.09)), BOARD, True),
        (Pose((0.4, 0.0, 0.3)), (0.021, 0.899, 0.302), False),
        (Pose((0.4, 0.0, 0.3)), (0.02, 0.95, 0.3), True),
    ],
    ids=["shifted by noise", "shifted", "turned by noise", "turned", "measured anew", "larger"],
)
def test_a_thing_has_moved_if_a_corner_of_it_has(pose: Pose, size: Vector3, is_new: bool) -> None:
    intruders = Intruders()
    intruders.expect([Obstacle("board", Pose((0.4, 0.0, 0.3)), BOARD)])
    moved = Obstacle("board", pose, size)
    assert intruders.among([moved]) == ([moved] if is_new else [], [])
    assert intruders.among([moved]) == ([], [])


def known_to(shift: float, turn: float = 1e-4) -> Pose:
    return Pose((0.4, 0.0, 0.3), covariance=np.diag([shift**2] * 3 + [turn**2] * 3))


@pytest.mark.parametrize(
    ("before", "now", "is_doubtful"),
    [
        (known_to(0.001), Pose((0.4, 0.012, 0.3)), False),
        (known_to(0.005), Pose((0.4, 0.012, 0.3)), True),
        (known_to(0.005), Pose((0.4, 0.016, 0.3)), False),
        (known_to(0.001), known_to(0.1) @ Pose((0.0, 0.012, 0.0)), False),
        (known_to(0.001, 0.02), Pose.from_rotvec((0.4, 0.0, 0.3), (0.0, 0.0, 0.04)), True),
        (known_to(0.001, 0.02), Pose.from_rotvec((0.4, 0.0, 0.3), (0.0, 0.0, 0.09)), False),
    ],
    ids=["known well", "known badly", "too far even so", "badly now", "turn known badly", "turned too far even so"],
)
def test_a_thing_whose_place_was_known_badly_may_be_believed_elsewhere_without_having_moved(
    before: Pose, now: Pose, is_doubtful: bool
) -> None:
    intruders = Intruders()
    intruders.expect([Obstacle("board", before, BOARD)])
    moved = Obstacle("board", now, BOARD)
    for _ in range(2):
        assert intruders.among([moved]) == (([], [moved]) if is_doubtful else ([moved], []))
        if not is_doubtful:
            break


@pytest.mark.parametrize(
    ("sigma", "shift", "is_stopped"),
    [(0.001, 0.0105, True), (0.006, 0.0105, False), (0.006, 0.0125, True), (0.02, 0.04, True)],
)
def test_a_belief_that_becomes_known_better_beside_the_way_stops_no_arm_and_an_intruder_does(
    bench: Bench, tool: JointChain, sigma: float, shift: float, is_stopped: bool
) -> None:
    """The gripper passes 11 mm above a board, which is believed to be higher then: by less than that, or more."""
    x, y, _ = tool.forward((0.7, *HOME[1:])).t
    figure = Figure(load_arm(GEN3))
    gripper = -figure.gripper_boxes(bench.arm.opening)
    centers, axes, halves = (part[0, gripper:] for part in figure.boxes(np.array([HOME]), bench.arm.opening))
    lowest = float((centers[:, 2] - (np.abs(axes[:, 2]) * halves).sum(axis=1)).min())
    size = (0.06, 0.06, 0.02)
    place = Pose((x, y, lowest - 0.011 - size[2] / 2))
    covariance = np.diag([sigma**2] * 3 + [1e-6] * 3)
    bench.memory.add_node("world", "world")
    bench.memory.add_node("board", "cube", size=size)
    bench.memory.add_edge("world", "board", "Virtual_RT", pose=place.with_covariance(covariance))
    bench.run(0.1)
    bench.memory.update_node("arm", target_joints=(1.0, *HOME[1:]))
    bench.run(0.3)
    assert bench.status == "moving"
    bench.memory.add_edge("world", "board", "Virtual_RT", pose=Pose((x, y, place.t[2] + shift)))
    bench.run(WITHIN)
    assert (stops(bench) > 0) == is_stopped


WALLS = [(0.018, 0.0), (-0.018, 0.0), (0.0, 0.018), (0.0, -0.018)]
CUP = (
    Part("box", (0.04, 0.04, 0.004), (0.0, 0.0, -0.018)),
    *(Part("box", (0.004 if x else 0.04, 0.004 if y else 0.04, 0.04), (x, y, 0.0)) for x, y in WALLS),
)


def test_what_goes_along_in_what_the_arm_carries_is_not_in_its_way(table: Table) -> None:
    table.believe("pea", Pose((0.42, 0.08, 0.02)), (0.02, 0.02, 0.02))
    assert table.act("pick", target="cube_3") == ("done", "")
    table.memory.update_node("cube_3", shape=to_numbers(CUP))
    table.run(0.1)
    name = table.request("place", target="cube_3", destination="table", target_pose=Pose((0.42, -0.2, 0.02)))
    for _ in range(round(20.0 / PERIOD)):
        for edge in table.memory.edges("grasping"):
            here = table.memory.transform("world", "gripper") @ edge["held_at"]
            for thing in ("cube_3", "pea"):
                table.memory.add_edge("world", thing, "Virtual_RT", pose=here)
        table.run(PERIOD)
    assert table.said(name) == ("done", "")
    assert ("stop",) not in table.arm.told


# ---- halts at every moment

@pytest.mark.parametrize("step", ["open", "approach", "close", "rise"])
def test_a_halt_at_any_step_of_a_pick_stops_the_arm_and_keeps_the_grip(table: Table, step: str) -> None:
    name = table.request("pick", target="cube_3")
    table.run_to(step)
    told = len(table.arm.told)
    for number in ("1", "2"):
        send_order(table.memory.transport, Keys("test"), HaltOrder(number, True, "anna", "a hand", float(number)))
        table.run(WITHIN)
    assert {command[0] for command in table.arm.told[told:]} == {"stop"}
    assert table.said(name) == ("halted", "halted by anna: a hand")
    table.run(1.0)
    assert {command[0] for command in table.arm.told[told:]} == {"stop"}


def test_a_halt_during_a_search_ends_it(table: Table) -> None:
    for number, (x, y) in enumerate([(0.25, -0.15), (0.45, -0.15), (0.35, -0.05), (0.35, -0.25)]):
        table.believe(f"wall_{number}", Pose((x, y, 0.3)), (0.02, 0.2, 0.6) if number < 2 else (0.2, 0.02, 0.6))
    table.run(PERIOD)
    name = table.request("move", target_pose=Pose((0.35, -0.15, 0.2), DOWN))
    table.run_to("plan")
    send_order(table.memory.transport, Keys("test"), HaltOrder("1", True, "anna", "a hand", 1.0))
    table.run(WITHIN)
    assert table.said(name) == ("halted", "halted by anna: a hand")
    assert table.step == "" and {command[0] for command in table.arm.told} <= {"stop"}
