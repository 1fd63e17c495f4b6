"""Skills through the graph with a fake arm: they do what is asked, and say what keeps them from it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from agents.arm_controller.model.kinematics import JointChain
from dsr import Pose

from .conftest import CUBE, DOWN, Table, pick


def test_pick_grasps_the_target_and_lifts_it(table: Table, tool: JointChain) -> None:
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


def test_the_last_part_down_is_straight(table: Table, tool: JointChain) -> None:
    table.request("pick", target="cube_4")
    table.run_to("close")
    rows = np.array(next(told for told in reversed(table.arm.told) if told[0] == "follow")[2])
    points = np.array([tool.forward(row).t for row in rows])
    low = points[points[:, 2] < 0.06]
    assert len(low) > 5
    assert np.abs(low[:, :2] - (0.30, 0.08)).max() < 5e-4


def test_place_puts_it_in_the_middle_of_an_object(table: Table, tool: JointChain) -> None:
    pick(table)
    name = table.request("place", target="cube_3", destination="cube_4")
    table.run_to("open")
    assert table.tool_pose(tool).t == pytest.approx((0.30, 0.08, 0.064), abs=1e-3)
    assert table.finish(name) == ("done", "")
    assert table.grasped == []
    assert table.tool_pose(tool).t[2] == pytest.approx(0.144, abs=2e-3)


def test_place_on_the_table_stands_where_and_as_it_is_wanted(table: Table, tool: JointChain) -> None:
    pick(table)
    wanted = Pose.from_rotvec((0.38, 0.0, 0.02), (0.0, 0.0, 0.3))
    name = table.request("place", target="cube_3", destination="table", target_pose=wanted)
    table.run_to("open")
    at = table.tool_pose(tool)
    assert at.t == pytest.approx((0.38, 0.0, 0.024), abs=1e-3)
    yaw = math.atan2(*at.rotation_matrix[1::-1, 0])
    assert math.remainder(yaw - 0.3, math.pi / 2) == pytest.approx(0.0, abs=0.01)
    assert table.finish(name) == ("done", "")


def test_a_dropped_object_is_noticed_on_the_trajectory(table: Table) -> None:
    pick(table)
    name = table.request("place", target="cube_3", destination="cube_5")
    table.run_to("approach")
    table.arm.opening = 0.0
    assert table.finish(name) == ("failed", "dropped cube_3")
    assert table.arm.told[-1] == ("stop",)
    assert table.grasped == []


def test_nothing_between_the_pads_opens_and_retreats(table: Table, tool: JointChain) -> None:
    table.arm.obstacle = 0.0
    assert table.act("pick", target="cube_3") == ("failed", "nothing between the pads")
    assert table.arm.opening > 0.05
    assert table.tool_pose(tool).t[2] == pytest.approx(0.103, abs=2e-3)


def test_something_of_another_width_is_not_taken(table: Table) -> None:
    table.arm.obstacle = 0.02
    assert table.act("pick", target="cube_3") == ("failed", "what is between the pads is 20 mm wide, not 40 mm")


def test_a_target_that_moved_is_aimed_at_again(table: Table, tool: JointChain) -> None:
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


@pytest.mark.parametrize("perceived", [True, False])
def test_a_destination_that_is_seen_to_move_is_aimed_at_again(table: Table, tool: JointChain, perceived: bool) -> None:
    pick(table)
    name = table.request("place", target="cube_3", destination="cube_4")
    table.run_to("approach")
    table.memory.update_node("cube_4", perceived=perceived)
    table.believe("cube_4", Pose((0.34, 0.05, 0.02)))
    table.run_to("open")
    assert table.tool_pose(tool).t[:2] == pytest.approx((0.34, 0.05) if perceived else (0.30, 0.08), abs=2e-3)
    assert table.finish(name) == ("done", "")


def test_a_destination_that_never_rests_is_given_up(table: Table) -> None:
    pick(table)
    name = table.request("place", target="cube_3", destination="cube_4")
    table.memory.update_node("cube_4", perceived=True)
    for number in range(200):
        table.believe("cube_4", Pose((0.30, 0.08 - 0.012 * (number % 10), 0.02)))
        table.run(0.1)
        if table.said(name)[0] != "running":
            break
    assert table.said(name) == ("failed", "cube_4 keeps moving")


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
    assert not [told for told in table.arm.told if told[0] == "follow"]


def test_what_stands_on_the_destination_is_in_the_trajectory(table: Table) -> None:
    table.believe("cube_5", Pose((0.30, 0.08, 0.06)))
    pick(table)
    assert table.act("place", target="cube_3", destination="cube_4") == ("failed", "cube_5 is in the way")


def test_what_stands_on_the_target_is_in_the_trajectory(table: Table) -> None:
    table.believe("cube_5", Pose((0.42, 0.08, 0.06)))
    reason = "there is no room for the gripper around cube_3: cube_5 is in the way"
    assert table.act("pick", target="cube_3") == ("failed", reason)


def test_fingers_go_where_neighbours_leave_room(table: Table, tool: JointChain) -> None:
    table.believe("cube_4", Pose((0.42, 0.125, 0.02)))
    table.believe("cube_5", Pose((0.42, 0.035, 0.02)))
    table.request("pick", target="cube_3")
    table.run_to("close")
    pads = table.tool_pose(tool).rotation_matrix[:, 0]
    assert abs(pads[0]) == pytest.approx(1.0, abs=1e-3)


def test_the_arm_goes_round_a_wall(table: Table, tool: JointChain) -> None:
    pick(table, "cube_3")
    table.believe("wall", Pose((0.36, 0.0, 0.10)), (0.3, 0.02, 0.2))
    assert table.act("place", target="cube_3", destination="cube_5") == ("done", "")
    rows = [np.array(told[2]) for told in table.arm.told if told[0] == "follow"][-2]
    heights = [tool.forward(row).t[2] for row in rows if abs(tool.forward(row).t[1]) < 0.03]
    assert min(heights) > 0.2


def test_a_box_is_held_across_its_shorter_side(table: Table, tool: JointChain) -> None:
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
        (Pose((0.4, 0, 0.004)), (0.04, 0.04, 0.008), "cube_3 is 8.0 mm high, too low: expected at least 9.0 mm"),
    ],
)
def test_what_cannot_be_grasped_from_above_is_refused(
    table: Table, pose: Pose, size: tuple[float, float, float], reason: str
) -> None:
    table.memory.update_node("cube_3", size=size)
    table.believe("cube_3", pose, size)
    assert table.act("pick", target="cube_3") == ("failed", reason)
    assert hopeless(table)


def test_where_walls_leave_no_room_the_arm_does_not_set_out_and_says_so(table: Table) -> None:
    for name, y in (("left", 0.125), ("right", 0.035)):
        table.believe(name, Pose((0.42, y, 0.08)), (0.2, 0.02, 0.16))
    reason = "there is no room for the gripper around cube_3: left, right are in the way"
    assert table.act("pick", target="cube_3") == ("failed", reason)
    assert hopeless(table)
    assert not [told for told in table.arm.told if told[0] == "follow"]
    table.believe("right", Pose((0.42, -0.1, 0.05)), (0.2, 0.02, 0.1))
    table.believe("left", Pose((0.42, 0.3, 0.05)), (0.2, 0.02, 0.1))
    table.memory.update_node(f"action_1_{table.actions}", status="planned", request="run")
    assert table.finish(f"action_1_{table.actions}") == ("done", "") and not hopeless(table)


def test_what_is_in_the_way_of_the_arm_is_not_hopeless(table: Table) -> None:
    for name, x, y in (("left", 0.0, 0.15), ("right", 0.0, -0.15), ("far", 0.15, 0.0), ("near", -0.15, 0.0)):
        table.believe(name, Pose((0.42 + x, 0.08 + y, 0.12)), (0.3, 0.02, 0.24) if y else (0.02, 0.28, 0.24))
    table.believe("roof", Pose((0.42, 0.08, 0.25)), (0.34, 0.34, 0.02))
    assert table.act("pick", target="cube_3") == ("failed", "roof is in the way")
    assert not hopeless(table)


def test_below_a_roof_an_object_is_grasped_from_its_side(table: Table, tool: JointChain) -> None:
    table.believe("roof", Pose((0.42, 0.08, 0.25)), (0.3, 0.3, 0.02))
    name = table.request("pick", target="cube_3")
    table.run_to("close")
    at = table.tool_pose(tool)
    assert at.rotation_matrix[2, 2] > -0.9 and abs(at.rotation_matrix[2, 0]) < 1e-3
    assert math.dist(at.t, (0.42, 0.08, 0.02)) < 0.015
    assert table.finish(name) == ("done", "")


@pytest.mark.parametrize("height", [0.010, 0.020, 0.035, 0.036])
@pytest.mark.parametrize("sunk", [0.0, 0.001])
def test_a_low_object_is_grasped_with_the_pads_above_what_it_stands_on(
    table: Table, tool: JointChain, height: float, sunk: float
) -> None:
    """Also where it is believed to be a little in the table: heights come from perception."""
    table.believe("cube_3", Pose((0.42, 0.08, height / 2 - sunk)), (0.04, 0.04, height))
    table.memory.update_node("cube_3", size=(0.04, 0.04, height))
    name = table.request("pick", target="cube_3")
    table.run_to("close")
    assert table.tool_pose(tool).t[2] - 0.015 == pytest.approx(max(0.004, height - sunk - 0.032), abs=5e-4)
    assert table.finish(name) == ("done", "")


def test_the_grasp_is_raised_over_what_is_low_beside_the_object(table: Table, tool: JointChain) -> None:
    for number, (x, y) in enumerate(((0.06, 0.0), (-0.06, 0.0), (0.0, 0.06), (0.0, -0.06))):
        table.believe(f"tile_{number}", Pose((0.42 + x, 0.08 + y, 0.01)), (0.06, 0.06, 0.02))
    table.request("pick", target="cube_3")
    table.run_to("close")
    assert table.tool_pose(tool).t[2] - 0.015 == pytest.approx(0.0235, abs=1e-3)


def test_beside_a_wall_the_object_is_held_off_its_middle(table: Table, tool: JointChain) -> None:
    """The wall is 32 mm from the middle, half of the flange is 37.5 mm; towards the wall the fingers have no room."""
    table.believe("wall", Pose((0.462, 0.08, 0.08)), (0.02, 0.3, 0.16))
    name = table.request("pick", target="cube_3")
    table.run_to("close")
    at = table.tool_pose(tool)
    assert abs(at.rotation_matrix[1, 0]) == pytest.approx(1.0, abs=1e-3)
    assert at.t[:2] == pytest.approx((0.41, 0.08), abs=1e-3)
    assert table.finish(name) == ("done", "")


def test_in_a_shaft_the_gripper_may_be_close_to_its_walls_on_all_of_the_way_down(table: Table) -> None:
    """The flange passes the far one 8.5 mm away, also above the last 80 mm; the others keep it from coming aside."""
    for name, x, y in (("left", 0.0, 0.08), ("right", 0.0, -0.08), ("far", 0.056, 0.0), ("near", -0.08, 0.0)):
        table.believe(name, Pose((0.42 + x, 0.08 + y, 0.085)), (0.2, 0.02, 0.17) if y else (0.02, 0.14, 0.17))
    assert table.act("pick", target="cube_3") == ("done", "")


@pytest.mark.parametrize(("width", "opening"), [(0.01, 0.04), (0.06, 0.085), (0.08, 0.085)])
def test_narrow_and_wide_objects_are_grasped(table: Table, width: float, opening: float) -> None:
    table.believe("cube_3", Pose((0.42, 0.0, 0.02)), (width, width, 0.04))
    table.memory.update_node("cube_3", size=(width, width, 0.04))
    table.arm.obstacle = width
    assert table.act("pick", target="cube_3") == ("done", "")
    assert ("move_gripper", pytest.approx(opening)) in table.arm.told


def hopeless(table: Table) -> bool:
    return table.memory.node(f"action_1_{table.actions}").get("hopeless") is True


def test_pick_needs_an_empty_gripper_and_place_the_right_object(table: Table) -> None:
    pick(table)
    assert table.act("pick", target="cube_4") == ("failed", "the gripper holds cube_3 already")
    assert table.act("place", target="cube_4", destination="cube_5") == (
        "failed",
        "the gripper holds cube_3, not cube_4",
    )
    status, why = table.act("place", target="cube_3", destination="table")
    assert (status, why) == ("failed", "where on table? the action has no target_pose")


def test_observe_and_move_go_where_they_say(table: Table, tool: JointChain) -> None:
    wanted = Pose((0.35, 0.1, 0.2), DOWN)
    assert table.act("move", target_pose=wanted) == ("done", "")
    metres, radians = wanted.distance(table.tool_pose(tool))
    assert metres < 1e-3 and radians < 1e-2
    assert table.act("observe") == ("done", "")
    assert table.arm.positions == pytest.approx(table.agent.config.observe_joints, abs=4e-3)


def test_a_move_into_the_table_is_refused(table: Table) -> None:
    assert table.act("move", target_pose=Pose((0.35, 0.0, 0.005), DOWN)) == ("failed", "table is in the way")


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


def test_nothing_is_put_into_an_object_with_a_mesh(table: Table) -> None:
    """Such as `dsr load` makes: its box is in the way, but for what the robot carries or what is around its base."""
    memory = table.memory
    memory.add_node("shelf", "object", bounds=(-0.1, -0.1, 0.0, 0.1, 0.1, 0.3))
    memory.add_edge("world", "shelf", "RT", pose=Pose((0.42, -0.25, 0.0)))
    memory.add_node("room", "object", bounds=(-3.0, -3.0, -1.0, 3.0, 3.0, 2.0))
    memory.add_edge("world", "room", "RT", pose=Pose())
    memory.add_node("sensor", "object", bounds=(-0.1, -0.1, -0.1, 0.1, 0.1, 0.1))
    memory.add_edge("gripper", "sensor", "RT", pose=Pose())
    pick(table)
    status, why = table.act("place", destination="table", target_pose=Pose((0.42, -0.25, 0.02)))
    assert status == "failed" and "shelf is in the way" in why
    assert table.act("place", destination="table", target_pose=Pose((0.30, 0.2, 0.02)))[0] == "done"


@pytest.mark.parametrize("place", [(0.45, 0.2), (0.1, -0.4)])
def test_look_brings_the_camera_there_turned_as_it_suits(
    make_bench: Callable[..., Any], tool: JointChain, place: tuple[float, float]
) -> None:
    table: Table = make_bench(Table, cameras={"camera_wrist": {"driver": "fake:Camera", "link": "camera_wrist_link"}})
    table.lay()
    wanted = Pose((*place, 0.3), DOWN)
    assert table.act("look", target="camera_wrist", target_pose=wanted) == ("done", "")
    found = table.memory.transform("world", "camera_wrist")
    assert found.t == pytest.approx(wanted.t, abs=1e-3)
    assert found.rotation_matrix[:, 2] == pytest.approx((0.0, 0.0, -1.0), abs=1e-3)
    yaw = math.atan2(*found.rotation_matrix[1::-1, 0])
    assert math.remainder(yaw, math.pi / 4) == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize(
    ("attributes", "reason"),
    [
        ({}, "the action has no target"),
        ({"target": "camera_wrist"}, "where from? the action has no target_pose"),
        ({"target": "cube_3", "target_pose": Pose((0.4, 0.0, 0.3), DOWN)}, "cube_3 is not carried by gripper"),
        ({"target": "nothing", "target_pose": Pose((0.4, 0.0, 0.3), DOWN)}, "nothing is not carried by gripper"),
    ],
)
def test_a_look_that_cannot_be_says_why(table: Table, attributes: dict[str, Any], reason: str) -> None:
    assert table.act("look", **attributes) == ("failed", reason)


def test_a_wall_that_is_too_high_is_passed_at_its_end(table: Table, tool: JointChain) -> None:
    """Over it there is no way; the arm goes between the wall and its own base."""
    assert table.act("move", target_pose=Pose((0.40, 0.25, 0.20), DOWN)) == ("done", "")
    table.believe("wall", Pose((0.55, 0.0, 0.7)), (0.5, 0.02, 1.4))
    there = Pose((0.40, -0.25, 0.20), DOWN)
    assert table.act("move", target_pose=there) == ("done", "")
    assert there.distance(table.tool_pose(tool))[0] < 1e-3
    rows = np.array([told for told in table.arm.told if told[0] == "follow"][-1][2])
    tips = np.array([tool.forward(row).t for row in rows])
    assert tips[np.abs(tips[:, 1]) < 0.02, 0].max() < 0.29


def test_what_is_held_stays_upright_on_a_searched_way(table: Table, tool: JointChain) -> None:
    pick(table)
    table.believe("wall", Pose((0.65, 0.0, 0.7)), (0.5, 0.02, 1.4))
    table.believe("cube_5", Pose((0.44, -0.15, 0.02)))
    assert table.act("place", target="cube_3", destination="cube_5") == ("done", "")
    rows = np.array([told for told in table.arm.told if told[0] == "follow"][-2][2])
    assert min(-tool.forward(row).rotation_matrix[2, 2] for row in rows) > math.cos(0.61)


def test_a_goal_behind_walls_on_all_sides_is_given_up_with_what_is_in_the_way(table: Table) -> None:
    for name, x, y, size in (
        ("left", 0.4, 0.15, (0.4, 0.02, 0.8)), ("right", 0.4, -0.15, (0.4, 0.02, 0.8)),
        ("near", 0.22, 0.0, (0.02, 0.3, 0.8)), ("far", 0.58, 0.0, (0.02, 0.3, 0.8)),
    ):  # fmt: skip
        table.believe(name, Pose((x, y, 0.4)), size)
    table.believe("roof", Pose((0.4, 0.0, 0.45)), (0.4, 0.3, 0.02))
    status, why = table.act("move", target_pose=Pose((0.40, 0.0, 0.15), DOWN))
    assert status == "failed" and why.endswith("is in the way")


def test_a_search_is_ended_by_a_halt(table: Table) -> None:
    assert table.act("move", target_pose=Pose((0.40, 0.25, 0.20), DOWN)) == ("done", "")
    table.believe("wall", Pose((0.55, 0.0, 0.7)), (0.5, 0.02, 1.4))
    name = table.request("move", target_pose=Pose((0.40, -0.25, 0.20), DOWN))
    table.run_to("plan")
    table.memory.update_node(name, request="halt")
    table.run(0.06)
    assert table.said(name)[0] == "halted"


def slip(table: Table) -> None:
    """Let what is being lifted slip out of the gripper, which then sets out again."""
    table.run_to("rise")
    table.arm.opening, table.arm.obstacle = 0.0, 0.0
    table.run_to("approach")
    table.arm.obstacle = 0.04


def test_what_slips_out_is_grasped_again_and_that_is_told(table: Table) -> None:
    name = table.request("pick", target="cube_3")
    slip(table)
    assert table.said(name)[0] == "running"
    assert table.said(name)[1] in ("dropped cube_3: grasp 2 of 3", "cube_3 slipped out: grasp 2 of 3")
    assert table.finish(name) == ("done", "")
    assert table.grasped == ["cube_3"]


def test_what_slips_out_again_and_again_is_given_up(table: Table) -> None:
    name = table.request("pick", target="cube_3")
    slip(table)
    slip(table)
    table.run_to("rise")
    table.arm.opening, table.arm.obstacle = 0.0, 0.0
    status, why = table.finish(name)
    assert status == "failed" and why.endswith(", as 3 times")
    assert table.arm.opening > 0.05 and table.grasped == []


@pytest.mark.parametrize("perceived", [True, False])
def test_what_is_seen_where_it_stood_was_left_behind(table: Table, perceived: bool) -> None:
    """The pads touch something, but the object is still on the table; what is not seen may well be in the gripper."""
    table.memory.update_node("cube_3", perceived=perceived)
    said = table.act("pick", target="cube_3")
    assert said == (("failed", "cube_3 was left behind, as 3 times") if perceived else ("done", ""))
