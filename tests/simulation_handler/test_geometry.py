"""Laws of footprints, overlaps and face-down rotations."""

from __future__ import annotations

import gc
import math
import weakref

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from dsr.math3d import quaternions
from dsr.math3d.polygons import are_apart, area, contains, intersection, overlap
from dsr.math3d.quaternions import Quaternion
from dsr.math3d.shapes import Part
from dsr.math3d.transforms import Pose
from simulation_handler.shapes.faces import faces
from simulation_handler.shapes.geometry import Solid, face_down
from tests.simulation_handler.worlds import beaker, container

COORDINATE = st.floats(-1.0, 1.0)
ANGLE = st.floats(-math.pi, math.pi)
ROTATION = st.tuples(ANGLE, ANGLE, ANGLE).map(quaternions.from_rotvec)
SMALL = st.floats(0.01, 0.2)
FLAT = st.builds(
    lambda x, y, yaw, a, b: Solid("s", (a, b, 0.04), (x, y, 0.0), quaternions.from_rotvec((0.0, 0.0, yaw))),
    st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), ANGLE, SMALL, SMALL,
)  # fmt: skip


@given(ROTATION)
def test_face_down_is_flat_and_as_far_as_it_says(rotation: Quaternion) -> None:
    flat, tilt = face_down(rotation)
    down = np.abs(quaternions.to_matrix(flat)[2])
    assert np.sort(down) == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)
    assert Pose(rotation=rotation).distance(Pose(rotation=flat))[1] == pytest.approx(tilt, abs=1e-7)
    assert tilt <= math.acos(1 / math.sqrt(3)) + 1e-9


@given(ANGLE, st.floats(-0.5, 0.5), ANGLE)
def test_face_down_keeps_yaw(yaw: float, tilt: float, direction: float) -> None:
    upright = Pose.from_rotvec((0, 0, 0), (0.0, 0.0, yaw))
    tipped = Pose.from_rotvec((0, 0, 0), (tilt * math.cos(direction), tilt * math.sin(direction), 0.0)) @ upright
    flat, found = face_down(tipped.q)
    assert found == pytest.approx(abs(tilt), abs=1e-7)
    assert Pose(rotation=flat).distance(upright)[1] < 1e-6


BEAKER = (0.09, 0.09, 0.08)


@given(ANGLE, st.floats(-0.2, 0.2), ANGLE)
@example(roll=1e-4, lean=0.0, yaw=0.0)
def test_a_round_body_lies_on_the_next_of_its_sides(roll: float, lean: float, yaw: float) -> None:
    lying = Pose.from_rotvec((0, 0, 0), (0, 0, yaw)) @ Pose.from_rotvec((0, 0, 0), (0.5 * math.pi + lean, 0, 0))
    rotation = (lying @ Pose.from_rotvec((0, 0, 0), (0, 0, roll))).q
    off = abs(math.remainder(roll, math.pi / 6))
    walled = Solid("b", BEAKER, (0.0, 0.0, 0.0), rotation, shape=beaker(BEAKER))
    flat, tilt = walled.face_down()
    assert max(off, abs(lean)) - 0.01 <= tilt <= off + abs(lean) + 0.01
    assert flat.half_height == pytest.approx(0.045, abs=1e-4)
    full = Solid("c", BEAKER, (0.0, 0.0, 0.0), rotation, shape=(Part("cylinder", BEAKER),))
    flat, tilt = full.face_down()
    assert tilt == pytest.approx(abs(lean), abs=1e-6)
    assert flat.half_height == pytest.approx(0.045, abs=1e-6)


@given(ROTATION)
def test_the_lowest_and_highest_points_of_a_round_body(rotation: Quaternion) -> None:
    solid = Solid("b", BEAKER, (0.1, 0.2, 0.3), rotation, shape=beaker(BEAKER))
    signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    walls = [part for part in solid.parts if part.kind == "box"]
    heights = [part.pose.apply(0.5 * signs * part.size)[:, 2] for part in walls]
    lowest, highest = min(map(np.min, heights)), max(map(np.max, heights))
    assert lowest - 0.0031 <= solid.bottom <= lowest + 1e-9  # the bottom, of 3 mm, may be below the walls
    assert highest - 1e-9 <= solid.top <= highest + 0.0031


def test_sides_of_bodies_of_boxes_are_those_of_their_bounding_boxes() -> None:
    assert faces(container(BEAKER)) == ()
    cross = (Part("box", (0.2, 0.02, 0.02)), Part("box", (0.02, 0.2, 0.02)))
    oblique = {tuple(round(value, 2) for value in side) for side in faces(cross) if side[2] == 0.0}
    assert {(x, y, 0.0) for x in (0.71, -0.71) for y in (0.71, -0.71)} <= oblique


@given(ROTATION, SMALL, SMALL, SMALL)
def test_a_footprint_holds_the_projection_of_all_corners(q: Quaternion, a: float, b: float, c: float) -> None:
    solid = Solid("s", (a, b, c), (0.3, -0.2, 0.5), q)
    corners = Pose(solid.position, q).apply(np.array(np.meshgrid([-a, a], [-b, b], [-c, c])).reshape(3, -1).T / 2)
    outline = solid.footprint
    assert area(outline) > 0.0
    grown = [(0.3 + (x - 0.3) * (1 + 1e-5), -0.2 + (y + 0.2) * (1 + 1e-5)) for x, y in outline]  # 0.05 um at least
    assert all(contains(grown, (x, y)) for x, y, _ in corners)
    assert solid.top == pytest.approx(corners[:, 2].max())
    assert solid.bottom == pytest.approx(corners[:, 2].min())


@given(ANGLE, ANGLE, ANGLE)
@example(yaw=0.5, tilt=1e-3, roll=0.3)  # as bodies tremble
@example(yaw=0.5, tilt=0.5 * math.pi, roll=0.7)  # it lies on its side
def test_the_outline_of_a_tilted_cylinder_is_round(yaw: float, tilt: float, roll: float) -> None:
    """It reaches as far as the ellipses of its rims, by formula; corners on these miss up to 2 % between each other."""
    q = (Pose.from_rotvec((0, 0, 0), (0, 0, yaw)) @ Pose.from_rotvec((0, 0, 0), (tilt, 0, 0))).q
    turned = (Pose((0, 0, 0), q) @ Pose.from_rotvec((0, 0, 0), (0, 0, roll))).q
    solid = Solid("c", BEAKER, (0.3, -0.2, 0.5), turned, shape=(Part("cylinder", BEAKER),))
    axis = solid.pose.rotation_matrix[:, 2]
    for angle in np.linspace(0.0, 2.0 * math.pi, 37):
        way = np.array((math.cos(angle), math.sin(angle)))
        along = abs(float(axis[:2] @ way))
        reach = 0.045 * math.sqrt(1.0 - along**2) + 0.04 * along
        told = max(float(way @ np.subtract(corner, (0.3, -0.2))) for corner in solid.footprint)
        assert 0.98 * reach <= told + 1e-9 <= reach + 2e-9


@given(FLAT, FLAT)
@settings(max_examples=200)
def test_solids_moved_apart_by_their_overlap_just_touch(a: Solid, b: Solid) -> None:
    depth, (x, y) = overlap(a.footprint, b.footprint)
    common = area(intersection(a.footprint, b.footprint))
    if depth <= 0.0:
        assert common == pytest.approx(0.0, abs=1e-9)
        return
    assert common > 0.0 or depth < 1e-6
    assert math.hypot(x, y) == pytest.approx(1.0)
    apart = a.moved((a.position[0] + depth * x, a.position[1] + depth * y, 0.0))
    assert overlap(apart.footprint, b.footprint)[0] == pytest.approx(0.0, abs=1e-9)


def test_intersection_of_two_squares() -> None:
    square = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    shifted = [(x + 0.75, y + 0.5) for x, y in square]
    assert area(intersection(square, shifted)) == pytest.approx(0.125)
    assert area(intersection(square, [(x + 2.0, y) for x, y in square])) == 0.0
    assert not contains([], (0.0, 0.0))


@given(FLAT, FLAT)
def test_outlines_are_apart_unless_they_overlap(one: Solid, other: Solid) -> None:
    depth, _ = overlap(one.footprint, other.footprint)
    if abs(depth) > 1e-9:  # m, rounding
        assert are_apart(one.footprint, other.footprint) is (depth < 0.0)


def test_a_solid_that_nobody_keeps_is_freed_at_once() -> None:
    """A tick makes hundreds, and the search for garbage in cycles would be part of it."""
    gc.disable()
    try:
        for shape in ((), container((0.17, 0.17, 0.15))):
            solid = Solid("box", (0.17, 0.17, 0.15), (0.0, 0.0, 0.1), shape=shape)
            assert solid.parts
            watched = weakref.ref(solid)
            del solid
            assert watched() is None
    finally:
        gc.enable()
