"""Pixels and viewing rays of a pinhole camera."""

from __future__ import annotations

import math

import numpy as np
import pytest
from msgspec import structs

from dsr.vocabulary.distortion import Distortion
from dsr.vocabulary.intrinsics import Intrinsics

LENS = Intrinsics(500.0, 510.0, 300.0, 250.0, 640, 480)
META = {"fx": 500.0, "fy": 510.0, "cx": 300.0, "cy": 250.0}


def test_a_ray_goes_through_its_pixel_at_any_distance() -> None:
    rng = np.random.default_rng(0)
    pixels = rng.uniform(0.0, 480.0, (4, 5, 2))
    rays = LENS.rays(pixels)
    assert rays.shape == (4, 5, 3) and (rays[..., 2] == 1.0).all()
    assert LENS.project(rays * rng.uniform(0.1, 5.0, (4, 5, 1))) == pytest.approx(pixels)
    homogeneous = rays @ LENS.matrix.T
    assert homogeneous[..., :2] == pytest.approx(pixels)


@pytest.mark.parametrize("lens", [LENS, structs.replace(LENS, distortion=Distortion("plumb_bob", (0.1, -0.05)))])
def test_slopes_at_pixels_are_exactly_those_of_the_rays(lens: Intrinsics) -> None:
    u, v = np.array([0, 17, 401, 639]), np.array([479, 3, 0, 250])
    rays = lens.rays(np.column_stack([u, v]).astype(np.float64))
    assert [part.tolist() for part in lens.slopes_at(u, v)] == rays[:, :2].T.tolist()


def test_slopes_are_those_of_the_rays() -> None:
    x, y = LENS.slopes()
    assert np.broadcast_shapes(x.shape, y.shape) == (480, 640)
    assert LENS.rays(np.array([17.0, 401.0]))[:2] == pytest.approx((x[0, 17], y[401, 0]), abs=1e-6)


def test_the_field_of_view_is_that_of_the_outermost_edges() -> None:
    intrinsics = Intrinsics.from_fov(640, 480, 1.0)
    (left, right) = intrinsics.rays(np.array([[-0.5, 239.5], [639.5, 239.5]]))
    assert math.atan(right[0]) - math.atan(left[0]) == pytest.approx(1.0)


def test_those_of_a_frame() -> None:
    assert Intrinsics.from_meta(META, (480, 640, 3)) == LENS


@pytest.mark.parametrize("wrong", [{"fx": 0.0}, {"fy": math.nan}, {"cx": "far"}, {"cy": 1e9}])
def test_no_camera_has_such(wrong: dict[str, float | str]) -> None:
    with pytest.raises(ValueError, match="intrinsics"):
        Intrinsics.from_meta({**META, **wrong}, (480, 640))
