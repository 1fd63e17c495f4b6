"""Gaps between boxes, compared with the closest points that an optimiser finds, and ways out of one another."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import lsq_linear
from scipy.spatial.transform import Rotation

from dsr.math3d.boxes import CORNERS, Boxes, depths_along, gaps, stacked
from dsr.math3d.transforms import Pose


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
    rotation = Rotation.from_euler("ZX", (np.pi / 2, np.pi / 4)).as_matrix()[None]
    reach = 2 * 0.01 * np.sqrt(2)
    assert gaps(a, Boxes(np.array([[0.0, 0.0, reach + 0.001]]), rotation, halves))[0] == pytest.approx(0.001, abs=1e-9)
    assert gaps(a, Boxes(np.array([[0.0, 0.0, reach - 0.001]]), rotation, halves))[0] < 0.0


def test_a_box_that_went_as_deep_as_it_was_is_just_free() -> None:
    rng = np.random.default_rng(1)
    a, b = random_boxes(rng, 200), random_boxes(rng, 200)
    direction = np.array((0.48, 0.6, 0.64))
    depths = depths_along(a, b, direction)
    apart = gaps(a, b) >= 0.0
    assert (depths[apart] == 0.0).all() and (depths[~apart] > 0.0).all()
    assert 50 < apart.sum() < 150
    assert gaps(a._replace(centers=a.centers + depths[:, None] * direction), b)[~apart] == pytest.approx(0.0, abs=1e-9)
    for share in (0.3, 0.99):
        on_the_way = a._replace(centers=a.centers + share * depths[:, None] * direction)
        assert (gaps(on_the_way, b)[~apart] < 0.0).all()


def test_corners_are_where_the_edges_end() -> None:
    poses = [Pose((1.0, 2.0, 3.0)), Pose.from_rotvec((0.0, 0.1, 0.0), (0.3, -0.2, 0.9))]
    corners = stacked((pose, (0.2, 0.4, 0.6)) for pose in poses).corners
    assert corners.shape == (2, 8, 3)
    for pose, found in zip(poses, corners, strict=True):
        assert found == pytest.approx(pose.apply(CORNERS * (0.1, 0.2, 0.3)))
