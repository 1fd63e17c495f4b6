"""Lenses that distort, against OpenCV."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from dsr.vocabulary.distortion import Distortion
from dsr.vocabulary.intrinsics import Intrinsics

LENSES = {
    "radial and tangential": Distortion("plumb_bob", (-0.233, 0.218, 1e-4, -1e-4, -0.09)),
    "four numbers": Distortion("plumb_bob", (0.1, -0.05, 0.002, -0.001)),
    "rational": Distortion("rational_polynomial", (0.5, -0.3, 1e-3, -2e-3, 0.05, 0.8, -0.2, 0.02)),
    "thin prism": Distortion(
        "rational_polynomial", (0.1, -0.1, 1e-3, -2e-3, 0.05, 0.1, -0.2, 0.02, 1e-3, 2e-3, -1e-3, 3e-3)
    ),
    "tilted": Distortion(
        "rational_polynomial", (0.1, -0.1, 1e-3, -2e-3, 0.05, 0.1, -0.2, 0.02, 0.0, 0.0, 0.0, 0.0, 0.02, -0.03)
    ),
    "fisheye": Distortion("equidistant", (0.02, -0.01, 0.003, -0.001)),
}
CAMERAS = {name: Intrinsics(400.0, 410.0, 315.0, 245.0, 640, 480, lens) for name, lens in LENSES.items()}
PIXELS = np.random.default_rng(0).uniform(0.0, (639.0, 479.0), (500, 2))
NOWHERE = np.zeros(3)


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_opencv_projects_the_rays_to_the_same_pixels(camera: Intrinsics) -> None:
    assert camera.distortion is not None
    rays, coefficients = camera.rays(PIXELS), np.array(camera.distortion.coefficients)
    project = cv2.fisheye.projectPoints if camera.distortion.model == "equidistant" else cv2.projectPoints
    theirs = project(rays[:, None], NOWHERE, NOWHERE, camera.matrix, coefficients)[0].reshape(-1, 2)
    np.testing.assert_allclose(theirs, PIXELS, atol=1e-6)
    np.testing.assert_allclose(camera.project(0.7 * rays), PIXELS, atol=1e-6)


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_derivatives_are_those_of_the_projection(camera: Intrinsics) -> None:
    points, step = 0.6 * camera.rays(PIXELS[:20]), 1e-6
    pixels, by_point = camera.project_with_derivative(points)
    np.testing.assert_allclose(pixels, PIXELS[:20], atol=1e-6)
    moved = [(camera.project(points + step * axis) - camera.project(points - step * axis)) / 2e-6 for axis in np.eye(3)]
    np.testing.assert_allclose(by_point, np.stack(moved, axis=-1), rtol=1e-4, atol=1e-4)


def test_what_is_far_off_the_axis_is_not_shown_where_the_polynomial_comes_back() -> None:
    barrel = Intrinsics(400.0, 400.0, 320.0, 240.0, 640, 480, Distortion("plumb_bob", (-0.3, 0.0, 0.0, 0.0)))
    turning = 1.0 / math.sqrt(0.9)  # where 1 - 0.9 r^2, the derivative of r - 0.3 r^3, is zero
    near, far = barrel.project(np.array([[0.99 * turning, 0.0, 1.0], [1.2 * turning, 0.0, 1.0]]))
    assert near[0] == pytest.approx(320.0 + 400.0 * (0.99 * turning - 0.3 * (0.99 * turning) ** 3))
    assert np.isnan(far).all()
    nothing = barrel.rays(np.array([320.0 + 400.0 * 0.75, 240.0]))  # beyond the greatest radius, 0.703
    assert np.isnan(nothing[:2]).all() and nothing[2] == 1.0


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_a_pinhole_holds_what_the_camera_sees(camera: Intrinsics) -> None:
    pinhole = camera.pinhole()
    assert pinhole.distortion is None and (pinhole.fx, pinhole.fy) == (camera.fx, camera.fy)
    pixels = pinhole.project(camera.rays(PIXELS))
    assert (pixels >= 0.0).all() and (pixels <= (pinhole.width - 1, pinhole.height - 1)).all()
    assert pinhole.width <= 3 * camera.width + 1 and pinhole.height <= 3 * camera.height + 1


def test_a_pinhole_of_a_lens_that_sees_sideways_is_bounded() -> None:
    camera = Intrinsics(200.0, 200.0, 320.0, 240.0, 640, 480, Distortion("equidistant", (0.0, 0.0, 0.0, 0.0)))
    assert np.isnan(camera.rays(np.array([0.0, 240.0]))).any()  # 1.6 rad off the axis
    pinhole = camera.pinhole()
    assert (pinhole.width, pinhole.height) == (3 * 640 + 1, 3 * 480 + 1)


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_slopes_of_a_lens_are_those_of_its_rays(camera: Intrinsics) -> None:
    x, y = camera.slopes()
    assert x.shape == y.shape == (480, 640)
    column, row = 613, 20
    expected = camera.rays(np.array([float(column), float(row)]))
    assert (x[row, column], y[row, column]) == pytest.approx(expected[:2], abs=1e-6)
    assert not x.flags.writeable and not y.flags.writeable


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_a_frame_and_a_node_tell_the_lens(camera: Intrinsics) -> None:
    assert Intrinsics.from_meta(camera.meta(), (480, 640, 3)) == camera


@pytest.mark.parametrize(
    ("model", "coefficients"),
    [
        ("pincushion", (0.1, 0.0, 0.0, 0.0)),
        ("plumb_bob", (0.1,)),
        ("plumb_bob", (0.1, 0.0, 0.0, math.nan)),
        ("equidistant", (0.1, 0.0, 0.0, 0.0, 0.0)),
        ("rational_polynomial", ("a",) * 8),
        (7, (0.1, 0.0, 0.0, 0.0)),
    ],
)
def test_no_lens_has_such(model: object, coefficients: tuple[object, ...]) -> None:
    with pytest.raises(ValueError, match=r"distortion|coefficients"):
        Distortion.of(model, coefficients)
    with pytest.raises(ValueError, match=r"distortion|coefficients"):
        Intrinsics.from_meta(
            {"fx": 500.0, "fy": 500.0, "cx": 1.0, "cy": 1.0, "distortion_model": model}  # type: ignore[dict-item]
            | {f"d{number}": value for number, value in enumerate(coefficients, 1)},  # type: ignore[misc]
            (480, 640),
        )
