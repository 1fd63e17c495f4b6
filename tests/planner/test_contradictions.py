"""Goals that cannot be: which relations conflict, and why."""

from __future__ import annotations

import pytest

from dsr import Pose
from dsr.vocabulary.contradictions import by_meaning
from dsr.vocabulary.goals import parse_goal
from dsr.vocabulary.intentions import UNSOLVABLE
from planner.config import PlannerConfig
from planner.contradictions import by_state
from planner.state import read_state
from tests.planner.table import PLACES, SIDE, Run, add_cube, move

EXCLUDE = "exclude each other"


def why(goal: str, run: Run) -> str:
    """What shows without a search."""
    found = by_meaning(parse_goal(goal)) or by_state(parse_goal(goal), read_state(run.memory, CONFIG), CONFIG)
    return "" if found is None else str(found)


CONFIG = PlannerConfig()


@pytest.mark.parametrize(
    ("goal", "told"),
    [
        ("on(a,b) & on(b,a)", f"on(a,b) and on(b,a) {EXCLUDE}: a would rest on itself"),
        (
            "on(x,a) & on(a,b) & clear(x) & on(b,c) & on(c,a)",
            f"on(a,b), on(b,c) and on(c,a) {EXCLUDE}: a would rest on itself",
        ),
        ("on(a,b) & clear(b)", f"on(a,b) and clear(b) {EXCLUDE}: with a on it, b is not clear"),
        ("handempty & holding(a)", f"handempty and holding(a) {EXCLUDE}: a gripper that holds a is not empty"),
        ("clear(a) & holding(a)", f"clear(a) and holding(a) {EXCLUDE}: what is held is not clear"),
    ],
)
def test_relations_that_hold_together_in_no_world(goal: str, told: str) -> None:
    assert str(by_meaning(parse_goal(goal))) == told


@pytest.mark.parametrize(
    ("goal", "told"),
    [
        (
            "on(cube_3,cube_4) & on(cube_3,cube_5)",
            f"on(cube_3,cube_4) and on(cube_3,cube_5) {EXCLUDE}: cube_3 can be put on one thing only",
        ),
        (
            "ontable(cube_3) & on(cube_3,cube_5)",
            f"ontable(cube_3) and on(cube_3,cube_5) {EXCLUDE}: cube_3 can be put on one thing only",
        ),
        (
            "on(cube_3,cube_5) & clear(cube_3) & on(cube_4,cube_5)",
            f"on(cube_3,cube_5) and on(cube_4,cube_5) {EXCLUDE}: only one thing can be put on cube_5",
        ),
        (
            "holding(cube_3) & holding(cube_4)",
            f"holding(cube_3) and holding(cube_4) {EXCLUDE}: the gripper can hold one thing only",
        ),
        (
            "holding(cube_3) & ontable(cube_3)",
            f"holding(cube_3) and ontable(cube_3) {EXCLUDE}: cube_3 cannot be put down and held",
        ),
        (
            "holding(cube_3) & on(cube_4,cube_3)",
            f"holding(cube_3) and on(cube_4,cube_3) {EXCLUDE}: nothing can be put on cube_3 while it is held",
        ),
    ],
)
def test_relations_that_the_arm_cannot_bring_about_together(goal: str, told: str) -> None:
    with Run() as run:
        assert why(goal, run) == told
        run.want(goal)
        run.until(UNSOLVABLE, 5.0)
        assert run.explanation == told and run.arm.done == []


@pytest.mark.parametrize(
    "goal",
    ["ontable(cube_3) & on(cube_3,table)", "on(cube_3,table) & on(cube_4,table)", "on(cube_3,cube_4) & clear(cube_3)"],
)
def test_relations_that_go_together(goal: str) -> None:
    with Run() as run:
        assert why(goal, run) == ""


def test_what_holds_already_is_no_conflict_although_the_arm_could_not_do_it() -> None:
    with Run() as run:
        goal = "on(cube_3,cube_4) & on(cube_3,cube_5)"
        move(run.memory, "cube_3", "cube_4")
        assert why(goal, run)
        run.memory.add_edge("cube_3", "cube_5", "on", source="contact")
        assert why(goal, run) == ""
        run.want(goal)
        run.until("reached", 5.0)


def add(run: Run, name: str, kind: str, size: tuple[float, float, float]) -> None:
    run.memory.add_node(name, kind, size=size)
    run.memory.add_edge("world", name, "Virtual_RT", pose=Pose((0.5, 0.0, size[2] / 2)))
    run.memory.add_edge(name, "table", "on", source="contact")


def test_what_cannot_support_is_named() -> None:
    with Run() as run:
        add(run, "cup_1", "cup", (0.06, 0.06, 0.08))
        run.want("on(cube_4,cube_5) & on(cube_3,cup_1)")
        run.until(UNSOLVABLE, 5.0)
        told = "nothing can be put on cup_1, only on a cube or a box"
        assert run.explanation == f"on(cube_3,cup_1) cannot be brought about: {told}"


@pytest.mark.parametrize("goal", ["on(box_1,cube_3)", "clear(cube_4)", "ontable(cube_4) & on(cube_3,cube_4)"])
def test_what_cannot_be_grasped_is_named_also_where_it_is_in_the_way(goal: str) -> None:
    with Run() as run:
        add(run, "box_1", "box", (0.12, 0.12, 0.04))
        move(run.memory, "box_1", "cube_4")
        run.want(goal)
        run.until(UNSOLVABLE, 5.0)
        told = "box_1 would have to be lifted, but it is 120 mm wide, and the gripper grasps up to 80 mm"
        assert run.explanation.endswith(f"cannot be brought about: {told}")


def test_what_a_hand_holds_is_named() -> None:
    with Run() as run:
        run.memory.add_node("human_hand_0", "hand")
        run.memory.remove_edge("cube_3", "table", "on")
        run.memory.add_edge("human_hand_0", "cube_3", "grasping", source="contact")
        assert why("on(cube_3,cube_4)", run) == "on(cube_3,cube_4) cannot be brought about: somebody else holds cube_3"
        assert why("on(cube_4,cube_3)", run) == "on(cube_4,cube_3) cannot be brought about: somebody else holds cube_3"


def test_a_thing_without_a_size_is_named() -> None:
    with Run() as run:
        run.memory.add_node("cube_9", "cube")
        run.memory.add_edge("world", "cube_9", "Virtual_RT", pose=Pose((0.5, 0.0, 0.02)))
        assert why("on(cube_9,cube_3)", run).endswith(
            "cube_9 would have to be lifted, but its size or pose is not known"
        )


def blind(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing shows without a search."""
    monkeypatch.setattr("planner.execution.by_state", lambda *_: None)
    monkeypatch.setattr("planner.execution.by_meaning", lambda *_: None)


def test_what_only_the_solver_knows_is_narrowed_down(monkeypatch: pytest.MonkeyPatch) -> None:
    blind(monkeypatch)
    with Run() as run:
        run.want("clear(cube_3) & on(cube_3,cube_4) & ontable(cube_6) & on(cube_5,cube_4) & handempty")
        run.until(UNSOLVABLE)
        told = "no plan leads to on(cube_3,cube_4) and on(cube_5,cube_4) together as things are now"
        assert run.explanation == told and run.arm.done == []


def test_a_single_relation_is_told_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    blind(monkeypatch)
    with Run() as run:
        add(run, "cup_1", "cup", (0.06, 0.06, 0.08))
        run.want("on(cube_4,cube_5) & on(cube_3,cup_1)")
        run.until(UNSOLVABLE)
        assert run.explanation == "no plan leads to on(cube_3,cup_1) as things are now"


def test_without_time_the_relations_that_are_left_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    blind(monkeypatch)
    with Run(solver_limit=20.0, solver_delay=15.0) as run:
        run.want("clear(cube_3) & ontable(cube_6) & on(cube_3,cube_4) & on(cube_5,cube_4) & handempty")
        run.until(UNSOLVABLE)
        left = "on(cube_3,cube_4), on(cube_5,cube_4) and handempty"
        told = f"no plan leads to {left} together as things are now, or some of them exclude each other"
        assert run.explanation == told


def test_what_another_intention_keeps_is_told_with_the_conflict() -> None:
    with Run() as run:
        run.want("on(cube_3,cube_4) & on(cube_6,cube_5)", maintain=True)
        run.until("maintained")
        run.want("clear(cube_4)")
        run.until(lambda: run.memory.node("intention_1")["status"] == UNSOLVABLE)
        told = "with cube_3 on it, cube_4 is not clear; what intention_0 asked for must stay true"
        assert run.memory.node("intention_1")["explanation"].endswith(told)


def test_after_a_failed_action_nothing_of_the_plan_is_left_that_was_not_begun() -> None:
    with Run() as run:
        run.arm.failing = ["pick"]
        run.want()
        run.until_running("observe", "")
        planned = [node["skill"] for node in run.memory.nodes("action") if node["status"] == "planned"]
        assert planned == [] and "pick cube_3 failed" in run.arm.done
        run.until("reached")


def test_a_tower_of_cubes_is_possible_from_anywhere() -> None:
    with Run() as run:
        add_cube(run.memory, "cube_9", *PLACES["cube_3"], 1.5 * SIDE, "cube_3")
        assert why("on(cube_3,cube_9)", run) == ""
        run.want("on(cube_3,cube_9)")
        run.until("reached")
