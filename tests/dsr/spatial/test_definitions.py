"""Spatial relations: known cases, and properties that hold of all boxes."""

from __future__ import annotations

import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from dsr import Pose
from dsr.spatial import MIRRORED, SPATIAL, Box, View, margin
from dsr.spatial.boxes import gap, inclusion, overlap
from dsr.spatial.definitions import EPSILON

CUBE = (0.04, 0.04, 0.04)
ALONG_X = View((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
PLACES = st.floats(-0.3, 0.3)
EDGES = st.floats(0.01, 0.3)


def cube(x: float, y: float, z: float, yaw: float = 0.0, size: tuple[float, float, float] = CUBE) -> Box:
    return Box(Pose.from_rotvec((x, y, z), (0.0, 0.0, yaw)), size)


@st.composite
def boxes(draw: st.DrawFn) -> Box:
    turn = [draw(st.floats(-3.0, 3.0)) for _ in range(3)]
    place = [draw(PLACES) for _ in range(3)]
    return Box(Pose.from_rotvec(place, turn), (draw(EDGES), draw(EDGES), draw(EDGES)))


@st.composite
def views(draw: st.DrawFn) -> View:
    angle = draw(st.floats(-math.pi, math.pi))
    x, y = math.cos(angle), math.sin(angle)
    return View((x, y, 0.0), (-y, x, 0.0))


@given(boxes(), boxes(), views())
def test_mirrored_relations_hold_the_other_way_round_by_the_same_margin(a: Box, b: Box, view: View) -> None:
    for relation, mirrored in MIRRORED.items():
        assert margin(relation, a, b, view) == pytest.approx(margin(mirrored, b, a, view), abs=1e-12)


@given(boxes(), boxes(), views())
def test_opposites_exclude_each_other(a: Box, b: Box, view: View) -> None:
    assume(math.dist(a.pose.t, b.pose.t) > 1e-6)
    for one, other in (("left_of", "right_of"), ("in_front_of", "behind")):
        assert min(margin(one, a, b, view), margin(other, a, b, view)) <= 1e-12
    assume(min(a.top - a.bottom, b.top - b.bottom) > EPSILON)
    assert min(margin("above", a, b), margin("below", a, b)) < 0.0
    assert min(margin("on_top", a, b), margin("in", a, b)) <= 1e-12


@given(boxes(), boxes(), views(), PLACES, PLACES, PLACES, st.floats(-3.0, 3.0))
def test_where_the_world_begins_and_which_way_it_is_turned_does_not_matter(
    a: Box, b: Box, view: View, x: float, y: float, z: float, yaw: float
) -> None:
    moved = Pose.from_rotvec((x, y, z), (0.0, 0.0, yaw))
    turned = View(
        tuple(moved.rotation_matrix @ view.away),  # type: ignore[arg-type]
        tuple(moved.rotation_matrix @ view.left),  # type: ignore[arg-type]
    )
    for relation in SPATIAL:
        there = margin(relation, Box(moved @ a.pose, a.size), Box(moved @ b.pose, b.size), turned)
        assert there == pytest.approx(margin(relation, a, b, view), abs=1e-7)


@given(boxes(), boxes(), st.floats(0.0, 0.05), st.floats(-math.pi, math.pi), st.floats(-1.0, 1.0))
def test_a_small_motion_changes_margins_by_as_little(a: Box, b: Box, length: float, angle: float, slope: float) -> None:
    """Otherwise hysteresis could not keep noise from flickering."""
    flat = length * math.sqrt(1.0 - slope * slope)
    x, y, z = (p + d for p, d in zip(a.pose.t, (flat * math.cos(angle), flat * math.sin(angle), length * slope),
                                     strict=True))  # fmt: skip
    moved = Box(Pose((x, y, z), a.pose.q), a.size)
    near = 0.5 * (a.diagonal + b.diagonal) > math.dist(a.pose.t, b.pose.t) + 0.06  # beyond, overlap is a bound only
    for relation in SPATIAL:
        before, after = margin(relation, a, b, ALONG_X), margin(relation, moved, b, ALONG_X)
        if near or max(before, after) >= 0.0:
            assert abs(after - before) <= length + 1e-9 or not near


@given(boxes(), boxes())
def test_footprints_that_overlap_are_not_apart(a: Box, b: Box) -> None:
    assert overlap(a, b) == pytest.approx(overlap(b, a)) and gap(a, b) == pytest.approx(gap(b, a))
    assert (overlap(a, b) >= 0.0) == (gap(a, b) <= 0.0)
    assert gap(a, b) >= -overlap(a, b) - 1e-12
    assert inclusion(a, a) == pytest.approx(0.0, abs=1e-9)
    if inclusion(a, b) > 0.0:
        assert overlap(a, b) > 0.0


@given(boxes())
def test_a_footprint_is_convex_and_holds_the_projection_of_all_corners(box: Box) -> None:
    for signs in range(8):
        corner = [0.5 * edge * (1 if signs >> k & 1 else -1) for k, edge in enumerate(box.size)]
        point = box.pose.apply([corner])[0]
        dot = Box(Pose((float(point[0]), float(point[1]), 0.0)), (1e-9, 1e-9, 1e-9))
        assert inclusion(dot, box) > -1e-6
    assert box.bottom <= min(box.pose.t[2], box.top) and 3 <= len(box.footprint) <= 8


def holding(a: Box, b: Box, view: View | None = ALONG_X) -> set[str]:
    return {relation for relation in SPATIAL if margin(relation, a, b, view) >= 0.0}


def test_a_cube_on_another() -> None:
    assert holding(cube(0.0, 0.0, 0.06), cube(0.0, 0.0, 0.02)) == {"above", "on_top", "close_to"}
    assert holding(cube(0.0, 0.0, 0.02), cube(0.0, 0.0, 0.06)) == {"below", "close_to"}
    assert holding(cube(0.0, 0.0, 0.10), cube(0.0, 0.0, 0.02)) == {"above", "close_to"}


def test_cubes_side_by_side() -> None:
    assert holding(cube(0.0, 0.05, 0.02), cube(0.0, 0.0, 0.02)) == {"next_to", "close_to", "left_of"}
    assert holding(cube(0.05, 0.0, 0.02), cube(0.0, 0.0, 0.02)) == {"next_to", "close_to", "behind"}
    assert holding(cube(-0.05, -0.05, 0.02), cube(0.0, 0.0, 0.02)) == {
        "next_to", "close_to", "right_of", "in_front_of",
    }  # fmt: skip
    assert holding(cube(0.0, 0.3, 0.02), cube(0.0, 0.0, 0.02)) == {"left_of"}
    assert "next_to" not in holding(cube(0.0, 0.05, 0.08), cube(0.0, 0.0, 0.02))


def test_turned_boxes_overlap_by_what_they_are_and_not_by_the_boxes_around_them() -> None:
    long = (0.2, 0.01, 0.02)
    a, b = cube(0.0, 0.0, 0.01, math.pi / 4, long), cube(0.06, -0.06, 0.05, math.pi / 4, long)
    assert "above" not in holding(b, a) and overlap(a, b) == pytest.approx(0.01 - 0.06 * math.sqrt(2.0))


def test_a_ball_in_a_cup_is_in_it_and_not_on_top() -> None:
    cup, ball = (0.07, 0.07, 0.09), (0.03, 0.03, 0.03)
    assert "in" in holding(cube(0.01, 0.0, 0.02, size=ball), cube(0.0, 0.0, 0.045, size=cup))
    resting = cube(0.0, 0.0, 0.105, size=ball)
    assert holding(resting, cube(0.0, 0.0, 0.045, size=cup)) == {"above", "on_top", "close_to"}
    beside = cube(0.06, 0.0, 0.015, size=ball)
    assert "in" not in holding(beside, cube(0.0, 0.0, 0.045, size=cup))


def test_a_large_thing_makes_more_close() -> None:
    table = cube(0.0, 0.0, -0.02, size=(1.0, 1.0, 0.04))
    assert "close_to" in holding(cube(0.5, 0.0, 0.02), table) and "close_to" not in holding(table, cube(0.5, 0, 0.02))


@pytest.mark.parametrize(
    ("rotvec", "optical", "away", "left"),
    [
        ((0.0, 0.0, 0.0), False, (1, 0), (0, 1)),  # a body that looks along x
        ((0.0, 0.0, math.pi / 2), False, (0, 1), (-1, 0)),
        ((0.0, math.pi / 2, 0.0), False, (1, 0), (0, 1)),  # and down
        ((0.0, -math.pi / 2, 0.0), False, (1, 0), (0, 1)),  # and up
        ((-math.pi / 2, 0.0, 0.0), True, (0, 1), (-1, 0)),  # a camera that looks along y
        ((math.pi, 0.0, 0.0), True, (0, 1), (-1, 0)),  # and down: the upper edge of the image is towards y
        ((0.0, 0.0, 0.0), True, (0, 1), (-1, 0)),  # and up, having looked along y before
    ],
)
def test_the_view_of_a_frame(
    rotvec: tuple[float, ...], optical: bool, away: tuple[int, int], left: tuple[int, int]
) -> None:
    view = View.of(Pose.from_rotvec((0.1, 0.2, 0.3), rotvec), optical=optical)
    assert view.away == pytest.approx((*away, 0.0), abs=1e-9) and view.left == pytest.approx((*left, 0.0), abs=1e-9)


def test_what_depends_on_who_looks_needs_a_view() -> None:
    with pytest.raises(ValueError, match="needs a view"):
        margin("left_of", cube(0, 0, 0), cube(1, 0, 0))
    with pytest.raises(KeyError):
        margin("north_of", cube(0, 0, 0), cube(1, 0, 0), ALONG_X)
