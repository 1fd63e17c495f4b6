"""What a motion relies on may fail at any moment: the arm is stopped within 0.1 s, with the reason, and stays still."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from agents.arm_controller.joints import Joints
from agents.arm_controller.model.kinematics import JointChain
from agents.arm_controller.model.urdf import load_robot
from agents.arm_controller.safety.following import OFF, STANDSTILL, Following
from agents.arm_controller.safety.sight import LEAST, MISSED, Sight
from agents.arm_controller.safety.velocities import VelocityCheck
from agents.drivers import ArmState
from agents.plant import Plant
from benchmarks.pick_bench import Bench as Simulated
from benchmarks.pick_bench import cubes
from dsr.vocabulary.halting import HaltOrder
from dsr.vocabulary.intentions import FAILED, HALTED
from tests.agents.arm_controller.conftest import GEN3, HOME, PERIOD, Bench, FakeArm
from tests.agents.arm_controller.test_cameras import frame

AWAY = (0.5, *HOME[1:])
WITHIN = 0.1
"""s, of simulated time"""
HALT = HaltOrder("1", True, "anna", "a hand is in the way", 1.0)


class Liar(FakeArm):
    """An arm whose samples are changed by `lie` before anybody sees them."""

    lie: Callable[[ArmState], ArmState] = staticmethod(lambda state: state)

    def sample(self, now: float) -> ArmState:
        return type(self).lie(super().sample(now))


def beyond(state: ArmState) -> ArmState:
    return replace(state, positions=(*state.positions[:1], 2.5, *state.positions[2:]))


def jumps(state: ArmState) -> ArmState:
    return replace(state, positions=(state.positions[0] + 0.4, *state.positions[1:]))


LIES: dict[str, tuple[Callable[[ArmState], ArmState], str]] = {
    "another name": (lambda state: replace(state, names=("elbow", *state.names[1:])), "does not know joint 'joint_1'"),
    "too few": (lambda state: replace(state, positions=state.positions[1:]), "7 joint names, 6 positions"),
    "no number": (lambda state: replace(state, positions=(float("nan"), *state.positions[1:])), "finite"),
    "infinite": (lambda state: replace(state, velocities=(float("inf"), *state.velocities[1:])), "finite"),
    "beyond": (beyond, "joint_2 is at 2.500, beyond its limits"),
    "jumps": (jumps, "joint_1 jumped by"),
    "in the past": (lambda state: replace(state, stamp=state.stamp - 0.5), "older than the one before"),
    "velocities of 0": (lambda state: replace(state, velocities=(0.0,) * 7), "joint_1 tells 0.00 rad/s, and has gone"),
    "constant velocities": (lambda state: replace(state, velocities=(0.3,) * 7), "tells 0.30 rad/s, and has gone 0"),
    "in trouble": (lambda state: replace(state, fault="servo 3 is too hot"), "servo 3 is too hot"),
}


def stops(bench: Bench) -> int:
    return sum(command == ("stop",) for command in bench.arm.told)


@pytest.mark.parametrize("lie", LIES)
def test_a_driver_that_lies_is_stopped_at_once_and_believed_again_after_a_while(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, lie: str
) -> None:
    bench.arm.__class__ = Liar
    bench.memory.update_node("arm", target_joints=AWAY)
    bench.run(0.3)
    assert bench.status == "moving"
    monkeypatch.setattr(Liar, "lie", staticmethod(LIES[lie][0]))
    bench.run(WITHIN)
    assert stops(bench) >= 1
    node = bench.memory.node("arm")
    assert node["status"] == "halted" and LIES[lie][1] in node["explanation"]
    assert LIES[lie][1] in bench.runner.status().last_error
    told = len(bench.arm.told)
    bench.memory.update_node("arm", target_joints=AWAY)
    bench.run(0.3)
    assert {command[0] for command in bench.arm.told[told:]} <= {"stop"}
    monkeypatch.setattr(Liar, "lie", staticmethod(lambda state: state))
    bench.run(2.0)
    assert bench.status == "idle"
    bench.memory.update_node("arm", target_joints=AWAY)
    bench.run(2.0)
    assert bench.status == "reached"


SPEEDS = np.concatenate([np.linspace(0.0, 1.0, 11), np.ones(5), np.linspace(1.0, -1.0, 21), np.linspace(-1.0, 0.0, 11)])
"""rad/s at each 0.02 s: as fast as accelerations of 5 rad/s^2 allow, there and back"""


def velocities_of(positions: np.ndarray, stamps: np.ndarray, told: np.ndarray) -> list[str]:
    """What a check says of each sample of one joint."""
    check = VelocityCheck(JointChain(load_robot(GEN3).between("base_link", "tool_link")))
    others = (0.0,) * 6
    return [
        check.problem(Joints(stamp, (position, *others), (velocity, *others), 0.0, False))
        for stamp, position, velocity in zip(stamps.tolist(), positions.tolist(), told.tolist(), strict=True)
    ]


@pytest.mark.parametrize("lag", [0.0, 0.02, 0.05])
@pytest.mark.parametrize("period", [0.01, 0.02, 0.1])
def test_velocities_that_a_device_filters_are_no_lies(period: float, lag: float) -> None:
    fine = np.arange(len(SPEEDS)) * 0.02
    stamps = np.arange(0.0, fine[-1], period)
    dense = np.arange(0.0, fine[-1] + 0.001, 0.001)
    way = np.cumsum(np.interp(dense, fine, SPEEDS)) * 0.001
    jitter = np.random.default_rng(3).uniform(-0.1, 0.1, len(stamps)) * period
    steps = 2 * np.pi / 4096
    positions = np.round(np.interp(stamps, dense, way) / steps) * steps
    told = np.interp(stamps - lag, fine, SPEEDS)
    assert set(velocities_of(positions, stamps + jitter, told)) == {""}


@pytest.mark.parametrize("speed", [0.1, 1.0, -0.5])
def test_velocities_of_0_are_noticed_within_three_samples_and_after_a_break_nothing_is_known(speed: float) -> None:
    stamps = np.arange(30) * PERIOD
    told = np.where(stamps < 0.3, speed, 0.0)
    said = velocities_of(stamps * speed, stamps, told)
    first = int(np.argmax(told == 0.0))
    assert set(said[:first]) == {""} and all(said[first + 2 :])
    assert velocities_of(np.array([0.0, 0.0, 1.0]), np.array([0.0, PERIOD, 2.0]), np.zeros(3)) == ["", "", ""]


def test_samples_that_come_late_are_stale(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    bench.run(1.0)
    bench.memory.update_node("arm", target_joints=AWAY)
    bench.run(0.2)
    late: list[ArmState] = []

    def delayed(state: ArmState) -> ArmState:
        late.append(state)
        return late[max(0, len(late) - 6)]

    bench.arm.__class__ = Liar
    monkeypatch.setattr(Liar, "lie", staticmethod(delayed))
    bench.run(2 * WITHIN)  # five samples are the same, and counted as silence before
    assert stops(bench) >= 1 and bench.status in ("halted", "no_driver")


def test_a_camera_that_ends_stops_the_arm_and_one_that_never_began_does_not(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench(cameras={"camera_overhead": {"driver": "fake:Camera", "name": "overhead"}})
    for _ in range(30):
        bench.cameras["overhead"].next = frame(bench.clock.now())
        bench.run(2 * PERIOD)
    bench.memory.update_node("arm", target_joints=AWAY, target_speed=0.2)
    bench.run(0.06)
    assert bench.status == "moving"
    bench.run(MISSED * 2 * PERIOD + WITHIN)
    assert bench.status == "halted" and "camera_overhead gave no frame for" in bench.memory.node("arm")["explanation"]
    assert stops(bench) == 1


def test_a_camera_is_missed_by_its_own_pace() -> None:
    slow, fast, never = Sight("slow"), Sight("fast"), Sight("never")
    for number in range(20):
        slow.note(0.1 * number)
        fast.note(1.7 + 0.01 * number)
    assert (slow.trouble(2.1), fast.trouble(1.97), never.trouble(9.0)) == ("", "", "")
    assert slow.trouble(1.9 + MISSED * 0.1 + 0.01) == "slow gave no frame for 0.31 s"
    assert fast.trouble(1.89 + LEAST + 0.01) == "fast gave no frame for 0.11 s"


def test_an_arm_that_nobody_shares_the_memory_with_any_more_stops(bench: Bench) -> None:
    bench.memory.update_node("arm", target_joints=AWAY)
    bench.run(0.3)
    bench.network.partition(["arm_controller"])
    bench.run(WITHIN)
    assert stops(bench) == 1
    assert bench.own.node("arm")["explanation"] == "nobody else holds the memory any more"
    bench.network.heal()
    bench.run(3.0)
    assert bench.status == "idle"


def test_an_arm_off_its_way_or_that_stands_still_is_noticed() -> None:
    way = np.linspace((0.0, 0.0), (1.0, 0.0), 50)
    bench = FakeArm()

    def sample(stamp: float, *positions: float) -> Any:
        return Joints(stamp, positions, (0.0, 0.0), 0.0, False)

    following = Following(way, ("a", "b"), 0.0, 0.05)
    assert following.off_way(sample(0.1, 0.1, 0.5 * OFF)) == ""
    assert following.off_way(sample(0.1, 0.1, 2 * OFF)) == "b is 0.20 rad off its way"
    assert not following.stands_still(sample(STANDSTILL + 0.05, 0.0, 0.0))
    assert following.stands_still(sample(STANDSTILL + 0.07, 0.0, 0.0))
    assert not following.stands_still(sample(STANDSTILL + 0.09, 0.1, 0.0))
    assert bench.told == []


# ---- on the device's side: the simulated arm stops by itself


@pytest.fixture
def simulated() -> Iterator[Simulated]:
    with Simulated(cubes([(0.42, 0.08, 0.4), (0.30, 0.08, -1.2)])) as bench:
        yield bench


def arm_of(bench: Simulated) -> Any:
    plant = bench.lockstep.runner("plant").agent
    assert isinstance(plant, Plant)
    return plant._reality.arm


@pytest.mark.parametrize("after", [0.5, 1.0, 1.4])
@pytest.mark.parametrize("fault", ["dead", "cut off"])
def test_the_arm_stops_by_itself_when_its_controller_gives_no_sign_of_life(
    simulated: Simulated, after: float, fault: str
) -> None:
    simulated.request("pick", target="cube_3")
    simulated.run(after)
    arm = arm_of(simulated)
    assert max(map(abs, arm.velocities)) > 0.05
    if fault == "dead":
        simulated.lockstep.kill("arm_controller")
    else:
        simulated.lockstep.network.partition(["plant-1", "observer"], ["arm_controller-1"])
    simulated.run(WITHIN)
    assert simulated.lockstep.runner("plant").agent._reality._guards["arm"].fault.startswith(  # type: ignore[attr-defined]
        "no sign of life of the arm's controller for 0.08"
    )
    simulated.run(0.5)
    here = arm.positions
    simulated.run(1.0)
    assert arm.positions == pytest.approx(here, abs=1e-3)


def test_an_action_that_the_device_ended_has_failed_and_says_why(simulated: Simulated) -> None:
    name = simulated.request("pick", target="cube_3")
    simulated.run(1.0)
    simulated.lockstep.network.partition(["plant-1", "observer"], ["arm_controller-1"])
    simulated.run(0.15)
    simulated.lockstep.network.heal()
    simulated.run(0.5)
    node = simulated.memory.node(name)
    assert node["status"] == FAILED
    simulated.run(1.0)
    assert simulated.act("pick", target="cube_3") == "done"


def test_a_simulated_arm_refuses_commands_of_a_controller_that_heard_nothing(simulated: Simulated) -> None:
    simulated.run(0.5)
    plant: Any = simulated.lockstep.runner("plant").agent
    plant._arms["arm"].halt.take(HALT)
    here = arm_of(simulated).positions
    name = simulated.request("pick", target="cube_3")
    simulated.run(2.0)
    assert arm_of(simulated).positions == pytest.approx(here, abs=1e-3)
    assert simulated.memory.node(name)["status"] in (FAILED, HALTED)
