"""Where an object of known shape is, from the pixels that show it: its visible surface is put where it is seen.

The middle of what is seen is compared with the middle of what should be seen of the shape at a supposed place, which is
then moved by the difference, and so on: an iterated closest point method (Besl and McKay, PAMI 1992) with all points
matched at once. What something nearer hides, or lies outside the image, should not be seen, so that it does not pull
the place to one side. How well the shape lies on the points then, and how much of it is seen, tell how sure that is.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.scene_estimator.geometry import Array, Intrinsics
from agents.scene_estimator.segmentation import Mask
from dsr.quaternions import Vector3
from dsr.shapes import Shape
from dsr.surfaces import distances, seen_alone
from dsr.transforms import Pose

LEAST_SHARE = 0.35
"""Of the image of an object, had it no others before it, that must be seen"""
SMALLEST = 8
"""px, the width of the smallest spot that is used"""

_MOST_PIXELS = 1500
_MODEL_POINTS = 600  # all around the shape
_ITERATIONS = 12
_ROUGH = 4  # iterations, and
_ROUGH_POINTS = 200  # enough to tell yaws apart
_SETTLED = 1e-4  # m
_IN_FRONT = 0.015  # m, by which something must be nearer to hide a point
_WORST_FIT = 0.2  # of the shortest edge: mean distance of the points from the shape, above which it is another thing
_NOISY_FIT = 3.0  # times the depth noise: the same, of thin objects
_AGREEMENT = 0.6  # least share of what should be seen that is seen
_PIXELS_OFF = 0.4  # px, error of the middle of a spot
_FLOOR = 1e-3  # m, likewise, of the model
_PULL = 0.15  # of the object's extent, that the middle may be off for each hidden share
_YAWS = np.radians(np.arange(0.0, 180.0, 30.0))
_FINER = np.radians((10.0, 5.0, 2.5))  # rad, by which the best of those is turned on to both sides
_GOOD_FIT = 1.5  # times the depth noise: a mean distance up to which no other yaw is tried
_TRUST = 1.5  # times the mean distance of the points from the shape: how far off the place may be


class View(NamedTuple):
    """One exposure."""

    depth: NDArray[np.float32]
    """(h, w) m along the optical axis; 0 where unknown"""
    intrinsics: Intrinsics
    world_from_camera: Pose


class Placed(NamedTuple):
    """Where an object is."""

    position: Array
    """(3,) m, its centre in the camera frame"""
    covariance: Array
    """(3, 3) m^2, but for the sensor's systematic errors"""
    yaw: float
    """rad, by which it fits best: of use as a guess for the next frame alone"""
    fits: bool
    """Whether the shape lies on the points but for their noise."""


class _Fit(NamedTuple):
    position: Array  # (3,) m, world
    share: float  # of its image that is not hidden
    agreement: float  # share of that which has its colour
    misfit: float  # m, mean distance of the points from the surface
    yaw: float


def place(
    view: View, mask: Mask, shape: Shape, size: Vector3, noise: float, yaw: float = 0.0, *, search: bool = True
) -> Placed | None:
    """The place of an object that stands upright, from the pixels of its colour.

    Args:
        view: depth and camera.
        mask: (h, w) those pixels.
        shape: of the object; without parts, a box of `size` m.
        size: edge lengths of its bounding box, m.
        noise: 1/m, standard deviation of the inverse depth of a pixel.
        yaw: rad, a guess of how it is turned.
        search: try others if that does not fit.

    Returns:
        None if too little of it is seen, or if what is seen is not its surface.
    """
    points, weights = _cloud(view, mask)
    if len(points) == 0:
        return None
    scene = _Scene(view, mask, points, weights)
    fit = _fit(scene, shape, size, yaw)
    expected = noise * float((points[:, 2] ** 2).mean())
    if search and (fit is None or fit.misfit > _GOOD_FIT * expected):
        fit = _fit(scene, shape, size, _best_yaw(scene, shape, size, yaw))
    worst = max(_WORST_FIT * min(size), _NOISY_FIT * expected)
    if fit is None or fit.share < LEAST_SHARE or fit.agreement < _AGREEMENT or fit.misfit > worst:
        return None
    position = view.world_from_camera.inverse().apply(fit.position)
    hidden = 1.0 - fit.share * fit.agreement
    sigma = (_PIXELS_OFF * position[2] / view.intrinsics.fx, _FLOOR, _TRUST * fit.misfit, _PULL * hidden * max(size))
    return Placed(
        position, sum(value * value for value in sigma) * np.eye(3), fit.yaw, fit.misfit <= _GOOD_FIT * expected
    )


class _Scene:
    """What is seen, in the world frame."""

    def __init__(self, view: View, mask: Mask, points: Array, weights: Array) -> None:
        self._view = view
        self._mask = mask
        self.eye = view.world_from_camera.translation
        self.points = view.world_from_camera.apply(points)
        self.weights = weights
        self._camera_from_world = view.world_from_camera.inverse()

    def expected(self, points: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Which points (n, 3) of the world should be seen, as nothing hides them, and which pixels have the colour."""
        local = self._camera_from_world.apply(points)
        depth = np.maximum(local[:, 2], 1e-6)
        height, width = self._mask.shape
        column, row = np.rint(self._view.intrinsics.pixels(np.column_stack([local[:, :2], depth]))).T
        inside = (column >= 0) & (column < width) & (row >= 0) & (row < height) & (local[:, 2] > 0.0)
        place = np.where(inside, row, 0).astype(int), np.where(inside, column, 0).astype(int)
        colored = self._mask[place] & inside
        measured = self._view.depth[place]
        free = inside & (colored | (measured > depth - _IN_FRONT))
        return free, colored


def _cloud(view: View, mask: Mask) -> tuple[Array, Array]:
    """Points (n, 3) of the mask's pixels with known depth, in the camera frame, and their solid angles (n,)."""
    rows, columns = np.nonzero(mask & (view.depth > 0.0) & np.isfinite(view.depth))
    step = max(1, math.ceil(len(rows) / _MOST_PIXELS))
    rows, columns = rows[::step], columns[::step]
    if len(rows) == 0 or min(np.ptp(rows), np.ptp(columns)) < SMALLEST:
        return np.empty((0, 3)), np.empty(0)
    rays = view.intrinsics.rays(np.column_stack([columns, rows]).astype(np.float64))
    return rays * view.depth[rows, columns, None].astype(np.float64), (rays * rays).sum(axis=1) ** -1.5


def _best_yaw(scene: _Scene, shape: Shape, size: Vector3, yaw: float) -> float:
    """The yaw with which the shape fits best, looked for everywhere, then more and more finely around the best."""
    misfits: dict[float, float] = {}
    for angles in ((yaw, *_YAWS), *((-step, step) for step in _FINER)):
        best = min(misfits, key=lambda angle: misfits[angle]) if misfits else 0.0
        for angle in (float(best + step) for step in angles):
            fit = _fit(scene, shape, size, angle, _ROUGH, _ROUGH_POINTS)
            misfits[angle] = math.inf if fit is None else fit.misfit
    return min(misfits, key=lambda angle: misfits[angle])


def _fit(
    scene: _Scene, shape: Shape, size: Vector3, yaw: float, iterations: int = _ITERATIONS, count: int = _MODEL_POINTS
) -> _Fit | None:
    """The place at which the shape, turned by `yaw`, lies on the points; None if no part of it could be seen there."""
    c, s = math.cos(yaw), math.sin(yaw)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    middle = _middle(scene.points, scene.weights)
    ahead = (middle - scene.eye) / np.linalg.norm(middle - scene.eye)
    position = middle + 0.3 * min(size) * ahead
    reach = 0.5 * math.hypot(*size) + _IN_FRONT
    for iteration in range(iterations):
        if iteration in (0, 2, 5):
            surface, weights = seen_alone(shape, size, turn.T @ (scene.eye - position), count)
            surface = surface @ turn.T
        free, _ = scene.expected(surface + position)
        near = np.linalg.norm(scene.points - position, axis=1) < 2.0 * reach
        if not free.any() or not near.any():
            return None
        difference = _middle(scene.points[near], scene.weights[near]) - _middle(surface[free], weights[free]) - position
        position = position + difference
        if np.linalg.norm(difference) < _SETTLED:
            break
    free, colored = scene.expected(surface + position)
    share = float(weights[free].sum())
    misfit = distances(shape, size, (scene.points[near] - position) @ turn)
    agreement = float(weights[colored].sum()) / max(share, 1e-9)
    return _Fit(position, share, agreement, float(misfit.mean()), yaw)


def _middle(points: Array, weights: Array) -> Array:
    return np.asarray(weights @ points / weights.sum())
