"""The arm looks for what is nowhere: where no fixed camera sees, until it is found, and not for ever."""

from __future__ import annotations

import gc
import math
import sys
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from dsr import Pose
from dsr.vocabulary.intrinsics import Intrinsics
from planner import Planner
from planner.arms import PlannedArm
from planner.carried import CarriedCamera
from planner.config import PlannerConfig
from planner.looking import viewpoints
from planner.state import read_state
from tests.planner.table import SIGHT, Run, add_camera, supports

CONFIG = PlannerConfig()
LENS = Intrinsics(600.0, 600.0, 479.5, 359.5, 960, 720)
EYE = CarriedCamera("camera_wrist", LENS, PlannedArm("arm", "arm_controller", "gripper"))
DOWN = (1.0, 0.0, 0.0, 0.0)
GOAL = "on(cube_3,cube_9)"


def wait_for(run: Run, *, camera: str = "gripper") -> None:
    """A cube that is nowhere is wanted; the arm carries a camera if `camera` hangs on its gripper."""
    add_camera(run.memory, "camera_wrist", camera, Pose((0.0, 0.05, 0.0)))
    run.memory.add_node("cube_9", "cube", size=(0.04, 0.04, 0.04))
    run.want(GOAL)


def views(run: Run, **config: float) -> int:
    """How many looks show where a thing could be."""
    options = PlannerConfig(**config)  # type: ignore[arg-type]
    return len(viewpoints(read_state(run.memory, options), [EYE], options))


def test_what_no_fixed_camera_sees_is_looked_for_and_gone_on_with() -> None:
    with Run() as run:
        run.arm.hidden["cube_9"] = (-0.1, 0.3)
        wait_for(run)
        run.until("reached")
        assert supports(run.memory)["cube_3"] == "cube_9" and not run.arm.hidden
        x, y, z = run.arm.looks[-1].t
        assert math.dist((x, y), (-0.1, 0.3)) <= SIGHT and z == pytest.approx(CONFIG.look_height)
        assert len(run.arm.looks) < views(run)
        look = run.arm.done.index("look camera_wrist done")
        assert run.arm.done[look - 1] == "observe done" and "observe done" in run.arm.done[look:]


def test_looking_ends_and_the_failure_says_that_it_was_done() -> None:
    with Run() as run:
        wait_for(run)
        run.until("executing", CONFIG.explained + 1.0)
        assert run.explanation == "looking around; never seen: cube_9"
        run.until("failed")
        places = len(run.arm.looks)
        assert 3 <= places == views(run) < views(run, least_information=0.0) and run.arm.done[-1] == "observe done"
        told = run.explanation
        assert told.startswith("never seen: cube_9; waited ") and told.endswith(f"s, and looked from {places} places")
        run.go(20.0)
        assert len(run.arm.looks) == places and run.memory.nodes("action") == []


def test_it_looks_only_once_something_is_believed_and_only_after_a_moment() -> None:
    with Run() as run:
        wait_for(run)
        run.go(CONFIG.explained - 0.3)
        assert run.arm.done == [] and run.memory.nodes("action") == []
    with Run(places={}) as run:
        wait_for(run)
        run.go(CONFIG.explained + 5.0)
        assert run.arm.done == [] and run.memory.nodes("action") == []


@pytest.mark.parametrize(
    ("obstacle", "told"),
    [
        ("camera", "the arm carries no camera that sends images"),
        ("held", "the gripper holds cube_4"),
        ("busy", "the arm is busy with action_mine"),
        ("stuck", "action_0_1 takes longer than 3 s"),
    ],
)
def test_why_it_cannot_look_is_told(obstacle: str, told: str) -> None:
    with Run(action_limit=3.0, return_within=1.0) as run:
        if obstacle == "held":
            run.memory.add_edge("gripper", "cube_4", "grasping", source="gripper")
        if obstacle == "busy":
            run.memory.add_node("action_mine", "action", skill="observe", status="running", request="run")
        wait_for(run, camera="table" if obstacle == "camera" else "gripper")
        if obstacle == "stuck":
            run.until_running("observe", "")
            run.go(0.9)
            run.arm.stuck = True
        run.until("waiting" if obstacle == "busy" else "failed", 60.0)
        run.go(12.0)
        assert told in run.explanation and run.arm.looks == []


def test_a_cancelled_search_leaves_the_arm_at_rest() -> None:
    with Run() as run:
        wait_for(run)
        run.until_running("look", "camera_wrist", 0.2)
        run.memory.remove_node("intention_0")
        run.go(5.0)
        assert run.memory.nodes("action") == [] and run.arm.done[-1] == "observe done"


def test_an_agent_that_ends_during_a_look_ends_without_an_error() -> None:
    """What is written in a `finally` would be written when the memory is closed."""
    errors: list[object] = []
    with pytest.MonkeyPatch.context() as patch, Run() as run:
        patch.setattr(sys, "unraisablehook", lambda hook: errors.append(hook.exc_value))
        wait_for(run)
        run.until_running("look", "camera_wrist", 0.2)
        planner = run.lockstep.runner("planner").agent
        assert isinstance(planner, Planner) and planner._script is not None
        run.lockstep.close()
        planner._script.close()
        del planner
        gc.collect()
    assert errors == []


def test_a_more_urgent_goal_leaves_no_look_behind() -> None:
    with Run() as run:
        wait_for(run)
        look = run.until_running("look", "camera_wrist", 0.2)
        run.want("on(cube_4,cube_5)", priority=5)
        run.until(lambda: supports(run.memory).get("cube_4") == "cube_5")
        assert look not in run.memory and run.arm.done.count("look camera_wrist halted") == 1


def within_reach(steps: int = 60) -> np.ndarray:
    """(n, 2) places where the arm can put something, m."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(-0.2, 1.0, steps), np.linspace(-0.4, 0.4, steps)))
    reach = np.hypot(x, y)
    return np.stack([x, y], axis=1)[(CONFIG.least_reach <= reach) & (reach <= CONFIG.most_reach)]


def test_enough_looks_show_all_that_is_within_reach() -> None:
    with Run(least_information=0.0) as run:
        config = PlannerConfig(least_information=0.0)
        views = viewpoints(read_state(run.memory, config), [EYE], config)
    middles = np.array([view.t[:2] for _, view in views])
    away = np.hypot(*(within_reach()[:, None] - middles).transpose(2, 0, 1)).min(axis=1)
    assert away.max() <= SIGHT + 0.07 and all(view.q == DOWN for _, view in views)
    assert len({view.t for _, view in views}) == len(views)


def test_what_a_fixed_camera_sees_needs_no_look() -> None:
    with Run() as run:
        before = viewpoints(read_state(run.memory, CONFIG), [EYE], CONFIG)
        add_camera(run.memory, "camera_overhead", "world", Pose((0.35, 0.0, 0.65), DOWN))
        after = viewpoints(read_state(run.memory, CONFIG), [EYE], CONFIG)
        assert 0 < len(after) < len(before)
        add_camera(run.memory, "camera_high", "world", Pose((0.3, 0.0, 3.0), DOWN))
        state = read_state(run.memory, CONFIG)
        assert viewpoints(state, [EYE], CONFIG) == []
        run.memory.remove_node("camera_high")
        run.memory.remove_node("table")
        assert viewpoints(read_state(run.memory, CONFIG), [EYE], CONFIG) == []


def test_a_large_table_costs_no_more_than_what_is_within_reach() -> None:
    with Run() as run:
        before = viewpoints(read_state(run.memory, CONFIG), [EYE], CONFIG)
        state = read_state(run.memory, CONFIG)
    assert state.table is not None
    table = state.solids[state.table]
    x, y, z = table.size
    large = replace(state, solids={**state.solids, state.table: replace(table, size=(x + 6.0, y + 6.0, z))})
    tracemalloc.start()
    views = viewpoints(large, [EYE], CONFIG)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(views) >= len(before) and most < 1e8
