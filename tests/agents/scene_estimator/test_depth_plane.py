"""The plane within a tag's outline: exact on exact depth, unmoved by wrong depths, absent without enough of it."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from agents.scene_estimator.depth_plane import DepthPlane, fit_depth_plane
from dsr.vocabulary.intrinsics import Intrinsics

Depth = NDArray[np.float32]
LENS = Intrinsics(600.0, 600.0, 79.5, 59.5, 160, 120)
CORNERS = np.array([[60.0, 40.0], [100.0, 42.0], [98.0, 82.0], [58.0, 80.0]])
P = np.array([0.4, -0.3, 1.6])
"""1/m, the true plane: 1/z = P . ray."""
FLOOR = 3e-4
V, U = np.mgrid[0:120, 0:160]
INVERSE = (LENS.rays(np.column_stack([U.ravel(), V.ravel()]).astype(float)) @ P).reshape(120, 160)


@pytest.fixture
def depth() -> Depth:
    return np.asarray(1.0 / INVERSE, np.float32)


def fit(depth: Depth, corners: NDArray[np.float64] = CORNERS) -> DepthPlane | None:
    return fit_depth_plane(corners, depth, LENS, noise_floor=FLOOR, correlation=1.0)


def angle(plane: DepthPlane | None) -> float:
    """Rad between fitted and true normal."""
    assert plane is not None
    return float(np.arccos(np.clip(-plane.normal @ P / np.linalg.norm(P), -1.0, 1.0)))


def test_exact_depth_gives_the_plane_whatever_surrounds_the_tag(depth: Depth) -> None:
    depth[:35] = depth[:, :50] = depth[90:] = 0.2
    plane = fit(depth)
    assert angle(plane) < 1e-4
    assert plane is not None
    assert plane.p == pytest.approx(P, abs=1e-4)
    assert plane.normal[2] < 0


def test_rays_meet_the_plane_at_its_points(depth: Depth) -> None:
    plane = fit(depth)
    assert plane is not None
    points = plane.points(LENS.rays(CORNERS))
    assert points @ plane.p == pytest.approx(np.ones(4))
    assert LENS.project(points) == pytest.approx(CORNERS)


def test_a_fifth_of_wrong_depths_does_not_turn_it(depth: Depth) -> None:
    depth[40:48, :] = 0.3
    assert angle(fit(depth)) < np.radians(0.05)


@pytest.mark.parametrize("unknown", [0.0, np.nan, np.inf, -1.0])
def test_unknown_depths_are_left_out_and_most_must_be_known(depth: Depth, unknown: float) -> None:
    depth[::3] = unknown
    assert angle(fit(depth)) < 1e-4
    depth[::2] = unknown
    assert fit(depth) is None


def test_a_tag_partly_outside_the_image_counts_inside(depth: Depth) -> None:
    assert angle(fit(depth, CORNERS - (80.0, 0.0))) < 1e-4
    assert fit(depth, CORNERS - (300.0, 0.0)) is None


def test_too_few_pixels_are_no_plane(depth: Depth) -> None:
    assert fit(depth, 80.0 + 0.1 * (CORNERS - 80.0)) is None


def test_a_plane_seen_from_its_edge_is_none() -> None:
    rays = LENS.rays(np.column_stack([U.ravel(), V.ravel()]).astype(float))
    steep = (rays @ np.array([30.0, 0.0, 1.6])).reshape(120, 160)
    assert fit((1.0 / steep).astype(np.float32)) is None


def test_a_rough_surface_is_none(depth: Depth, rng: np.random.Generator) -> None:
    rough = depth * rng.uniform(0.7, 1.3, depth.shape).astype(np.float32)
    assert fit(rough) is None


def test_the_order_of_the_corners_does_not_matter(depth: Depth) -> None:
    forwards, backwards = fit(depth), fit(depth, CORNERS[::-1])
    assert forwards is not None
    assert backwards is not None
    assert forwards.p == pytest.approx(backwards.p, abs=1e-6)


def test_covariance_tells_the_spread(rng: np.random.Generator) -> None:
    noisy = [(1.0 / (INVERSE + rng.normal(0.0, 2e-3, INVERSE.shape))).astype(np.float32) for _ in range(150)]
    planes = [plane for depth in noisy if (plane := fit(depth)) is not None]
    assert len(planes) == len(noisy)
    squares = [(plane.p - P) @ np.linalg.solve(plane.covariance, plane.p - P) for plane in planes]
    assert 2.0 < np.mean(squares) < 4.5  # three on average


def test_large_tags_cost_no_precision(rng: np.random.Generator) -> None:
    """Their pixels are thinned out, and the covariance knows."""
    intrinsics = Intrinsics(600.0, 600.0, 319.5, 239.5, 640, 480)
    corners = np.array([[100.0, 50.0], [500.0, 50.0], [500.0, 450.0], [100.0, 450.0]])
    depth = np.full((480, 640), 0.5) + rng.normal(0.0, 1e-3, (480, 640))
    plane = fit_depth_plane(corners, depth.astype(np.float32), intrinsics, noise_floor=FLOOR, correlation=4.0)
    assert plane is not None
    assert plane.p == pytest.approx([0.0, 0.0, 2.0], abs=5e-3)
