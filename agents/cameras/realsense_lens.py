"""Intrinsics and poses as librealsense tells them, in our terms."""

from __future__ import annotations

from typing import Any

import numpy as np

from dsr.math3d import quaternions
from dsr.math3d.transforms import Array, Pose
from dsr.vocabulary.distortion import Distortion
from dsr.vocabulary.intrinsics import Intrinsics

_GRID = 15
"""Rows and columns of an image at which a lens is looked at"""
_MODELS = {"brown_conrady": "plumb_bob", "kannala_brandt4": "equidistant"}
"""Models of distortion that are the same under another name"""


def intrinsics_of(library: Any, told: Any) -> tuple[Intrinsics, float]:
    """The intrinsics of a stream, and by how many px they are off at most.

    librealsense has models that OpenCV lacks, such as the inverse one of Brown and Conrady. The radial and tangential
    model is fitted to them: exact for lenses without distortion.

    Args:
        library: pyrealsense2.
        told: its `intrinsics`.
    """
    plain = Intrinsics(told.fx, told.fy, told.ppx, told.ppy, told.width, told.height)
    coefficients = tuple(map(float, told.coeffs))
    if told.model == library.distortion.none or not any(coefficients):
        return plain, 0.0
    model = _MODELS.get(told.model.name)
    if model is not None:
        return _through(plain, model, coefficients[:4] if model == "equidistant" else coefficients), 0.0
    flat, shown = _samples(library, told, plain)
    found = _through(plain, "plumb_bob", tuple(_fitted(flat, shown).tolist()))
    rays = np.concatenate([flat, np.ones((len(flat), 1))], axis=1)
    off = np.abs(found.project(rays) - (shown * (plain.fx, plain.fy) + (plain.cx, plain.cy)))
    return found, float(np.nanmax(off))


def pose_of(told: Any) -> Pose:
    """to_from of `extrinsics`, whose rotation comes column by column."""
    columns = np.array(told.rotation, np.float64).reshape(3, 3)
    return Pose(tuple(map(float, told.translation)), quaternions.from_matrix(columns.T.tolist()))


def _through(plain: Intrinsics, model: str, coefficients: tuple[float, ...]) -> Intrinsics:
    size = plain.width, plain.height
    return Intrinsics(plain.fx, plain.fy, plain.cx, plain.cy, *size, Distortion.of(model, coefficients))


def _samples(library: Any, told: Any, plain: Intrinsics) -> tuple[Array, Array]:
    """Points (n, 2) in the plane with z = 1, and where (n, 2) the lens shows them there."""
    u, v = np.meshgrid(np.linspace(0, plain.width - 1, _GRID), np.linspace(0, plain.height - 1, _GRID))
    shown = np.stack([(u.ravel() - plain.cx) / plain.fx, (v.ravel() - plain.cy) / plain.fy], axis=1)
    if told.model == library.distortion.inverse_brown_conrady:
        pixels = shown * (plain.fx, plain.fy) + (plain.cx, plain.cy)
        points = [library.rs2_deproject_pixel_to_point(told, pixel, 1.0) for pixel in pixels.tolist()]
        return np.array(points)[:, :2], shown
    rays = np.concatenate([shown, np.ones((len(shown), 1))], axis=1)
    pixels = np.array([library.rs2_project_point_to_pixel(told, ray) for ray in rays.tolist()])
    return shown, (pixels - (plain.cx, plain.cy)) / (plain.fx, plain.fy)


def _fitted(flat: Array, shown: Array) -> Array:
    """Coefficients k1, k2, p1, p2, k3 that show points (n, 2) at `shown` (n, 2): the model is linear in them."""
    x, y = flat.T
    r2 = x * x + y * y
    along_x = np.stack([x * r2, x * r2**2, 2.0 * x * y, r2 + 2.0 * x * x, x * r2**3], axis=1)
    along_y = np.stack([y * r2, y * r2**2, r2 + 2.0 * y * y, 2.0 * x * y, y * r2**3], axis=1)
    wanted = (shown - flat).T.ravel()
    return np.asarray(np.linalg.lstsq(np.concatenate([along_x, along_y]), wanted, rcond=None)[0])
