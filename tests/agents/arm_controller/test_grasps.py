"""Top grasps and the room for them: how deep, how far off the middle, how wide, and what takes the room."""

from __future__ import annotations

import numpy as np
import pytest

from agents.arm_controller.grasping.grasps import LEAST_HOLD, Grasp, GraspError, grasps
from agents.arm_controller.grasping.room import Room
from agents.arm_controller.model.arm_model import arm_model
from agents.arm_controller.model.figure import Figure
from agents.arm_controller.model.urdf import load_robot
from agents.arm_controller.motion.obstacles import GRIPPER_MARGIN
from agents.arm_controller.scene import Obstacle
from dsr import Pose

from .conftest import GEN3

TABLE = Obstacle("table", Pose((0.35, 0.0, -0.02)), (1.2, 1.2, 0.04))
WIDEST = 0.085


@pytest.fixture(scope="module")
def figure() -> Figure:
    return Figure(arm_model(load_robot(GEN3)))


def box(wide: float, high: float, *, sunk: float = 0.0, deep: float | None = None) -> Obstacle:
    return Obstacle("box", Pose((0.4, 0.0, high / 2 - sunk)), (wide, wide if deep is None else deep, high))


def wall(x: float, *, high: float = 0.15, name: str = "wall") -> Obstacle:
    """Its middle is at x (m); 20 mm thick, along y."""
    return Obstacle(name, Pose((x, 0.0, high / 2)), (0.02, 0.3, high))


def best(figure: Figure, thing: Obstacle, *around: Obstacle) -> Grasp:
    return min(grasps(thing, Room(figure, [TABLE, *around]), WIDEST), key=lambda grasp: grasp.rank)


def low(grasp: Grasp) -> float:
    """Height of the pads' lower edge."""
    return grasp.world_from_tool.t[2] - 0.015


@pytest.mark.parametrize("high", [0.0091, 0.010, 0.0175, 0.0351, 0.036, 0.08])
@pytest.mark.parametrize("sunk", [0.0, 1e-8, 0.002, -0.002])
def test_pads_keep_their_margin_and_hold_enough(figure: Figure, high: float, sunk: float) -> None:
    """Whatever rounding and perception do to the height: what is believed to be lower is held higher up."""
    thing = box(0.04, high, sunk=sunk)
    if high - sunk < GRIPPER_MARGIN + LEAST_HOLD + 0.0001:
        with pytest.raises(GraspError, match="no room for the gripper around box: table is in the way"):
            best(figure, thing)
        return
    grasp = best(figure, thing)
    assert low(grasp) >= GRIPPER_MARGIN
    assert high - sunk - low(grasp) >= LEAST_HOLD - 1e-9
    assert low(grasp) <= max(high - sunk - 0.032, 0.0051 - min(sunk, 0.0)) + 1e-9


def test_what_the_object_stands_on_need_not_be_known(figure: Figure) -> None:
    found = grasps(box(0.04, 0.01), Room(figure, []), WIDEST)
    assert {round(low(grasp), 6) for grasp in found} == {GRIPPER_MARGIN + 0.001}


@pytest.mark.parametrize(
    ("wide", "openings"), [(0.01, [40, 22, 14]), (0.06, [85, 72, 64]), (0.08, [85, 84]), (0.081, [85])]
)
def test_fingers_open_wider_than_the_object_by_what_the_gripper_allows(
    figure: Figure, wide: float, openings: list[int]
) -> None:
    found = grasps(box(wide, 0.04), Room(figure, [TABLE]), WIDEST)
    assert sorted({round(grasp.opening * 1e3) for grasp in found}, reverse=True) == openings
    with pytest.raises(GraspError, match="box is 82 mm wide, too wide for 85 mm"):
        grasps(box(0.082, 0.04), Room(figure, [TABLE]), WIDEST)


def test_what_is_low_beside_the_object_is_passed_over(figure: Figure) -> None:
    tiles = [Obstacle(f"tile_{n}", Pose((0.4 + x, y, 0.01)), (0.06, 0.06, 0.02)) for n, (x, y) in enumerate(_AROUND)]
    assert low(best(figure, box(0.04, 0.04), *tiles)) == pytest.approx(0.0235, abs=5e-4)
    assert low(best(figure, box(0.04, 0.04), tiles[0])) == pytest.approx(0.008)


def test_beside_a_wall_it_is_held_off_its_middle_with_the_camera_on_the_other_side(figure: Figure) -> None:
    """Flange, wrist and the camera at the wrist move with the tool; the camera looks along the tool's y axis."""
    found = grasps(box(0.06, 0.03), Room(figure, [TABLE, wall(0.45)]), WIDEST)
    assert found and all(grasp.rank[2] == 1 for grasp in found)
    deepest = [grasp for grasp in found if low(grasp) < 0.005]
    assert deepest
    for grasp in deepest:
        assert grasp.world_from_tool.t[0] == pytest.approx(0.3975)
        assert grasp.world_from_tool.rotation_matrix[0, 1] == pytest.approx(-1.0)


def test_an_object_is_not_held_at_its_end(figure: Figure) -> None:
    with pytest.raises(GraspError, match="no room for the gripper around box: wall is in the way"):
        best(figure, box(0.04, 0.03), wall(0.4 + 0.02 + 0.005 + 0.01))


def test_all_that_takes_the_room_is_named(figure: Figure) -> None:
    walls = [wall(0.4 - 0.045, name="left"), wall(0.4 + 0.045, name="right")]
    with pytest.raises(GraspError, match="no room for the gripper around box: left, right are in the way"):
        best(figure, box(0.04, 0.03), *walls)


def test_room_is_needed_until_the_fingers_are_closed(figure: Figure) -> None:
    """What stands between an open finger and the object would be squeezed."""
    pins = [
        Obstacle(f"pin_{n}", Pose((0.4 + x / 2, y / 2, 0.02)), (0.002, 0.002, 0.04)) for n, (x, y) in enumerate(_AROUND)
    ]
    with pytest.raises(GraspError, match="pin_0, pin_1, pin_2, pin_3 are in the way"):
        best(figure, box(0.04, 0.04), *pins)


def test_the_shorter_side_is_gripped_unless_that_holds_less(figure: Figure) -> None:
    thing = box(0.04, 0.04, deep=0.06)
    assert abs(best(figure, thing).world_from_tool.rotation_matrix[0, 0]) == pytest.approx(1.0)
    beside = [
        Obstacle(name, Pose((0.4 + x, 0.0, 0.0125)), (0.05, 0.2, 0.025)) for name, x in (("a", 0.05), ("b", -0.05))
    ]
    grasp = best(figure, thing, *beside)
    assert np.abs(grasp.world_from_tool.rotation_matrix[1, 0]) == pytest.approx(1.0)
    assert low(grasp) == pytest.approx(0.008)


_AROUND = ((0.06, 0.0), (-0.06, 0.0), (0.0, 0.06), (0.0, -0.06))
