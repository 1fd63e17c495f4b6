"""The driver of Dynamixel servos against an emulator on a pseudo-terminal: motions, and all that goes wrong."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from agents.dynamixel import DynamixelArm
from agents.dynamixel.arm import DEADMAN, PERIOD, SHOWN
from agents.dynamixel.servos import SERIES
from agents.joint_ramp import Ramp
from dsr.clock import ManualClock
from dsr.errors import ConfigError, DsrError
from dsr.network.keys import Keys
from dsr.network.local_transport import LocalNetwork
from dsr.vocabulary.halting import HaltOrder, send_order
from tests.agents.dynamixel.conftest import SteppedClock
from tests.agents.dynamixel.emulator import Emulator, Servo

NAMES = ("joint1", "joint2", "joint3", "joint4", "joint5", "joint6")
PULSES = (1_003_846, 1_003_846, 1_003_846, 1_003_846, 607_500, 607_500)
"""Of the Open Manipulator-P: four PH54, two PH42."""
START = (0.1, -0.2, 0.3, -0.4, 0.5, -0.6)
THERE = (0.3, 0.0, 0.3, -0.2, 0.5, -0.3)
Until = Callable[..., Any]
LONG = 20.0
"""s of the driver's time in which something comes of it"""


@pytest.fixture
def line(clock: SteppedClock) -> Iterator[Emulator]:
    servos = {n: Servo(SERIES["P"], PULSES[n - 1], START[n - 1]) for n in range(1, 7)}
    with Emulator(servos, clock=clock) as emulator:
        yield emulator


@pytest.fixture
def network() -> LocalNetwork:
    return LocalNetwork(ManualClock())


@pytest.fixture
def arm(line: Emulator, network: LocalNetwork, clock: SteppedClock, until: Until) -> Iterator[DynamixelArm]:
    driver = DynamixelArm(network.connect("arm"), Keys("g"), port=line.port, joints=NAMES, pulses=PULSES, speed=1.0)
    clock.settle()
    until(driver.state)
    yield driver
    driver.close()


@pytest.fixture
def until(clock: SteppedClock) -> Until:
    """Lets the driver go on until something is so; with an arm, as its living controller."""

    def wait(condition: Callable[[], Any], arm: DynamixelArm | None = None) -> Any:
        end = clock.monotonic() + LONG
        while not (found := condition()):
            assert clock.monotonic() < end, "nothing came of it"
            if arm is not None:
                arm.keep_alive()
            clock.step()
        return found

    return wait


def is_at(arm: DynamixelArm, place: tuple[float, ...]) -> bool:
    state = arm.state()
    return state is not None and state.positions == pytest.approx(place, abs=2e-3)


def faults(arm: DynamixelArm) -> str:
    state = arm.state()
    return "" if state is None else state.fault


def rests(arm: DynamixelArm) -> bool:
    return arm._ramp is not None and arm._ramp.is_resting


@pytest.mark.usefixtures("patient")
def test_joints_are_read_and_nothing_is_written(arm: DynamixelArm, line: Emulator, clock: SteppedClock) -> None:
    state = arm.state()
    assert state is not None and state.names == NAMES
    assert state.positions == pytest.approx(START, abs=1e-5)
    for _ in range(10):
        clock.step()
    assert line.writes == 0 and arm.trouble == ""


def test_servos_of_the_x_series_have_other_registers(until: Until, clock: SteppedClock) -> None:
    servos = {3: Servo(SERIES["X"], 4096, 0.7)}
    with Emulator(servos, clock=clock) as line:
        bus = LocalNetwork(ManualClock()).connect("arm")
        arm = DynamixelArm(bus, Keys("g"), port=line.port, joints=["a"], ids=[3], series="X", pulses=[4096])
        clock.settle()
        state = until(arm.state)
        assert state.positions == pytest.approx((0.7,), abs=2e-3)
        arm.follow((0.6,), ((0.2,),))
        until(lambda: is_at(arm, (0.2,)), arm)
        arm.close()


@pytest.mark.parametrize("series", list(SERIES))
def test_currents_are_told_as_efforts(series: str, until: Until, clock: SteppedClock) -> None:
    servos = {3: Servo(SERIES[series], 4096, 0.7)}
    servos[3].current = -1.25
    with Emulator(servos, clock=clock) as line:
        bus = LocalNetwork(ManualClock()).connect("arm")
        arm = DynamixelArm(bus, Keys("g"), port=line.port, joints=["a"], ids=[3], series=series, pulses=[4096])
        clock.settle()
        assert until(arm.state).efforts == pytest.approx((-1.25,), abs=2e-3)
        arm.close()


@pytest.mark.usefixtures("patient")
def test_the_arm_goes_where_it_is_sent(arm: DynamixelArm, until: Until) -> None:
    arm.follow((0.0, 0.5), (START, THERE))
    until(lambda: is_at(arm, THERE), arm)
    assert arm.trouble == ""


@pytest.mark.parametrize("wrong", [math.nan, math.inf])
def test_a_way_of_numbers_that_are_not_finite_is_refused(
    arm: DynamixelArm, line: Emulator, wrong: float, until: Until, clock: SteppedClock
) -> None:
    arm.follow((0.0, 0.5), (START, (*THERE[:-1], wrong)))
    assert arm.trouble == "the way has numbers that are not finite"
    assert arm.counts["motions refused"] == 1
    clock.step()
    assert line.writes == 0, "no torque for a motion that is refused"
    arm.follow((0.0, 0.5), (START, THERE))
    until(lambda: is_at(arm, THERE), arm)


def test_a_cycle_that_fails_is_told_and_the_driver_goes_on(
    arm: DynamixelArm, monkeypatch: pytest.MonkeyPatch, until: Until
) -> None:
    def fail(ramp: Ramp) -> None:
        raise DsrError("no way to rest")

    with monkeypatch.context() as patch:
        patch.setattr(Ramp, "step", fail)
        arm.follow((0.0, 0.5), (START, THERE))
        until(lambda: faults(arm) == "the driver failed: DsrError: no way to rest", arm)
    until(lambda: arm.trouble == "", arm)
    arm.follow((0.0, 0.5), (START, THERE))
    until(lambda: is_at(arm, THERE), arm)


def test_late_answers_to_another_question_are_taken_for_no_positions_nor_faults(
    arm: DynamixelArm, monkeypatch: pytest.MonkeyPatch, until: Until
) -> None:
    answer = Emulator._answer

    def late(self: Emulator, id: int, data: bytes) -> None:
        answer(self, id, bytes([1]) if len(data) > 1 else bytes(10))

    with monkeypatch.context() as patch:
        patch.setattr(Emulator, "_answer", late)
        until(lambda: "bytes instead of" in arm.trouble, arm)
        before = arm.counts["cycles without an answer"]
        until(lambda: arm.counts["cycles without an answer"] > before + 3, arm)
    until(lambda: arm.trouble == "", arm)
    assert arm.counts.keys() == {"cycles without an answer"}
    assert is_at(arm, START) and faults(arm) == ""


def test_lost_corrupt_and_late_answers_delay_samples_only(arm: DynamixelArm, line: Emulator, until: Until) -> None:
    line.loss, line.corruption, line.delay = 0.02, 0.02, 0.0005
    arm.follow((0.0, 0.5), (START, THERE))
    until(lambda: is_at(arm, THERE), arm)
    until(lambda: arm.counts.get("cycles without an answer"), arm)
    line.loss = line.corruption = line.delay = 0.0
    until(lambda: arm.trouble == "", arm)


def test_a_silent_servo_is_told_and_no_sample_comes(arm: DynamixelArm, line: Emulator, until: Until) -> None:
    line.servos[4].silent = True
    until(lambda: "no joints of the servos" in arm.trouble)
    last, failures = arm.state(), arm.counts["cycles without an answer"]
    until(lambda: arm.counts["cycles without an answer"] > failures + 2)
    assert arm.state() == last


def test_an_overheated_servo_stops_the_arm_and_is_named(arm: DynamixelArm, line: Emulator, until: Until) -> None:
    arm.follow((0.0, 3.0), (START, (1.5, *THERE[1:])))
    until(lambda: not is_at(arm, START), arm)
    line.servos[2].heat()
    until(lambda: arm.state() and arm.state().fault == "servo 2 (joint2): overheated", arm)  # type: ignore[union-attr]
    until(lambda: rests(arm), arm)
    assert line.servos[1].position < 1.4


def test_a_stalled_servo_stops_the_arm_and_is_named(arm: DynamixelArm, line: Emulator, until: Until) -> None:
    line.servos[1].stalled = True
    arm.follow((0.0, 3.0), (START, (1.5, *THERE[1:])))
    until(lambda: "joint1 does not follow" in arm.trouble, arm)
    until(lambda: rests(arm), arm)
    assert arm._ramp is not None and arm._ramp.positions[0] < 1.0


def test_an_arm_whose_controller_gives_no_sign_of_life_stops(arm: DynamixelArm, line: Emulator, until: Until) -> None:
    arm.follow((0.0, 4.0), (START, (2.0, *START[1:])))
    until(lambda: rests(arm))
    assert "no sign of life of the arm's controller" in arm.trouble
    assert line.servos[1].position < 1.9


def test_an_arm_that_stopped_by_itself_may_move_again_when_its_controller_lives(
    arm: DynamixelArm, until: Until, clock: SteppedClock
) -> None:
    arm.follow((0.0, 4.0), (START, (2.0, *START[1:])))
    until(lambda: rests(arm))
    over = clock.monotonic() + 2 * SHOWN
    until(lambda: clock.monotonic() > over)
    assert "no sign of life" in arm.trouble, "there is no controller yet"
    until(lambda: arm.trouble == "", arm)


@pytest.mark.usefixtures("patient")
def test_a_way_that_begins_elsewhere_is_refused(arm: DynamixelArm, line: Emulator, until: Until) -> None:
    arm.follow((0.0, 0.5), ((0.1, 0.3, *START[2:]), THERE))
    state = until(lambda: found if (found := arm.state()) and found.fault else None, arm)
    assert state.fault == "the way begins 0.50 rad from where joint2 is"
    assert is_at(arm, START) and arm.counts["motions refused"] == 1
    until(lambda: arm.trouble == "", arm)
    assert line.writes == 0, "no torque for a motion that is refused"
    arm.follow((0.0, 0.5), (START, THERE))
    until(lambda: is_at(arm, THERE), arm)
    arm.follow((0.0, 0.5), (START, THERE))
    assert "the way begins" in arm.trouble
    until(lambda: arm.trouble == "", arm)
    assert line.servos[1].memory[SERIES["P"].torque] == 1, "a refusal does not let the arm fall"


def test_servos_stop_by_themselves_when_the_process_of_the_driver_is_gone(
    arm: DynamixelArm, line: Emulator, until: Until, clock: SteppedClock
) -> None:
    arm.follow((0.0, 4.0), (START, (2.0, *START[1:])))
    until(lambda: not is_at(arm, START), arm)
    arm.close()
    servo, places = line.servos[1], []
    for _ in range(round(6 * DEADMAN / PERIOD)):
        clock.advance(PERIOD)
        line.settle()
        places.append(servo.position)
    assert servo.memory[SERIES["P"].watchdog] == 0xFF
    assert places[-1] == places[round(3 * DEADMAN / PERIOD)] < 1.9


def test_the_driver_alone_obeys_an_emergency_stop(arm: DynamixelArm, network: LocalNetwork, until: Until) -> None:
    arm.follow((0.0, 4.0), (START, (2.0, *START[1:])))
    until(lambda: not is_at(arm, START), arm)
    send_order(network.connect("somebody"), Keys("g"), HaltOrder("1", True, "anna", "a hand"))
    network.deliver()
    until(lambda: rests(arm), arm)
    state = until(lambda: found if (found := arm.state()) and found.fault else None, arm)
    assert state.fault == "halted by anna: a hand" and state.positions[0] < 1.9
    arm.follow((0.0,), (START,))
    assert arm.counts["motions refused"] == 1 and rests(arm)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"joints": []}, "needs `joints`"),
        ({"joints": NAMES, "ids": [1, 2]}, "as many `ids`"),
        ({"joints": NAMES, "series": "Q"}, "series 'Q'"),
        ({"joints": NAMES, "port": "/dev/no-such-line"}, "'/dev/no-such-line' cannot be opened"),
    ],
)
def test_options_that_fit_no_arm_are_wrong_input(network: LocalNetwork, options: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        DynamixelArm(network.connect("arm"), Keys("g"), **{"port": "/dev/null", **options})
