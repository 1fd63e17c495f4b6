"""A limit of force while the gripper closes: fingers stop there, and a press that is too hard is refused or told."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from msgspec.structs import replace

from agents.drivers import ArmState
from agents.plant import Plant
from benchmarks.pick_bench import Bench, cubes
from dsr.errors import ConfigError

from .conftest import Table

LIMIT = 20.0
"""N"""
SOFT = 2000.0
"""N/m: fingers that want to be 40 mm further press with 80 N"""


@pytest.fixture
def table(make_bench: Callable[..., Any]) -> Table:
    bench: Table = make_bench(Table, grip_limit=LIMIT)
    bench.arm.stiffness = SOFT
    bench.lay()
    return bench


def pressing(table: Table) -> float:
    state = table.arm.state()
    assert state is not None and state.gripper_effort is not None
    return state.gripper_effort


def test_fingers_close_until_they_press_as_hard_as_allowed_and_hold_that(table: Table) -> None:
    assert table.act("pick", target="cube_3") == ("done", "")
    assert LIMIT / 2 <= pressing(table) <= LIMIT
    told = [command[1] for command in table.arm.told if command[0] == "move_gripper"]
    assert min(told) == 0.0 and told[-1] > 0.025, "the fingers were told to close, and then no further"
    table.run(1.0)
    assert LIMIT / 2 <= pressing(table) <= LIMIT


def test_without_a_limit_they_press_as_hard_as_they_can(make_bench: Callable[..., Any]) -> None:
    table: Table = make_bench(Table)
    table.arm.stiffness = SOFT
    table.lay()
    assert table.act("pick", target="cube_3") == ("done", "")
    assert pressing(table) == pytest.approx(80.0)


def test_what_loosens_is_pressed_again(table: Table) -> None:
    assert table.act("pick", target="cube_3") == ("done", "")
    table.arm.obstacle = 0.033
    table.arm.move_gripper(table.arm.wanted)
    table.run(0.5)
    assert LIMIT / 2 <= pressing(table) <= LIMIT


def test_stiff_fingers_press_no_harder_either_in_the_end(table: Table) -> None:
    table.arm.stiffness = 1e6  # a first step of 0.5 mm is 500 N
    assert table.act("pick", target="cube_3") == ("done", "")
    assert LIMIT / 2 <= pressing(table) <= LIMIT


def test_fingers_that_press_too_hard_whatever_they_are_told_let_go_and_that_is_told(table: Table) -> None:
    table.arm.sample = _jammed(table.arm.sample)  # type: ignore[method-assign]
    status, why = table.act("pick", target="cube_3")
    assert status == "failed" and why.startswith("the fingers press with") and why.endswith(", not with 10 to 20")
    assert table.arm.opening > 0.04


def test_contact_is_what_presses_where_the_driver_senses_none(table: Table) -> None:
    sample = table.arm.sample
    table.arm.sample = lambda now: replace(sample(now), gripper_contact=False)  # type: ignore[method-assign]
    assert table.act("pick", target="cube_3") == ("done", "")
    assert table.memory.node("gripper")["contact"] is True
    assert table.act("place", destination="cube_5") == ("done", "")
    assert table.memory.node("gripper")["contact"] is False


def _jammed(sample: Callable[[float], ArmState]) -> Callable[[float], ArmState]:
    """Fingers that press with 90 N as soon as they touch."""

    def told(now: float) -> ArmState:
        state = sample(now)
        return replace(state, gripper_effort=90.0) if state.gripper_contact else state

    return told


def test_a_limit_that_nobody_can_watch_keeps_the_fingers_open(table: Table) -> None:
    table.arm.stiffness = 0.0
    table.run(0.1)
    why = "the driver does not tell how hard the fingers press, which `grip_limit` limits"
    assert table.act("pick", target="cube_3") == ("failed", why)
    assert table.arm.wanted > 0.04
    table.memory.update_node("gripper", target_opening=0.01)
    table.run(0.1)
    gripper = table.memory.node("gripper")
    assert (gripper["status"], gripper["explanation"]) == ("unreachable", f"target_opening: {why}")
    table.memory.update_node("gripper", target_opening=0.085)
    table.run(0.1)
    assert table.memory.node("gripper")["status"] == "reached", "it may open"


def test_an_opening_by_hand_presses_no_harder_either(table: Table) -> None:
    table.memory.update_node("gripper", target_opening=0.0)
    table.run(2.0)
    gripper = table.memory.node("gripper")
    assert (gripper["status"], gripper.get("explanation", "")) == ("stopped", "")
    assert LIMIT / 2 <= pressing(table) <= LIMIT


def test_a_limit_below_0_is_refused(make_bench: Callable[..., Any]) -> None:
    with pytest.raises(ConfigError, match="grip_limit"):
        make_bench(Table, grip_limit=-1.0)


def test_the_simulated_gripper_tells_how_hard_it_presses_and_picks_within_a_limit() -> None:
    with Bench(cubes([(0.42, 0.08, 0.0)]), arm={"grip_limit": 12.0}) as bench:
        assert bench.act("pick", target="cube_3") == "done"
        plant = bench.lockstep.runner("plant").agent
        assert isinstance(plant, Plant)
        state = plant._reality.arm_state(0.0)
        assert state is not None and state.gripper_effort is not None and 0.0 < state.gripper_effort <= 12.0
        assert plant._reality.arm.held == "cube_3"
