"""Depth in the image of a colour camera beside: as the renderer shows it from there, through any lens."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pybullet
import pytest

from agents.depth_alignment import DepthAlignment
from agents.plant.bullet import Bullet
from agents.plant.lens import through_lens
from agents.plant.renderer import Renderer
from dsr.math3d.quaternions import from_rotvec
from dsr.math3d.transforms import Pose
from dsr.vocabulary.distortion import Distortion
from dsr.vocabulary.intrinsics import Intrinsics

COLOR = Intrinsics.from_fov(320, 240, 0.95)
DEPTH = Intrinsics.from_fov(240, 180, 1.2)
BESIDE = Pose((-0.05, 0.004, 0.01), from_rotvec((0.02, -0.04, 0.03)))
"""color_from_depth"""
ABOVE = Pose((0.0, 0.0, 0.8), (1.0, 0.0, 0.0, 0.0))
LENSES = {
    "ideal": None,
    "radial and tangential": Distortion("plumb_bob", (0.12, -0.2, 0.002, -0.001, 0.03)),
    "barrel": Distortion("plumb_bob", (-0.3, 0.08, 0.0, 0.0)),
    "fisheye": Distortion("equidistant", (0.02, -0.01, 0.003, 0.0)),
}


@pytest.fixture(scope="module")
def eye() -> Iterator[Renderer]:
    """Sees a floor with two boxes of different heights on it."""
    bullet = Bullet()
    renderer = Renderer(bullet, "tiny")
    for half, place in (((1.5, 1.5, 0.01), (0.0, 0.0, -0.01)), ((0.05, 0.04, 0.1), (0.1, 0.05, 0.1)),
                        ((0.06, 0.06, 0.2), (-0.12, -0.06, 0.2))):  # fmt: skip
        shape = bullet.createVisualShape(pybullet.GEOM_BOX, halfExtents=half, rgbaColor=(0.5, 0.6, 0.7, 1.0))
        bullet.create_body(0.0, -1, shape, place)
    yield renderer
    renderer.close()
    bullet.close()


@pytest.mark.parametrize("lens", LENSES)
def test_it_is_as_the_renderer_sees_it_from_there(eye: Renderer, lens: str) -> None:
    color = Intrinsics(COLOR.fx, COLOR.fy, COLOR.cx, COLOR.cy, COLOR.width, COLOR.height, LENSES[lens])
    measured = eye.render(ABOVE @ BESIDE, DEPTH).depth.copy()
    wanted = through_lens(eye.render(ABOVE, color.pinhole()), color).depth
    aligned = DepthAlignment(DEPTH, color, BESIDE).align(measured)
    assert aligned.shape == (240, 320) and aligned.dtype == np.float32
    known = aligned > 0.0
    assert known.mean() > 0.85
    error = np.abs(aligned - wanted)[known]
    assert np.quantile(error, 0.9) < 2e-3
    assert (error > 0.02).mean() < 0.04  # at the edges, where a pixel of depth is wider
    unaligned = np.abs(measured - wanted[30:210, 40:280])
    assert (unaligned > 0.02).mean() > 0.1, "without aligning, they are apart"


def test_the_nearest_surface_is_seen() -> None:
    depth = np.full((180, 240), 2.0, np.float32)
    depth[60:120, 100:140] = 0.5
    aligned = DepthAlignment(DEPTH, COLOR, Pose((-0.2, 0.0, 0.0))).align(depth)
    assert np.isin(aligned.round(3), (0.0, 0.5, 2.0)).all()
    corners = np.array([[100.0, 60.0], [139.0, 119.0]])
    seen = COLOR.project(DEPTH.rays(corners) * 0.5 + (-0.2, 0.0, 0.0))
    (left, top), (right, bottom) = np.rint(seen).astype(int)
    assert (aligned[top : bottom + 1, max(left, 0) : right + 1] == 0.5).all()


def test_between_equal_cameras_at_one_place_nothing_changes() -> None:
    rng = np.random.default_rng(3)
    depth = np.kron(rng.uniform(0.5, 3.0, (18, 24)), np.ones((10, 10))).astype(np.float32)
    depth[40:60] = 0.0
    aligned = DepthAlignment(DEPTH, DEPTH, Pose.identity()).align(depth)
    inner = np.kron(np.ones((18, 24)), np.pad(np.ones((8, 8)), 1)) > 0.0
    assert np.array_equal(aligned[inner], depth[inner])


def test_what_is_unknown_stays_so_and_what_is_no_depth_is_left_out() -> None:
    alignment = DepthAlignment(DEPTH, COLOR, BESIDE)
    for value in (0.0, -1.0, np.nan, np.inf):
        assert (alignment.align(np.full((180, 240), value, np.float32)) == 0.0).all()
    behind = DepthAlignment(DEPTH, COLOR, Pose((0.0, 0.0, -3.0)))
    assert (behind.align(np.full((180, 240), 1.0, np.float32)) == 0.0).all()


def test_an_image_of_another_size_is_refused() -> None:
    with pytest.raises(ValueError, match="its intrinsics are about"):
        DepthAlignment(DEPTH, COLOR, BESIDE).align(np.ones((240, 320), np.float32))
