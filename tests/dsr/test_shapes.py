"""Shapes: their bounds, what is inside, and their form as an attribute."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dsr.errors import SchemaError
from dsr.math3d.quaternions import from_rotvec
from dsr.math3d.shapes import Part, bounds, box, centred, from_numbers, to_numbers
from dsr.math3d.surfaces import signed_distances

EDGE = st.floats(0.01, 1.0)
SIZE = st.tuples(EDGE, EDGE, EDGE)
VECTOR = st.tuples(*[st.floats(-1.0, 1.0)] * 3)
PART = st.builds(Part, st.sampled_from(["box", "cylinder", "sphere"]), SIZE, VECTOR, VECTOR.map(from_rotvec))
CUP = (Part("cylinder", (0.07, 0.07, 0.003), (0.0, 0.0, -0.0435)), Part("box", (0.003, 0.02, 0.09), (0.0335, 0.0, 0.0)))


@given(st.lists(PART, min_size=1, max_size=5).map(tuple))
def test_numbers_lead_back_to_the_shape(shape: tuple[Part, ...]) -> None:
    for part, known in zip(from_numbers(to_numbers(shape)), shape, strict=True):
        assert part[:3] == known[:3]
        assert part.rotation == pytest.approx(known.rotation)


@given(PART, VECTOR)
def test_what_a_part_contains_is_within_its_bounds(part: Part, point: tuple[float, float, float]) -> None:
    low, high = bounds((part,))
    if part.contains(point):
        assert all(a - 1e-9 <= x <= b + 1e-9 for a, x, b in zip(low, point, high, strict=True))
    assert part.contains(part.position)


@given(PART, VECTOR)
def test_the_nearest_point_of_a_surface_is_a_distance_along_the_normal(
    part: Part, point: tuple[float, float, float]
) -> None:
    distance, normal = part.signed_distance(point)
    assert distance == pytest.approx(float(signed_distances((part,), part.size, np.array([point]))[0]), abs=1e-9)
    assert math.hypot(*normal) == pytest.approx(1.0)
    assert part.contains(point) == (distance <= 0.0)
    if distance > 1e-6:
        x, y, z = (value - distance * way for value, way in zip(point, normal, strict=True))
        assert part.signed_distance((x, y, z))[0] == pytest.approx(0.0, abs=1e-9)


def test_bounds_touch_the_surface() -> None:
    tilted = Part("cylinder", (0.2, 0.2, 0.6), rotation=from_rotvec((0.0, math.radians(30), 0.0)))
    _, (x, y, z) = bounds((tilted,))
    assert (x, y) == pytest.approx((0.3 * 0.5 + 0.1 * math.cos(math.radians(30)), 0.1))
    assert z == pytest.approx(0.3 * math.cos(math.radians(30)) + 0.1 * 0.5)
    assert bounds((Part("sphere", (0.06, 0.06, 0.06), (1.0, 0.0, 0.0)),))[1] == pytest.approx((1.03, 0.03, 0.03))


def test_a_centred_shape_has_its_frame_in_the_middle() -> None:
    shape, middle = centred(CUP)
    low, high = bounds(shape)
    assert low == pytest.approx(tuple(-x for x in high))
    assert middle == pytest.approx((0.0, 0.0, 0.0), abs=1e-3)


@pytest.mark.parametrize(
    "numbers",
    [
        (),
        (0.0,) * 10,
        (3.0, 1, 1, 1, 0, 0, 0, 0, 0, 0, 1),
        (0.5, 1, 1, 1, 0, 0, 0, 0, 0, 0, 1),
        (0.0, 1, 0, 1, 0, 0, 0, 0, 0, 0, 1),
        (0.0, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0),
        (0.0, 1, 1, math.inf, 0, 0, 0, 0, 0, 0, 1),
        to_numbers(box((1.0, 1.0, 1.0))) * 17,
    ],
)
def test_other_numbers_are_refused(numbers: tuple[float, ...]) -> None:
    with pytest.raises(SchemaError, match="shape"):
        from_numbers(numbers)


def test_a_shape_without_parts_has_no_bounds() -> None:
    with pytest.raises(ValueError, match="without parts"):
        bounds(())
