"""The planner with an arm that edits relations: the whole way, and everything that may go wrong on it."""

from __future__ import annotations

import sys

import pytest

from dsr.vocabulary.halting import HaltOrder, write_order
from dsr.vocabulary.intentions import MOST_INTENTIONS
from planner.intentions import read_intentions
from tests.planner.table import PLACES, TOWERS, Run, add_cube, move, supports

BUILT = {"cube_3": "cube_4", "cube_6": "cube_5", "cube_4": "table", "cube_5": "table"}


def test_two_towers_are_built_and_the_intention_goes() -> None:
    with Run() as run:
        run.want()
        run.until("reached")
        assert supports(run.memory) == BUILT
        assert run.history == ["wanted", "planning", "executing", "reached"]
        assert run.replans == 0 and run.arm.done[-1] == "observe done"
        assert len(run.arm.done) == 5
        run.go(6.0)
        assert not run.memory.nodes("intention") and not run.memory.nodes("action")


def test_the_plan_is_a_chain_of_actions_below_the_intention() -> None:
    with Run() as run:
        run.want()
        run.until_running("pick", "cube_3")
        names = [edge.dst for edge in run.memory.edges("has", src="intention_0")]
        actions = sorted(run.memory.nodes("action"), key=lambda node: node["order"])
        assert sorted(names) == [node.name for node in actions]
        assert [node["skill"] for node in actions] == ["pick", "place", "pick", "place", "observe"]
        chain = {edge.src: edge.dst for edge in run.memory.edges("next")}
        assert [chain[node.name] for node in actions[:-1]] == [node.name for node in actions[1:]]
        assert [node["request"] for node in actions] == ["run", "", "", "", ""]


def test_a_goal_that_holds_is_reached_without_moving() -> None:
    with Run() as run:
        run.want("ontable(cube_3) & handempty")
        run.until("reached", 5.0)
        assert run.arm.done == []


def test_a_maintained_goal_is_watched_and_restored() -> None:
    with Run() as run:
        run.want(maintain=True)
        run.until("maintained")
        run.go(10.0)
        assert run.status == "maintained" and run.replans == 0
        move(run.memory, "cube_3", "table", (0.42, 0.08))
        run.until("executing", 5.0)
        run.until("maintained")
        assert supports(run.memory) == BUILT and run.replans == 1


def test_a_maintained_goal_survives_flicker() -> None:
    with Run() as run:
        run.want(maintain=True)
        run.until("maintained")
        run.memory.update_node("cube_3", surprising=True)
        run.memory.remove_edge("cube_3", "cube_4", "on")
        run.go(1.5)
        run.memory.add_edge("cube_3", "cube_4", "on", source="explanation")
        run.memory.update_node("cube_3", surprising=False)
        run.go(3.0)
        assert run.status == "maintained" and run.replans == 0


@pytest.mark.parametrize(
    ("skill", "cube"), [("pick", "cube_3"), ("place", "cube_3"), ("pick", "cube_6"), ("place", "cube_6")]
)
@pytest.mark.parametrize("after", [0.1, 0.7])
def test_a_new_cube_in_the_way_at_any_step_does_not_keep_it_from_the_goal(skill: str, cube: str, after: float) -> None:
    with Run() as run:
        run.want()
        run.until_running(skill, cube, after)
        blocked = "cube_5" if skill == "pick" and cube == "cube_3" else "cube_6" if cube == "cube_3" else "cube_3"
        x, y, z = run.memory.transform("world", blocked, types=("Virtual_RT",)).t
        add_cube(run.memory, "cube_9", x, y, z + 0.04, blocked)
        run.until("reached")
        found = supports(run.memory)
        assert {name: found[name] for name in BUILT} == BUILT


@pytest.mark.parametrize("after", [0.1, 0.7])
@pytest.mark.parametrize("step", range(4))
def test_a_disassembled_tower_is_built_again_at_any_step(step: int, after: float) -> None:
    with Run() as run:
        run.want()
        skill, cube = [("pick", "cube_3"), ("place", "cube_3"), ("pick", "cube_6"), ("place", "cube_6")][step]
        run.until_running(skill, cube, after)
        if supports(run.memory).get("cube_3") == "cube_4":
            move(run.memory, "cube_3", "table", PLACES["cube_3"])
        else:
            move(run.memory, "cube_4", "cube_5")
        run.until("reached")
        assert supports(run.memory) == BUILT and run.replans >= 1


def test_a_change_while_holding_halts_the_arm_first() -> None:
    with Run() as run:
        run.want()
        run.until_running("place", "cube_6", 0.1)
        move(run.memory, "cube_3", "table", PLACES["cube_3"])
        run.until("planning")
        assert "place cube_6 cube_5 halted" in run.arm.done
        run.until("reached")
        assert supports(run.memory) == BUILT


def test_a_moved_cube_with_the_same_relations_is_no_reason_to_plan_anew() -> None:
    with Run() as run:
        run.want()
        run.until_running("pick", "cube_3")
        move(run.memory, "cube_6", "table", (0.5, -0.2))
        run.until("reached")
        assert run.replans == 0


def test_it_holds_still_while_a_camera_is_in_doubt_and_goes_on_with_the_same_plan() -> None:
    with Run() as run:
        run.memory.add_node("camera", "camera")
        run.want()
        run.until_running("place", "cube_3", 0.2)
        run.memory.update_node("camera", mount="in doubt")
        run.go(6.0)
        assert run.status == "waiting" and "place cube_3 cube_4 halted" in run.arm.done
        assert run.memory.node("intention_0")["explanation"] == "camera may have moved"
        done = len(run.arm.done)
        run.go(6.0)
        assert len(run.arm.done) == done
        run.memory.update_node("camera", mount="steady")
        run.until("reached")
        assert run.replans == 0 and supports(run.memory) == BUILT


def test_flicker_while_surprises_are_explained_is_waited_for() -> None:
    with Run() as run:
        run.want()
        run.until_running("pick", "cube_6")
        run.memory.update_node("cube_3", surprising=True)
        run.memory.remove_edge("cube_3", "cube_4", "on")
        run.go(1.5)
        assert run.status == "waiting" and "on(cube_3,cube_4) ended" in run.explanation
        run.memory.add_edge("cube_3", "cube_4", "on", source="explanation")
        run.memory.update_node("cube_3", surprising=False)
        run.until("reached")
        assert run.replans == 0


def test_flicker_that_is_longer_than_patience_halts_but_does_not_plan_anew() -> None:
    with Run() as run:
        run.want()
        run.until_running("pick", "cube_3", 0.1)
        run.memory.remove_edge("cube_6", "table", "on")
        run.go(0.6)
        run.memory.add_edge("cube_6", "table", "on", source="contact")
        run.until("reached")
        assert "pick cube_3 halted" in run.arm.done and run.replans == 0


def test_a_failed_action_is_tried_again_and_then_given_up() -> None:
    with Run() as run:
        run.arm.failing = ["pick"]
        run.want()
        run.until("reached")
        assert run.replans == 1
    with Run() as run:
        run.arm.failing = ["pick"] * 20
        run.want()
        run.until("failed")
        assert run.explanation == "pick cube_3: out of reach"
        assert run.arm.done[-1] == "observe done" and run.arm.done.count("pick cube_3 failed") == 4


def test_a_hopeless_action_is_not_tried_again_unless_a_surprise_may_change_that() -> None:
    with Run() as run:
        run.arm.failing, run.arm.hopeless = ["pick"] * 20, True
        run.want()
        run.until("failed")
        assert run.explanation == "pick cube_3: out of reach" and run.replans == 0
        assert run.arm.done == ["pick cube_3 failed", "observe done"]
    with Run() as run:
        run.arm.failing, run.arm.hopeless = ["pick"], True
        run.memory.update_node("cube_3", surprising=True)
        run.want()
        run.until("reached")
        assert run.replans == 1 and run.arm.done[0] == "pick cube_3 failed"


def test_the_arm_goes_out_of_the_way_at_the_second_attempt() -> None:
    with Run() as run:
        run.arm.failing = ["observe"]
        run.want()
        run.until("reached")
        assert run.arm.done[-2:] == ["observe failed", "observe done"]


def test_a_new_plan_takes_the_place_of_what_was_done_of_the_one_before() -> None:
    with Run() as run:
        run.arm.failing = ["pick"]
        run.want()
        run.until(lambda: run.replans == 1)
        run.until("executing")
        run.go(0.2)
        assert {node["status"] for node in run.memory.nodes("action")} == {"planned", "running"}
        assert len(run.memory.nodes("action")) == len(run.memory.edges("next")) + 1 == 5


@pytest.mark.parametrize(("detectable", "first"), [(0.1, "observe done"), (0.9, "pick cube_3 done")])
def test_the_arm_goes_out_of_the_way_first_if_it_may_hide_what_is_wanted(detectable: float, first: str) -> None:
    with Run() as run:
        run.memory.add_node("camera", "camera")
        for cube in PLACES:
            run.memory.add_edge("camera", cube, "sees", detectable=detectable if cube == "cube_3" else 1.0)
        run.want()
        run.until(lambda: bool(run.arm.done))
        assert run.arm.done == [first]


def test_a_dropped_cube_is_picked_up_again_but_not_for_ever() -> None:
    with Run() as run:
        run.arm.dropping = 1
        run.want()
        run.until("reached")
        assert supports(run.memory) == BUILT and run.replans == 1
    with Run() as run:
        run.arm.dropping = 99
        run.want()
        run.until("failed")
        assert run.explanation == "place cube_3 on cube_4: cube_3 was lost on the way"
        assert run.arm.done[-1] == "observe done"


def test_an_effect_that_is_not_believed_counts_as_a_failure() -> None:
    with Run() as run:
        run.want()
        run.until_running("place", "cube_3", 0.6)
        run.memory.remove_edge("cube_3", "cube_4", "on")
        run.go(0.2)
        run.memory.add_edge("cube_3", "table", "on", source="contact")
        run.until("reached")
        assert run.replans >= 1 and supports(run.memory) == BUILT


def test_a_tower_that_never_stays_is_given_up() -> None:
    with Run(most_failures=3) as run:
        run.want("on(cube_3,cube_4)")
        for _ in range(3):
            run.until_running("observe", "")
            move(run.memory, "cube_3", "table", PLACES["cube_3"])
            run.go(1.5)
        run.until("failed")
        assert run.explanation == "3 plans were carried out, and still not: on(cube_3,cube_4)" and run.replans == 2


def test_an_unsolvable_goal() -> None:
    with Run() as run:
        run.want("on(cube_3,cube_4) & on(cube_4,cube_3)")
        run.until("unsolvable")
        told = "on(cube_3,cube_4) and on(cube_4,cube_3) exclude each other: cube_3 would rest on itself"
        assert run.explanation == told and run.arm.done == []


def test_a_missing_solver(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("planner.solver.PACKAGE", "no_such_package_at_all")
    with Run() as run:
        run.want()
        run.until("no_solver")
        assert "pip install 'dsr-memory[planning]'" in run.explanation


def test_a_goal_that_is_none() -> None:
    with Run() as run:
        run.want("onn(cube_3,cube_4)")
        run.until("invalid")
        assert "did you mean 'on'" in run.explanation
        run.want("on(gripper,cube_4)")
        run.until(lambda: run.memory.node("intention_1")["status"] == "invalid")
        run.want("on(table,cube_4)")
        run.until(lambda: run.memory.node("intention_2")["status"] == "invalid")


@pytest.mark.parametrize("name", ["x" * 128, "intention_" + "x" * 118])
def test_an_intention_after_which_no_action_can_be_named_ends_no_planner(name: str) -> None:
    with Run() as run:
        run.memory.add_node(name, "intention", goal="on(cube_3,cube_4)")
        run.until(lambda: run.memory.node(name).get("status") == "invalid")
        assert "too long" in run.memory.node(name)["explanation"]
        run.want()
        run.until("executing")


def test_actions_with_numbers_that_nobody_counts_to_end_no_planner() -> None:
    """Names behind the greatest number had more than 128 characters before."""
    with Run() as run:
        for end in ("9" * 118, "-1", "x"):
            run.memory.add_node(f"action_0_{end}", "action", source="planner", status="done", skill="pick")
        run.want()
        run.until_running("pick", "cube_3", 0.0)


def test_a_number_of_plans_that_has_no_successor_ends_no_planner() -> None:
    with Run() as run:
        run.want()
        run.memory.update_node("intention_0", replans=(1 << 63) - 1)
        run.until_running("pick", "cube_3", 0.0)
        assert read_intentions(run.memory)[0].replans < sys.maxsize - 1000


def test_however_many_intentions_of_an_agent_are_over_a_new_one_is_pursued() -> None:
    with Run() as run:
        for number in range(MOST_INTENTIONS + 9):
            run.memory.add_node(f"intention_{number}", "intention", goal="on(a,b)", status="failed", priority=9)
        run.memory.add_node("intention_9999", "intention", goal="on(a,b)")
        known = [intention.name for intention in read_intentions(run.memory)]
        assert len(known) == MOST_INTENTIONS and known[-1] == "intention_9999"


def test_however_many_intentions_somebody_makes_up_those_of_others_are_pursued() -> None:
    with Run() as run:
        run.want()
        liar = run.lockstep._join("liar", "liar-1", None)
        for number in range(MOST_INTENTIONS + 9):
            liar.add_node(f"intention_zz_{number}", "intention", goal="on(a,b)", status="failed", priority=9)
        liar.flush()
        run.until_running("pick", "cube_3", 0.0)
        known = [intention.name for intention in read_intentions(run.memory)]
        assert len(known) == MOST_INTENTIONS and "intention_0" in known


@pytest.mark.parametrize(("skill", "after"), [("pick", 0.1), ("pick", 0.7), ("place", 0.1), ("place", 0.7)])
def test_a_cancelled_intention_leaves_the_arm_at_rest_and_nothing_behind(skill: str, after: float) -> None:
    with Run() as run:
        run.want()
        run.until_running(skill, "cube_3", after)
        run.memory.remove_node("intention_0")
        run.go(5.0)
        assert run.memory.nodes("action") == [] and run.arm.done[-1] == "observe done"
        assert f"{skill} cube_3" in run.arm.done[-2] and run.arm.done[-2].endswith("halted")


@pytest.mark.parametrize(("skill", "after"), [("pick", 0.1), ("pick", 0.7), ("place", 0.1), ("place", 0.7)])
def test_a_killed_planner_goes_on_from_the_graph(skill: str, after: float) -> None:
    with Run() as run:
        run.want()
        run.until_running(skill, "cube_3", after)
        run.lockstep.kill("planner")
        run.go(0.2)
        run.lockstep.restart("planner")
        run.until("reached")
        assert supports(run.memory) == BUILT
        run.go(6.0)
        assert run.memory.nodes("action") == []


@pytest.mark.parametrize(("replans", "status"), [(0, "executing"), (1, "waiting")])
def test_who_takes_up_an_intention_that_was_disturbed_waits_until_the_scene_is_left_alone(
    replans: int, status: str
) -> None:
    with Run(calm=3.0) as run:
        run.memory.update_node(run.want(), replans=replans)
        run.go(2.5)
        assert run.status == status
        run.until("executing", 2.0)


def test_a_planner_that_starts_again_later_finds_what_is_maintained() -> None:
    with Run() as run:
        run.want(maintain=True)
        run.until("maintained")
        run.lockstep.kill("planner")
        move(run.memory, "cube_3", "table", PLACES["cube_3"])
        run.lockstep.restart("planner")
        run.until(lambda: run.replans == 1)
        run.until("maintained")
        assert supports(run.memory) == BUILT


@pytest.mark.parametrize(("skill", "after"), [("pick", 0.1), ("pick", 0.7), ("place", 0.1), ("place", 0.7)])
def test_a_killed_arm_is_waited_for(skill: str, after: float) -> None:
    with Run() as run:
        run.want()
        run.until_running(skill, "cube_3", after)
        run.lockstep.kill("arm_controller")
        run.until("waiting")
        run.go(20.0)
        assert run.explanation == "agent 'arm_controller' does not run"
        run.lockstep.restart("arm_controller")
        run.until("reached")
        assert supports(run.memory) == BUILT


def test_nothing_is_begun_without_an_arm() -> None:
    with Run() as run:
        run.lockstep.kill("arm_controller")
        run.want()
        run.go(5.0)
        assert run.status == "waiting" and run.memory.nodes("action") == []


def test_an_arm_that_does_not_begin_is_told_of() -> None:
    with Run() as run:
        run.arm.stuck = True
        run.want()
        run.go(8.0)
        assert (run.status, run.explanation) == ("waiting", "the arm does not begin action_0_0")
        run.arm.stuck = False
        run.until("reached")


def test_the_arm_is_left_to_others_while_it_works_for_them() -> None:
    with Run() as run:
        run.memory.add_node("action_mine", "action", skill="observe", status="running", request="run")
        run.want()
        run.go(4.0)
        assert run.explanation == "the arm is busy with action_mine"
        run.memory.update_node("action_mine", status="done")
        run.until("reached")
        assert "action_mine" in run.memory


def test_the_more_urgent_intention_comes_first_and_the_other_after_it() -> None:
    with Run() as run:
        run.want(TOWERS)
        run.until_running("pick", "cube_3", 0.1)
        run.want("on(cube_4,cube_5)", priority=1)
        run.until(lambda: run.memory.node("intention_1")["status"] == "reached")
        assert run.status == "wanted"
        run.until("reached")
        assert supports(run.memory) == BUILT


def test_a_maintained_goal_is_kept_while_another_is_pursued() -> None:
    with Run() as run:
        run.want("on(cube_3,cube_4)", maintain=True)
        run.until("maintained")
        run.want("clear(cube_4)")
        run.until(lambda: run.memory.node("intention_1")["status"] == "unsolvable")
        assert "what intention_0 asked for must stay true" in run.memory.node("intention_1")["explanation"]


def test_a_held_cube_can_be_the_goal() -> None:
    with Run() as run:
        run.want("holding(cube_3)")
        run.until("reached")
        assert [edge.dst for edge in run.memory.edges("grasping")] == ["cube_3"]


def test_without_intentions_nothing_is_written() -> None:
    with Run() as run:
        watch = run.memory.watch(existing=False)
        run.go(3.0)
        assert watch.poll() == []


def test_two_runs_are_equal() -> None:
    def play() -> list[str]:
        with Run() as run:
            run.want("on(cube_3,cube_4) & ontable(cube_4) & clear(cube_5)")
            lines: list[str] = []
            watch = run.memory.watch()
            for _ in range(40):
                run.go(0.5)
                lines += [repr(change) for change in watch.poll()]
            return lines

    assert play() == play()


def test_an_emergency_stop_ends_what_is_pursued_and_nothing_begins_by_its_release() -> None:
    order = HaltOrder("1", True, "anna", "a hand is in the way", 1.0)
    with Run() as run:
        run.want()
        run.until("executing")
        write_order(run.memory, order)
        run.arm.failing = ["pick", "place"] * 20
        run.until("failed")
        assert run.explanation == "halted by anna: a hand is in the way"
        write_order(run.memory, HaltOrder("2", False, "anna"))
        begun = len(run.arm.done)
        run.go(5.0)
        assert len(run.arm.done) == begun
    with Run() as run:
        write_order(run.memory, order)
        run.want()
        run.until("failed")
        assert run.arm.done == [] and run.explanation == "halted by anna: a hand is in the way"
