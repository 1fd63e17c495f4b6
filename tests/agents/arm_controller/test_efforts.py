"""A limit of force or current: an arm that presses against something stops and says so, if its driver tells efforts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from agents.plant import Plant
from benchmarks.pick_bench import Bench, Block, cubes
from dsr import Pose
from dsr.errors import ConfigError

from .conftest import DOWN, Table

EASY = (1.0,) * 7
PRESSED = (1.0, -31.5, *EASY[2:])
THERE = Pose((0.35, 0.2, 0.2), DOWN)


@pytest.fixture
def table(make_bench: Callable[..., Any]) -> Table:
    bench: Table = make_bench(Table, effort_limits={"joint_2": 30.0})
    bench.arm.efforts = EASY
    bench.lay()
    return bench


def test_an_effort_above_its_limit_stops_the_arm_with_the_reason_until_it_is_gone(table: Table) -> None:
    name = table.request("move", target_pose=THERE)
    table.run(0.5)
    assert table.arm.velocities.any()
    table.arm.efforts = PRESSED
    table.run(0.06)
    assert ("stop",) in table.arm.told
    assert table.said(name) == ("failed", "joint_2 presses with -31.5, more than 30")
    table.arm.efforts = EASY
    table.run(0.7)
    assert table.act("move", target_pose=THERE) == ("done", "")


def test_joints_without_a_limit_may_need_anything(table: Table) -> None:
    table.arm.efforts = (500.0, *EASY[1:])
    assert table.act("move", target_pose=THERE) == ("done", "")


def test_a_limit_that_nobody_can_watch_keeps_the_arm_still(table: Table) -> None:
    table.arm.efforts = ()
    table.run(0.1)
    status, why = table.act("move", target_pose=THERE)
    assert status == "failed" and why == "the driver tells no efforts, which `effort_limits` limits"


def test_efforts_of_too_few_joints_are_not_believed(table: Table) -> None:
    table.arm.efforts = EASY[:3]
    table.run(0.1)
    assert table.act("move", target_pose=THERE) == ("failed", "7 joint names, 3 efforts")


@pytest.mark.parametrize("limits", [{"joint_9": 30.0}, {"joint_1": 0.0}])
def test_limits_of_unknown_joints_and_of_nothing_are_refused(make_bench: Callable[..., Any], limits: Any) -> None:
    with pytest.raises(ConfigError, match="effort_limits"):
        make_bench(Table, effort_limits=limits)


def most_efforts(bench: Bench) -> list[float]:
    """The greatest effort of each joint on a move to the other side."""
    plant = bench.lockstep.runner("plant").agent
    assert isinstance(plant, Plant)
    name = bench.request("move", target_pose=Pose((0.35, -0.25, 0.1), DOWN))
    found = [0.0] * 7
    while bench.memory.node(name)["status"] in ("planned", "running"):
        bench.run(0.02)
        state = plant._reality.arm_state(0.0)
        assert state is not None
        found = [max(most, abs(now)) for most, now in zip(found, state.efforts, strict=True)]
    assert bench.memory.node(name)["status"] == "done"
    return found


def test_an_arm_that_meets_what_nobody_believes_in_stops_by_its_efforts() -> None:
    """A post of 100 kg stands in the way; free motions need less than two thirds of the limits."""
    start = Pose((0.35, 0.25, 0.1), DOWN)
    with Bench(cubes([(0.6, 0.3, 0.0)])) as bench:
        assert bench.act("move", target_pose=start) == "done"
        limits = {f"joint_{number}": 1.5 * most + 1.0 for number, most in enumerate(most_efforts(bench), start=1)}
    post = Block("post", (0.35, 0.0, 0.0), (0.05, 0.05, 0.4), mass=100.0)
    with Bench([post], arm={"effort_limits": limits}) as bench:
        bench.memory.update_node("post", present=False)
        assert bench.act("move", target_pose=start) == "done"
        before = bench.pose("post")
        said = bench.act("move", target_pose=Pose((0.35, -0.25, 0.1), DOWN))
        assert said.startswith("failed joint_") and "presses with" in said
        bench.run(1.0)
        assert bench.pose("post").distance(before)[0] < 0.01
