"""Gaps between boxes, compared with the closest points that an optimiser finds."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import lsq_linear
from scipy.spatial.transform import Rotation

from agents.arm_controller.overlap import Boxes, gaps


def random_boxes(rng: np.random.Generator, count: int) -> Boxes:
    axes = Rotation.random(count, random_state=rng).as_matrix()
    return Boxes(rng.uniform(-0.12, 0.12, (count, 3)), axes, rng.uniform(0.01, 0.1, (count, 3)))


def distance(a: Boxes, b: Boxes, index: int) -> float:
    """Between two boxes: least squares for a point in each."""
    matrix = np.hstack([a.axes[index], -b.axes[index]])
    half = np.concatenate([a.halves[index], b.halves[index]])
    found = lsq_linear(matrix, b.centers[index] - a.centers[index], (-half, half), tol=1e-12)
    return float(np.sqrt(2.0 * found.cost))


def test_a_gap_is_a_lower_bound_of_the_distance_and_zero_exactly_for_overlap() -> None:
    rng = np.random.default_rng(0)
    a, b = random_boxes(rng, 300), random_boxes(rng, 300)
    found = gaps(a, b)
    true = np.array([distance(a, b, index) for index in range(300)])
    assert (found[true > 1e-6] > 0.0).all()
    assert (found[true < 1e-9] <= 1e-9).all()
    assert (found <= true + 1e-6).all()
    assert (true > 1e-6).sum() > 50 < (true < 1e-9).sum()


@pytest.mark.parametrize(("x", "gap"), [(0.3, 0.1), (0.2, 0.0), (0.15, -0.05)])
def test_parallel_boxes(x: float, gap: float) -> None:
    axes, halves = np.eye(3)[None], np.full((1, 3), 0.1)
    found = gaps(Boxes(np.zeros((1, 3)), axes, halves), Boxes(np.array([[x, 0.05, 0.0]]), axes, halves))
    assert found == pytest.approx([gap], abs=1e-12)


def test_edges_that_cross_are_told_apart() -> None:
    """Two rods turned so that only the cross product of their edges separates them."""
    halves = np.array([[0.1, 0.01, 0.01]])
    a = Boxes(np.zeros((1, 3)), Rotation.from_euler("x", np.pi / 4).as_matrix()[None], halves)
    turn = Rotation.from_euler("ZX", (np.pi / 2, np.pi / 4)).as_matrix()[None]
    reach = 2 * 0.01 * np.sqrt(2)
    assert gaps(a, Boxes(np.array([[0.0, 0.0, reach + 0.001]]), turn, halves))[0] == pytest.approx(0.001, abs=1e-9)
    assert gaps(a, Boxes(np.array([[0.0, 0.0, reach - 0.001]]), turn, halves))[0] < 0.0
