"""Grasps of round things, at rims and from the side: where the tool goes, and what keeps it away."""

from __future__ import annotations

import math

import numpy as np
import pytest

from agents.arm_controller.grasping.forms import form
from agents.arm_controller.grasping.grasps import AT_RIM, FROM_ABOVE, FROM_SIDE, GraspError, grasps
from agents.arm_controller.grasping.room import Room
from agents.arm_controller.grasping.side_grasps import side_grasps
from agents.arm_controller.model.arm_model import arm_model
from agents.arm_controller.model.figure import Figure
from agents.arm_controller.model.urdf import load_robot
from agents.arm_controller.scene import Obstacle
from dsr import Pose
from dsr.math3d.shapes import Part, Shape

from .conftest import GEN3

TABLE = Obstacle("table", Pose((0.35, 0.0, -0.02)), (1.2, 1.2, 0.04))
WIDEST = 0.085
BASE = (0.0, 0.0, 0.0)
SIDES, WALL = 12, 0.003


@pytest.fixture(scope="module")
def figure() -> Figure:
    return Figure(arm_model(load_robot(GEN3)))


def ball(wide: float, pose: Pose | None = None) -> Obstacle:
    size = (wide, wide, wide)
    return Obstacle("thing", pose or Pose((0.4, 0.0, wide / 2)), size, (Part("sphere", size),))


def cylinder(wide: float, high: float) -> Obstacle:
    size = (wide, wide, high)
    return Obstacle("thing", Pose((0.4, 0.0, high / 2)), size, (Part("cylinder", size),))


def lying(wide: float, length: float) -> Obstacle:
    """Along x."""
    turn = Pose.from_rotvec((0.0, 0.0, 0.0), (0.0, math.pi / 2, 0.0))
    shape = (Part("cylinder", (wide, wide, length)),)
    return Obstacle("thing", Pose((0.4, 0.0, wide / 2)) @ turn, (wide, wide, length), shape)


def cup(wide: float, high: float) -> Obstacle:
    parts = [Part("cylinder", (wide, wide, WALL), (0.0, 0.0, (WALL - high) / 2))]
    for turn in (2.0 * math.pi * k / SIDES for k in range(SIDES)):
        away = (wide - WALL) / 2
        at = Pose.from_rotvec((away * math.cos(turn), away * math.sin(turn), WALL / 2), (0.0, 0.0, turn))
        parts.append(Part("box", (WALL, wide * math.tan(math.pi / SIDES), high - WALL), at.t, at.q))
    return Obstacle("thing", Pose((0.4, 0.0, high / 2)), (wide, wide, high), tuple(parts))


def tray(wide: float, high: float) -> Shape:
    away = (wide - WALL) / 2
    walls = [Part("box", (WALL, wide, high), (sign * away, 0.0, 0.0)) for sign in (1.0, -1.0)]
    others = [Part("box", (wide, WALL, high), (0.0, sign * away, 0.0)) for sign in (1.0, -1.0)]
    return (Part("box", (wide, wide, WALL), (0.0, 0.0, (WALL - high) / 2)), *walls, *others)


def test_forms_are_told_apart() -> None:
    assert form(ball(0.04)).ball and form(cylinder(0.04, 0.06)).round and not form(cylinder(0.04, 0.06)).ball
    assert form(cup(0.07, 0.09)).round and len(form(cup(0.07, 0.09)).walls) == SIDES
    square = form(Obstacle("tray", Pose(), (0.2, 0.2, 0.06), tray(0.2, 0.06)))
    assert not square.round and len(square.walls) == 4
    wall = form(cup(0.07, 0.09)).walls[0]
    assert (wall.inner, wall.outer) == pytest.approx((0.032, 0.035), abs=6e-4)


@pytest.mark.parametrize("wide", [0.01, 0.02, 0.04, 0.06, 0.08])
def test_pads_are_around_the_middle_of_a_ball_and_the_palm_is_above_it(figure: Figure, wide: float) -> None:
    found = grasps(ball(wide), Room(figure, [TABLE]), WIDEST)
    for grasp in found:
        height = grasp.world_from_tool.t[2]
        assert height - figure.reach < wide / 2 < height + figure.reach
        assert wide - height < figure.throat(wide) and grasp.width == wide
    yaws = {round(math.atan2(*grasp.world_from_tool.rotation_matrix[1::-1, 0]) % math.pi, 3) for grasp in found}
    assert len(yaws) == 6


def test_a_ball_does_not_lean(figure: Figure) -> None:
    rolled = ball(0.04, Pose.from_rotvec((0.4, 0.0, 0.02), (0.7, 0.2, 0.0)))
    assert min(grasp.rank for grasp in grasps(rolled, Room(figure, [TABLE]), WIDEST))[0] == FROM_ABOVE


def test_a_lying_cylinder_is_held_around_its_middle(figure: Figure) -> None:
    best = min(grasps(lying(0.06, 0.2), Room(figure, [TABLE]), WIDEST), key=lambda grasp: grasp.rank)
    assert best.world_from_tool.t[2] == pytest.approx(0.03, abs=1e-3)
    assert abs(best.world_from_tool.rotation_matrix[1, 0]) == pytest.approx(1.0)


@pytest.mark.parametrize("wide", [0.10, 0.12])
def test_a_wide_cup_is_held_at_its_rim(figure: Figure, wide: float) -> None:
    found = grasps(cup(wide, 0.09), Room(figure, [TABLE]), WIDEST)
    assert {grasp.rank[0] for grasp in found} == {AT_RIM}
    for grasp in found:
        x, y, _ = grasp.world_from_tool.t
        assert math.hypot(x - 0.4, y) == pytest.approx((wide - WALL) / 2, abs=1e-3)
        radial = np.array([x - 0.4, y, 0.0]) / math.hypot(x - 0.4, y)
        assert abs(radial @ grasp.world_from_tool.rotation_matrix[:, 0]) == pytest.approx(1.0)
        assert grasp.width == pytest.approx(WALL, abs=1e-3)


def test_a_cup_that_fits_is_held_around_before_its_rim(figure: Figure) -> None:
    found = sorted(grasps(cup(0.07, 0.09), Room(figure, [TABLE]), WIDEST), key=lambda grasp: grasp.rank)
    assert found[0].rank[0] == FROM_ABOVE and found[0].width == 0.07


def test_what_is_in_a_cup_keeps_the_finger_out(figure: Figure) -> None:
    full = Obstacle("block", Pose((0.4, 0.0, 0.05)), (0.08, 0.08, 0.09))
    with pytest.raises(GraspError, match="block is in the way"):
        grasps(cup(0.12, 0.09), Room(figure, [TABLE, full]), WIDEST)


BOX = Obstacle("thing", Pose((0.4, 0.0, 0.06)), (0.04, 0.06, 0.12))


@pytest.mark.parametrize("thing", [cylinder(0.05, 0.12), cylinder(0.08, 0.12), BOX])
def test_side_grasps_come_from_the_arm_with_level_pads_and_clear_of_the_table(figure: Figure, thing: Obstacle) -> None:
    room = Room(figure, [TABLE])
    found = side_grasps(thing, room, WIDEST, BASE)
    assert found and {grasp.rank[0] for grasp in found} == {FROM_SIDE}
    for grasp in found:
        turn = grasp.world_from_tool.rotation_matrix
        assert turn[2, 0] == pytest.approx(0.0, abs=1e-9) and turn[0, 2] > -0.21
        assert abs(grasp.world_from_tool.t[2] - 0.06) < 0.056
        assert room.blockers([grasp.world_from_tool], grasp.width, grasp.opening) == [()]
    assert min(grasp.rank for grasp in found)[1:3] == (0, 0)


def test_a_low_thing_is_grasped_obliquely(figure: Figure) -> None:
    found = side_grasps(cylinder(0.04, 0.04), Room(figure, [TABLE]), WIDEST, BASE)
    assert found and min(grasp.rank[1] for grasp in found) > 0


def test_what_carries_something_is_not_grasped_from_its_side(figure: Figure) -> None:
    on_it = Obstacle("cube", Pose((0.4, 0.0, 0.14)), (0.04, 0.04, 0.04))
    assert side_grasps(cylinder(0.05, 0.12), Room(figure, [TABLE, on_it]), WIDEST, BASE) == []
    above = Obstacle("roof", Pose((0.4, 0.0, 0.25)), (0.3, 0.3, 0.02))
    assert side_grasps(cylinder(0.05, 0.12), Room(figure, [TABLE, above]), WIDEST, BASE)


def test_a_plate_that_overhangs_is_held_above_and_below(figure: Figure) -> None:
    plate = Obstacle("thing", Pose((0.4, 0.0, 0.115)), (0.14, 0.14, 0.03))
    foot = Obstacle("foot", Pose((0.4, 0.0, 0.05)), (0.05, 0.05, 0.1))
    with pytest.raises(GraspError, match="too wide"):
        grasps(plate, Room(figure, [TABLE, foot]), WIDEST)
    found = side_grasps(plate, Room(figure, [TABLE, foot]), WIDEST, BASE)
    assert found and all(abs(grasp.world_from_tool.rotation_matrix[2, 0]) > 0.99 for grasp in found)
    flat = Obstacle("thing", Pose((0.4, 0.0, 0.015)), (0.14, 0.14, 0.03))
    assert side_grasps(flat, Room(figure, [TABLE]), WIDEST, BASE) == []
