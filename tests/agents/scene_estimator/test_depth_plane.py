"""The planes within tags' outlines: exact on exact depth, unmoved by wrong depths, absent without enough of it."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from agents.scene_estimator.depth_plane import DepthPlanes, _inset, _pixels_within, fit_depth_planes
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


def fit(depth: Depth, *corners: NDArray[np.float64]) -> DepthPlanes:
    return fit_depth_planes(np.array(corners or [CORNERS]), depth, LENS, noise_floor=FLOOR, correlation=1.0)


def angle(planes: DepthPlanes) -> float:
    """Rad between fitted and true normal."""
    assert planes.exist.all()
    return float(np.arccos(np.clip(-planes.normals[0] @ P / np.linalg.norm(P), -1.0, 1.0)))


def test_exact_depth_gives_the_plane_whatever_surrounds_the_tag(depth: Depth) -> None:
    depth[:35] = depth[:, :50] = depth[90:] = 0.2
    planes = fit(depth)
    assert angle(planes) < 1e-4
    assert planes.p[0] == pytest.approx(P, abs=1e-4)
    assert planes.normals[0, 2] < 0


def test_rays_meet_the_plane_at_its_points(depth: Depth) -> None:
    planes = fit(depth)
    (points,) = planes.points(LENS.rays(CORNERS)[None])
    assert points @ planes.p[0] == pytest.approx(np.ones(4))
    assert LENS.project(points) == pytest.approx(CORNERS)


def test_a_fifth_of_wrong_depths_does_not_turn_it(depth: Depth) -> None:
    depth[40:48, :] = 0.3
    assert angle(fit(depth)) < np.radians(0.05)


@pytest.mark.parametrize("unknown", [0.0, np.nan, np.inf, -1.0])
def test_unknown_depths_are_left_out_and_most_must_be_known(depth: Depth, unknown: float) -> None:
    depth[::3] = unknown
    assert angle(fit(depth)) < 1e-4
    depth[::2] = unknown
    assert not fit(depth).exist.any()


def test_a_tag_partly_outside_the_image_counts_inside(depth: Depth) -> None:
    assert angle(fit(depth, CORNERS - (80.0, 0.0))) < 1e-4
    assert not fit(depth, CORNERS - (300.0, 0.0)).exist.any()


@pytest.mark.parametrize("corners", [np.outer(range(4), (20.0, 15.0)), CORNERS[[0, 2, 1, 3]]])
def test_corners_that_enclose_nothing_have_no_plane(depth: Depth, corners: NDArray[np.float64]) -> None:
    assert not fit(depth, 20.0 + corners).exist.any()


def test_too_few_pixels_are_no_plane(depth: Depth) -> None:
    assert not fit(depth, 80.0 + 0.1 * (CORNERS - 80.0)).exist.any()


def test_a_small_tilted_tag_keeps_its_plane_if_two_fifths_of_the_depth_are_unknown(
    depth: Depth, rng: np.random.Generator
) -> None:
    """It lies along the diagonal of the box around it, of which it fills a third."""
    corners = np.array((80.0, 60.0)) + np.array([[4.9, -4.9], [14.0, 14.0], [-4.9, 4.9], [-14.0, -14.0]])
    for _ in range(20):
        known = np.where(rng.random(depth.shape) < 0.6, depth, 0.0).astype(np.float32)
        planes = fit_depth_planes(corners[None], known, LENS, noise_floor=FLOOR, correlation=4.0)
        assert angle(planes) < 1e-4


def test_a_plane_seen_from_its_edge_is_none() -> None:
    rays = LENS.rays(np.column_stack([U.ravel(), V.ravel()]).astype(float))
    steep = (rays @ np.array([30.0, 0.0, 1.6])).reshape(120, 160)
    assert not fit((1.0 / steep).astype(np.float32)).exist.any()


def test_a_rough_surface_is_none(depth: Depth, rng: np.random.Generator) -> None:
    rough = depth * rng.uniform(0.7, 1.3, depth.shape).astype(np.float32)
    assert not fit(rough).exist.any()


def test_the_order_of_the_corners_does_not_matter(depth: Depth) -> None:
    forwards, backwards = fit(depth), fit(depth, CORNERS[::-1])
    assert forwards.p == pytest.approx(backwards.p, abs=1e-6)


def test_planes_fitted_at_once_are_those_fitted_alone(depth: Depth) -> None:
    """Whatever the others are: larger, smaller, beside the image, without extent, without depth."""
    depth[60:, 120:] = 0.0
    near, far = (centre + 0.5 * (CORNERS - 80.0) for centre in ((30.0, 30.0), (140.0, 100.0)))
    all_corners = [CORNERS, near, 80.0 + 1.4 * (CORNERS - 80.0), far, CORNERS - (300.0, 0.0), np.full((4, 2), 50.0)]
    together = fit(depth, *all_corners)
    assert together.exist.tolist() == [True, True, True, False, False, False]
    for place, corners in enumerate(all_corners[:3]):
        alone = fit(depth, corners)
        assert together.p[place] == pytest.approx(alone.p[0], rel=1e-9)
        assert together.covariance[place] == pytest.approx(alone.covariance[0], rel=1e-9)


def test_covariance_tells_the_spread(rng: np.random.Generator) -> None:
    noisy = [(1.0 / (INVERSE + rng.normal(0.0, 2e-3, INVERSE.shape))).astype(np.float32) for _ in range(150)]
    fits = [fit(depth) for depth in noisy]
    squares = [(planes.p[0] - P) @ np.linalg.solve(planes.covariance[0], planes.p[0] - P) for planes in fits]
    assert 2.0 < np.mean(squares) < 4.5  # three on average


def test_large_tags_cost_no_precision(rng: np.random.Generator) -> None:
    """Their pixels are thinned out, and the covariance knows."""
    intrinsics = Intrinsics(600.0, 600.0, 319.5, 239.5, 640, 480)
    corners = np.array([[100.0, 50.0], [500.0, 50.0], [500.0, 450.0], [100.0, 450.0]])
    depth = np.full((480, 640), 0.5) + rng.normal(0.0, 1e-3, (480, 640))
    pixels = depth.astype(np.float32)
    planes = fit_depth_planes(corners[None], pixels, intrinsics, noise_floor=FLOOR, correlation=4.0)
    assert planes.p[0] == pytest.approx([0.0, 0.0, 2.0], abs=5e-3)


@pytest.mark.parametrize("extent", [1.0, 0.5])
def test_pixels_whose_errors_are_alike_are_left_out_at_no_loss(extent: float, rng: np.random.Generator) -> None:
    """A quarter of the pixels tell as much, of a tag of 20 px too, and the covariance tells how much that is."""
    corners = 80.0 + extent * (CORNERS[None] - 80.0)
    errors: list[list[float]] = [[], []]
    squares = []
    for _ in range(150):
        noise = cv2.blur(rng.normal(0.0, 8e-3, INVERSE.shape), (4, 4))
        pixels = (1.0 / (INVERSE + noise)).astype(np.float32)
        for number, correlation in enumerate((1.0, 4.0)):
            planes = fit_depth_planes(corners, pixels, LENS, noise_floor=FLOOR, correlation=correlation)
            errors[number].append(float(np.linalg.norm(planes.p[0] - P)))
        squares.append((planes.p[0] - P) @ np.linalg.solve(planes.covariance[0], planes.p[0] - P))
    dense, thinned = np.sqrt(np.mean(np.square(errors), axis=1))
    assert thinned < 1.1 * dense
    assert 2.0 < np.mean(squares) < 4.5  # three on average
    counts = [_pixels_within(_inset(corners), (120, 160), correlation)[2][0] for correlation in (1.0, 4.0)]
    assert counts[1] < 0.3 * counts[0]
