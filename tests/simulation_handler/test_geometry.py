"""Laws of footprints, overlaps and face-down rotations."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dsr import quaternions
from dsr.polygons import area, contains, intersection, overlap
from dsr.quaternions import Quaternion
from dsr.transforms import Pose
from simulation_handler.geometry import Solid, face_down

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


@given(ROTATION, SMALL, SMALL, SMALL)
def test_a_footprint_holds_the_projection_of_all_corners(q: Quaternion, a: float, b: float, c: float) -> None:
    solid = Solid("s", (a, b, c), (0.3, -0.2, 0.5), q)
    corners = Pose(solid.position, q).apply(np.array(np.meshgrid([-a, a], [-b, b], [-c, c])).reshape(3, -1).T / 2)
    outline = solid.footprint
    assert area(outline) > 0.0
    grown = [(0.3 + (x - 0.3) * (1 + 1e-6), -0.2 + (y + 0.2) * (1 + 1e-6)) for x, y in outline]
    assert all(contains(grown, (x, y)) for x, y, _ in corners)
    assert solid.top == pytest.approx(corners[:, 2].max())
    assert solid.bottom == pytest.approx(corners[:, 2].min())


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
