"""Actions through the graph with a fake arm: what is asked for happens, and whatever can go wrong is said."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from agents.arm_controller.kinematics import Chain
from dsr import Pose

from .conftest import HOME, PERIOD, Bench

CUBE = (0.04, 0.04, 0.04)
PLACES = {"cube_3": (0.42, 0.08), "cube_4": (0.30, 0.08), "cube_5": (0.30, -0.08)}
DOWN = (1.0, 0.0, 0.0, 0.0)


class Table(Bench):
    """An arm at a table with believed cubes; a cube lies between the pads whenever they close."""

    actions = 0

    def lay(self) -> None:
        self.memory.add_node("world", "world")
        self.memory.add_node("table", "table", size=(1.2, 1.2, 0.04))
        self.memory.add_edge("world", "table", "RT", pose=Pose((0.35, 0.0, 0.0)))
        for name, (x, y) in PLACES.items():
            self.believe(name, Pose((x, y, 0.02)))
        self.arm.obstacle = 0.04
        self.run(0.1)

    def believe(self, name: str, pose: Pose, size: tuple[float, float, float] = CUBE) -> None:
        self.memory.add_node(name, "cube", size=size)
        self.memory.add_edge("world", name, "Virtual_RT", pose=pose)

    def request(self, skill: str, **attributes: Any) -> str:
        self.actions += 1
        name = f"action_1_{self.actions}"
        self.memory.add_node(name, "action", skill=skill, status="planned", request="run", **attributes)
        return name

    def finish(self, name: str, seconds: float = 20.0) -> tuple[str, str]:
        """Run until the action has ended; its status and explanation."""
        for _ in range(round(seconds / 0.1)):
            self.run(0.1)
            if self.said(name)[0] not in ("planned", "running"):
                break
        return self.said(name)

    def said(self, name: str) -> tuple[str, str]:
        node = self.memory.node(name)
        return node["status"], node.get("explanation", "")

    def act(self, skill: str, **attributes: Any) -> tuple[str, str]:
        return self.finish(self.request(skill, **attributes))

    def run_to(self, step: str, seconds: float = 15.0) -> None:
        """Run until the action under way is at that step."""
        for _ in range(round(seconds / PERIOD)):
            self.run(PERIOD)
            if self.step == step:
                return
        raise AssertionError(f"the action never came to {step!r}")

    @property
    def step(self) -> str:
        actions = self.agent._actions  # type: ignore[attr-defined]
        return str(actions.step)

    @property
    def grasped(self) -> list[str]:
        return [edge.dst for edge in self.memory.edges("grasping")]

    def tool_pose(self, tool: Chain) -> Pose:
        return tool.forward(self.arm.positions)


@pytest.fixture
def table(make_bench: Callable[..., Any]) -> Table:
    bench: Table = make_bench(Table)
    bench.lay()
    return bench


def pick(table: Table, name: str = "cube_3") -> None:
    assert table.act("pick", target=name) == ("done", "")
    hold(table, name)


def hold(table: Table, name: str) -> None:
    """Let the belief have the object in the gripper."""
    chain = table.agent._chain  # type: ignore[attr-defined]
    pose = chain.forward(table.arm.positions)
    table.believe(name, pose)
    table.run(0.1)


def test_pick_grasps_the_target_and_lifts_it(table: Table, tool: Chain) -> None:
    name = table.request("pick", target="cube_3")
    table.run_to("close")
    assert table.said(name) == ("running", "")
    at = table.tool_pose(tool)
    assert at.t == pytest.approx((0.42, 0.08, 0.023), abs=5e-4)
    assert at.rotation_matrix[:, 2] == pytest.approx((0.0, 0.0, -1.0), abs=1e-3)
    yaw = math.atan2(*at.rotation_matrix[1::-1, 0])
    assert math.remainder(yaw, math.pi / 2) == pytest.approx(0.0, abs=1e-3)
    assert table.finish(name) == ("done", "")
    assert table.grasped == ["cube_3"]
    assert table.tool_pose(tool).t == pytest.approx((0.42, 0.08, 0.103), abs=1e-3)


def test_the_last_part_down_is_straight(table: Table, tool: Chain) -> None:
    table.request("pick", target="cube_4")
    table.run_to("close")
    rows = np.array(next(told for told in reversed(table.arm.told) if told[0] == "follow")[2])
    points = np.array([tool.forward(row).t for row in rows])
    low = points[points[:, 2] < 0.06]
    assert len(low) > 5
    assert np.abs(low[:, :2] - (0.30, 0.08)).max() < 5e-4


def test_place_puts_it_in_the_middle_of_an_object(table: Table, tool: Chain) -> None:
    pick(table)
    name = table.request("place", target="cube_3", destination="cube_4")
    table.run_to("open")
    assert table.tool_pose(tool).t == pytest.approx((0.30, 0.08, 0.064), abs=1e-3)
    assert table.finish(name) == ("done", "")
    assert table.grasped == []
    assert table.tool_pose(tool).t[2] == pytest.approx(0.144, abs=2e-3)


def test_place_on_the_table_stands_where_and_as_it_is_wanted(table: Table, tool: Chain) -> None:
    pick(table)
    wanted = Pose.from_rotvec((0.38, 0.0, 0.02), (0.0, 0.0, 0.3))
    name = table.request("place", target="cube_3", destination="table", target_pose=wanted)
    table.run_to("open")
    at = table.tool_pose(tool)
    assert at.t == pytest.approx((0.38, 0.0, 0.024), abs=1e-3)
    yaw = math.atan2(*at.rotation_matrix[1::-1, 0])
    assert math.remainder(yaw - 0.3, math.pi / 2) == pytest.approx(0.0, abs=0.01)
    assert table.finish(name) == ("done", "")


@pytest.mark.parametrize("step", ["approach", "close", "rise"])
def test_halt_while_picking_holds_still_at_once(table: Table, step: str) -> None:
    name = table.request("pick", target="cube_3")
    table.run_to(step)
    table.memory.update_node(name, request="halt")
    table.run(2 * PERIOD)
    assert table.said(name) == ("halted", "")
    told = len(table.arm.told)
    assert table.arm.told[-1] == ("stop",)
    table.run(2.0)
    assert len(table.arm.told) == told
    assert table.grasped == (["cube_3"] if step == "rise" else table.grasped)


@pytest.mark.parametrize("step", ["approach", "open", "rise"])
def test_removing_a_placing_action_halts_it(table: Table, step: str) -> None:
    pick(table)
    name = table.request("place", target="cube_3", destination="cube_4")
    table.run_to(step)
    table.memory.remove_node(name)
    table.run(2 * PERIOD)
    assert table.arm.told[-1] == ("stop",)
    assert table.step == ""


def test_after_a_halt_with_a_cube_in_hand_it_can_be_placed(table: Table) -> None:
    pick(table)
    name = table.request("place", target="cube_3", destination="cube_4")
    table.run_to("approach")
    table.run(0.5)
    table.memory.update_node(name, request="halt")
    table.run(0.1)
    hold(table, "cube_3")
    assert table.grasped == ["cube_3"]
    assert table.act("place", target="cube_3", destination="cube_5") == ("done", "")


def test_an_action_that_has_ended_does_not_run_again_by_itself(table: Table) -> None:
    name = table.request("observe")
    assert table.finish(name)[0] == "done"
    told = len(table.arm.told)
    table.memory.update_node(name, request="run")
    table.run(0.2)
    assert len(table.arm.told) == told
    table.memory.update_node(name, status="planned", request="run")
    assert table.finish(name)[0] == "done"
    assert len(table.arm.told) > told


def test_a_second_action_is_failed_while_one_runs(table: Table) -> None:
    first = table.request("pick", target="cube_3")
    table.run(0.1)
    assert table.act("observe") == ("failed", f"the arm is busy with {first}")
    assert table.finish(first) == ("done", "")


def test_stop_halts_what_is_running(table: Table) -> None:
    first = table.request("pick", target="cube_3")
    table.run(0.5)
    assert table.act("stop")[0] == "done"
    assert table.said(first)[0] == "halted"
    assert "action_1_2" in table.said(first)[1]


def test_a_dropped_object_is_noticed_on_the_way(table: Table) -> None:
    pick(table)
    name = table.request("place", target="cube_3", destination="cube_5")
    table.run_to("approach")
    table.arm.opening = 0.0
    assert table.finish(name) == ("failed", "dropped cube_3")
    assert table.arm.told[-1] == ("stop",)
    assert table.grasped == []


def test_nothing_between_the_pads_opens_and_retreats(table: Table, tool: Chain) -> None:
    table.arm.obstacle = 0.0
    assert table.act("pick", target="cube_3") == ("failed", "nothing between the pads")
    assert table.arm.opening > 0.05
    assert table.tool_pose(tool).t[2] == pytest.approx(0.103, abs=2e-3)


def test_something_of_another_width_is_not_taken(table: Table) -> None:
    table.arm.obstacle = 0.02
    assert table.act("pick", target="cube_3") == ("failed", "what is between the pads is 20 mm wide, not 40 mm")


def test_a_target_that_moved_is_aimed_at_again(table: Table, tool: Chain) -> None:
    name = table.request("pick", target="cube_3")
    table.run_to("approach")
    table.run(0.6)
    table.believe("cube_3", Pose((0.40, 0.02, 0.02)))
    table.run_to("close")
    assert ("stop",) in table.arm.told
    assert table.tool_pose(tool).t == pytest.approx((0.40, 0.02, 0.023), abs=1e-3)
    assert table.finish(name) == ("done", "")


def test_a_target_that_never_rests_is_given_up(table: Table) -> None:
    name = table.request("pick", target="cube_3")
    for number in range(200):
        table.believe("cube_3", Pose((0.42, 0.08 - 0.006 * (number % 20), 0.02)))
        table.run(0.1)
        if table.said(name)[0] != "running":
            break
    assert table.said(name) == ("failed", "cube_3 keeps moving")


def test_a_target_that_vanishes_fails_the_pick(table: Table) -> None:
    name = table.request("pick", target="cube_3")
    table.run_to("approach")
    table.memory.update_node("cube_3", present=False)
    assert table.finish(name) == ("failed", "cube_3 is not believed to be anywhere")
    assert table.arm.told[-1] == ("stop",)


@pytest.mark.parametrize("destination", ["cube_9", "cube_3"])
def test_a_place_needs_a_destination_that_is_there(table: Table, destination: str) -> None:
    pick(table)
    status, why = table.act("place", target="cube_3", destination=destination)
    assert status == "failed" and destination in why


def test_what_is_out_of_reach_is_said_with_the_arm_at_rest(table: Table) -> None:
    table.believe("cube_7", Pose((0.95, 0.3, 0.02)))
    status, why = table.act("pick", target="cube_7")
    assert status == "failed" and why.startswith("unreachable: ")
    assert not [told for told in table.arm.told if told[0] in ("follow", "move_joints")]


def test_what_stands_on_the_destination_is_in_the_way(table: Table) -> None:
    table.believe("cube_5", Pose((0.30, 0.08, 0.06)))
    pick(table)
    assert table.act("place", target="cube_3", destination="cube_4") == ("failed", "cube_5 is in the way")


def test_what_stands_on_the_target_is_in_the_way(table: Table) -> None:
    table.believe("cube_5", Pose((0.42, 0.08, 0.06)))
    assert table.act("pick", target="cube_3") == ("failed", "cube_5 is in the way")


def test_fingers_go_where_neighbours_leave_room(table: Table, tool: Chain) -> None:
    table.believe("cube_4", Pose((0.42, 0.125, 0.02)))
    table.believe("cube_5", Pose((0.42, 0.035, 0.02)))
    table.request("pick", target="cube_3")
    table.run_to("close")
    pads = table.tool_pose(tool).rotation_matrix[:, 0]
    assert abs(pads[0]) == pytest.approx(1.0, abs=1e-3)


def test_the_arm_goes_round_a_wall(table: Table, tool: Chain) -> None:
    pick(table, "cube_3")
    table.believe("wall", Pose((0.36, 0.0, 0.10)), (0.3, 0.02, 0.2))
    assert table.act("place", target="cube_3", destination="cube_5") == ("done", "")
    rows = [np.array(told[2]) for told in table.arm.told if told[0] == "follow"][-2]
    heights = [tool.forward(row).t[2] for row in rows if abs(tool.forward(row).t[1]) < 0.03]
    assert min(heights) > 0.2


def test_a_box_is_held_across_its_shorter_side(table: Table, tool: Chain) -> None:
    table.believe("cube_3", Pose((0.40, 0.0, 0.03)), (0.04, 0.12, 0.06))
    table.request("pick", target="cube_3")
    table.run_to("close")
    at = table.tool_pose(tool)
    assert abs(at.rotation_matrix[0, 0]) == pytest.approx(1.0, abs=1e-3)
    assert at.t[2] == pytest.approx(0.043, abs=1e-3)


@pytest.mark.parametrize(
    ("pose", "size", "reason"),
    [
        (Pose.from_rotvec((0.4, 0, 0.03), (0.6, 0, 0)), CUBE, "cube_3 leans by 34 degrees"),
        (Pose((0.4, 0, 0.05)), (0.1, 0.1, 0.1), "cube_3 is 100 mm wide, too wide for 85 mm"),
    ],
)
def test_what_cannot_be_grasped_from_above_is_refused(
    table: Table, pose: Pose, size: tuple[float, float, float], reason: str
) -> None:
    table.memory.update_node("cube_3", size=size)
    table.believe("cube_3", pose, size)
    assert table.act("pick", target="cube_3") == ("failed", reason)


@pytest.mark.parametrize(
    ("request_", "reason"),
    [
        ({"skill": "pik", "target": "cube_3"}, "unknown skill 'pik'; did you mean 'pick'?"),
        ({"skill": "pick"}, "the action has no target"),
        ({"skill": "place", "target": "cube_3"}, "the action has no destination"),
        ({"skill": "place", "target": "cube_3", "destination": "cube_4"}, "the gripper holds nothing, not cube_3"),
        ({"skill": "move"}, "where to? the action has no target_pose"),
    ],
)
def test_incomplete_requests_are_failed_with_what_is_missing(
    table: Table, request_: dict[str, str], reason: str
) -> None:
    status, why = table.act(**request_)
    assert (status, why.startswith(reason.rstrip("?"))) == ("failed", True), why


def test_pick_needs_an_empty_gripper_and_place_the_right_object(table: Table) -> None:
    pick(table)
    assert table.act("pick", target="cube_4") == ("failed", "the gripper holds cube_3 already")
    assert table.act("place", target="cube_4", destination="cube_5") == (
        "failed",
        "the gripper holds cube_3, not cube_4",
    )
    status, why = table.act("place", target="cube_3", destination="table")
    assert (status, why) == ("failed", "where on table? the action has no target_pose")


def test_observe_and_move_go_where_they_say(table: Table, tool: Chain) -> None:
    wanted = Pose((0.35, 0.1, 0.2), DOWN)
    assert table.act("move", target_pose=wanted) == ("done", "")
    metres, radians = wanted.distance(table.tool_pose(tool))
    assert metres < 1e-3 and radians < 1e-2
    assert table.act("observe") == ("done", "")
    assert table.arm.positions == pytest.approx(table.agent.config.observe_joints, abs=4e-3)


def test_a_move_into_the_table_is_refused(table: Table) -> None:
    assert table.act("move", target_pose=Pose((0.35, 0.0, 0.005), DOWN)) == ("failed", "table is in the way")


def test_manual_targets_are_refused_while_an_action_runs(table: Table) -> None:
    name = table.request("pick", target="cube_3")
    table.run(0.2)
    arm, gripper = table.memory.node("arm"), table.memory.node("gripper")
    assert arm["status"] == "acting"
    table.memory.update_node("arm", target_joints=HOME)
    table.memory.update_node("gripper", target_opening=0.01)
    table.run(0.1)
    assert (arm["status"], arm["explanation"]) == ("refused", f"target_joints: {name} is running")
    assert (gripper["status"], gripper["explanation"]) == ("refused", f"target_opening: {name} is running")
    assert "target_joints" not in arm and "target_opening" not in gripper
    assert table.finish(name) == ("done", "")
    table.run(0.1)
    assert arm["status"] == gripper["status"] == "idle"
    table.memory.update_node("arm", target_joints=np.array(table.arm.positions) + 0.1)
    table.run(2.0)
    assert arm["status"] == "reached"


def test_an_action_takes_a_manual_target_away(table: Table) -> None:
    table.memory.update_node("arm", target_joints=np.array(HOME) + 0.3, target_speed=0.2)
    table.run(0.2)
    assert table.act("pick", target="cube_3") == ("done", "")
    assert "target_joints" not in table.memory.node("arm")


def test_silence_of_the_driver_fails_the_action_and_the_next(table: Table) -> None:
    name = table.request("pick", target="cube_3")
    table.run(0.5)
    table.run(1.0, silent=True)
    status, why = table.said(name)
    assert status == "failed" and why.startswith("no sample of the arm for")
    second = table.request("observe")
    table.run(0.2, silent=True)
    assert table.said(second)[0] == "failed"
    table.run(0.2)
    assert table.act("observe") == ("done", "")


def test_a_restart_fails_the_action_and_keeps_the_grip(table: Table) -> None:
    pick(table)
    name = table.request("place", target="cube_3", destination="cube_4")
    table.run(0.5)
    table.own.close()
    table.start()
    table.run(0.1)
    assert table.said(name) == ("failed", "the arm controller was restarted")
    assert table.arm.told[-1] == ("stop",)
    hold(table, "cube_3")
    assert table.grasped == ["cube_3"]
    assert table.act("place", target="cube_3", destination="cube_4") == ("done", "")


def test_a_stuck_arm_fails_the_action(table: Table) -> None:
    name = table.request("pick", target="cube_3")
    table.run(0.5)
    table.arm.stuck = True
    status, why = table.finish(name)
    assert status == "failed" and "short of its goal" in why


def test_a_late_arm_is_not_stuck(table: Table) -> None:
    """A simulated reality that its machine cannot keep up with lags behind the clock."""
    table.arm.pace = 0.4
    assert table.act("pick", target="cube_3") == ("done", "")


def test_teardown_holds_still(table: Table) -> None:
    table.request("pick", target="cube_3")
    table.run(0.5)
    table.runner.teardown()
    assert ("stop",) in table.arm.told[-2:]


def test_the_speed_of_the_arm_is_that_of_skills(table: Table) -> None:
    durations = []
    for speed in (0.3, 0.9):
        table.memory.update_node("arm", target_speed=speed)
        assert table.act("move", target_pose=Pose((0.35, 0.1, 0.2), DOWN)) == ("done", "")
        assert table.act("observe") == ("done", "")
        durations.append([told[1][-1] for told in table.arm.told if told[0] == "follow"][-1])
    assert durations[0] > 1.8 * durations[1]


def test_absurd_beliefs_end_in_an_explanation(table: Table) -> None:
    table.believe("cube_4", Pose((0.30, 0.08, 1e9)))
    table.believe("cube_5", Pose((0.30, -0.08, 0.02)), (0.0, 0.04, 1e12))
    assert table.act("pick", target="cube_3")[0] in ("done", "failed")
    assert table.act("pick", target="cube_4")[0] == "failed"
    assert table.act("pick", target="cube_5")[0] == "failed"
    assert table.act("move", target_pose=Pose((1e300, 0.0, 0.0), DOWN))[0] == "failed"


def test_an_error_of_ours_fails_the_action(table: Table, monkeypatch: pytest.MonkeyPatch) -> None:
    name = table.request("pick", target="cube_3")
    table.run(0.5)
    monkeypatch.setattr(table.agent._scene, "object", lambda name: 1 / 0)  # type: ignore[attr-defined]
    with pytest.raises(AssertionError, match="ZeroDivisionError"):
        table.run(0.1)
    monkeypatch.undo()
    table.memory.poll()
    table.exchange(0.0)
    assert table.said(name) == ("failed", "unexpected ZeroDivisionError: division by zero")
