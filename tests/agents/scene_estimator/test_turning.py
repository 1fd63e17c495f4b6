"""What a shape shows of its turn about its own z axis."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from agents.object_models import find_model, load_model
from agents.scene_estimator.turning import ROUND, nearest_alike, nearest_turn, order
from dsr.math3d import quaternions
from dsr.math3d.shapes import Part

CORNER = (Part("box", (0.1, 0.02, 0.04), (0.0, -0.04, 0.0)), Part("box", (0.02, 0.1, 0.04), (-0.04, 0.0, 0.0)))


@pytest.mark.parametrize(
    ("model", "count"), [("ball", ROUND), ("cup", ROUND), ("container_green", 4), ("lid", 4), ("large_box", 2)]
)
def test_how_often_a_shape_looks_the_same_in_a_turn(model: str, count: int) -> None:
    made = load_model(find_model(model, Path()))
    assert order(made.shape, made.size) == count


def test_what_has_no_symmetry_looks_the_same_once() -> None:
    assert order(CORNER, (0.1, 0.1, 0.04)) == 1


@pytest.mark.parametrize(
    ("yaw", "before", "count", "expected"),
    [(1.5, 0.1, 4, 1.5 - math.pi / 2), (-0.8, 0.75, 4, math.pi / 2 - 0.8), (3.0, 0.0, 1, 3.0), (0.4, 0.1, ROUND, 0.1)],
)
def test_of_yaws_that_look_alike_the_nearest_counts(yaw: float, before: float, count: int, expected: float) -> None:
    assert nearest_alike(yaw, before, count) == pytest.approx(expected)


def test_of_turns_that_look_alike_the_nearest_counts_also_upside_down() -> None:
    over = quaternions.from_rotvec((math.pi - 0.1, 0.0, 0.0))
    before = quaternions.product(over, quaternions.from_rotvec((0.0, 0.0, 0.1)))
    seen = quaternions.product(over, quaternions.from_rotvec((0.0, 0.0, 0.2 - math.pi / 2)))
    expected = quaternions.product(over, quaternions.from_rotvec((0.0, 0.0, 0.2)))
    assert nearest_turn(seen, before, 4) == pytest.approx(expected)
