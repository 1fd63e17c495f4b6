"""How an object that does not stand upright is turned, from the points of its surface that are seen.

Where nothing tells how it was turned before, rotations all over SO(3) are tried. Near the rotation of the frame before,
the pose at which the points are nearest to the surface is looked for by Gauss-Newton steps (point to surface, after
Chen and Medioni, IVC 1992), with the middle of the points as a prior of the place. What turns by less than 35 degrees
from frame to frame is followed so, to any rotation.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from agents.scene_estimator.fitting import ROUGH, ROUGH_RAYS, Fit, ImagePart, fit, judged
from dsr.math3d import quaternions
from dsr.math3d.quaternions import Quaternion, Vector3
from dsr.math3d.shapes import Shape
from dsr.math3d.surfaces import distances, signed_distances, surface
from dsr.math3d.transforms import Array

_TRIED = 200
"""Rotations that are tried of an object of which none is known: of 99 %, one is within 0.6 rad (`_FARTHEST`)"""
_REFINED = 8
"""The best of these, from which the rotation is looked for more finely"""
_STEPS = 15
_SHARE = 300  # points at which the surface is looked for
_STIFF = 0.3  # rad, and
_FIRM = 0.02  # m: standard deviations of a step, and of the place by the middle of the points
_PRIOR = np.diag([_STIFF**-2] * 3 + [_FIRM**-2] * 3)
_SETTLED = 3e-3  # rad
_FARTHEST = 0.6  # rad from the guess
_TOGETHER = 10  # points of whose errors only one tells something
_UNLIKE = 1.5  # times the mean distance of the points, with which another rotation is no match
_PSI = 1.533751168755204288118041  # the real root of psi^4 = psi + 4: turns of the spiral
_APART = 1e-4  # m, between the points of a difference quotient
_FALLEN = [
    np.array(quaternions.to_matrix(quaternions.from_rotvec(rotation)))
    for rotation in (
        (0.5 * math.pi, 0.0, 0.0),
        (-0.5 * math.pi, 0.0, 0.0),
        (0.0, 0.5 * math.pi, 0.0),
        (0.0, -0.5 * math.pi, 0.0),
        (math.pi, 0.0, 0.0),
    )
]


def leaning(scene: ImagePart, shape: Shape, size: Vector3, guess: Array, good: float) -> Fit | None:
    """The fit of a shape near the rotation `guess`; None if there is none, or only one far from the guess.

    Args:
        scene: what is seen.
        shape: of the object; without parts, a box of `size` m.
        size: edge lengths of its bounding box, m.
        guess: (3, 3) world_from_object.
        good: m, mean distance of the points from the surface in a good fit.
    """
    found = fit(scene, shape, size, guess, ROUGH, ROUGH_RAYS)
    if found is None:
        return None
    rotation, position = guess, found.position
    near = scene.points[scene.around(position, size)]
    near = near[:: max(1, len(near) // _SHARE)]
    for _ in range(_STEPS):
        step = _step(near, shape, size, rotation, position, found.position, good)
        rotation = np.array(quaternions.to_matrix(quaternions.from_rotvec((step[0], step[1], step[2])))) @ rotation
        position = position + step[3:]
        if float(np.linalg.norm(step[:3])) < _SETTLED:
            break
    return judged(scene, shape, size, rotation, position) if _angle(rotation @ guess.T) < _FARTHEST else None


def anyhow(scene: ImagePart, shape: Shape, size: Vector3, good: float) -> Fit | None:
    """The fit of a shape of which no rotation is known; None if none is good, or if others are as good elsewhere.

    Of rotations that look alike, that is found by which it is tilted least. Others are elsewhere if any part of the
    surface is farther off than points are in a good fit.

    Args:
        scene: what is seen.
        shape: of the object; without parts, a box of `size` m.
        size: edge lengths of its bounding box, m.
        good: m, mean distance of the points from the surface in a good fit.
    """
    rough = [fit(scene, shape, size, rotation, ROUGH, ROUGH_RAYS) for rotation in _all_rotations()]
    starts = sorted((one for one in rough if one is not None), key=lambda one: one.misfit)[:_REFINED]
    best = _best(leaning(scene, shape, size, start.rotation, good) for start in starts)
    if best is None or best.misfit > good:
        return None
    rivals = [leaning(scene, shape, size, best.rotation @ fallen, good) for fallen in _FALLEN]
    alike = [best, *(one for one in rivals if one is not None and one.misfit <= _UNLIKE * best.misfit)]
    if any(_apart(shape, size, best, one) > good for one in alike):
        return None
    return min(alike, key=lambda one: tilt(one.rotation))


def _best(fits: Iterable[Fit | None]) -> Fit | None:
    return min((one for one in fits if one is not None), key=lambda one: one.misfit, default=None)


class Turned(NamedTuple):
    """How certain the rotation of a fitted shape is."""

    tilt_sigma: float
    """rad, standard deviation of the worse known of the two directions in which it may lean"""
    yaw_sigma: float
    """rad, of its turn about its own z axis"""
    yaw_off: float
    """rad, by which it should be turned about that axis to lie better on the points"""


def turned(scene: ImagePart, shape: Shape, size: Vector3, found: Fit, sigma: float) -> Turned:
    """Estimate how certain the rotation of a fit is, if points are off by `sigma` (m), ten of them together.

    The estimate uses the sum of squared distances around the fit.
    """
    near = scene.points[scene.around(found.position, size)]
    near = near[:: max(1, len(near) // _SHARE)]
    jacobian, distance = _linear(near, shape, size, found.rotation, found.position)
    information = jacobian.T @ jacobian / (_TOGETHER * sigma**2) + _PRIOR
    covariance, up = np.linalg.inv(information), found.rotation[:, 2]
    about = np.vstack([np.append(up, np.zeros(3)), np.eye(6)[3:]])  # that axis, and where it is
    weighted = jacobian / (sigma**2 + distance**2)[:, None]
    normal = about @ (weighted.T @ jacobian + _PRIOR) @ about.T
    return Turned(
        math.sqrt(float(np.linalg.eigvalsh(covariance[:2, :2])[-1])),
        math.sqrt(float(up @ covariance[:3, :3] @ up)),
        float(np.linalg.solve(normal, -about @ (weighted.T @ distance))[0]),
    )


def is_unlike_fallen(scene: ImagePart, shape: Shape, size: Vector3, found: Fit) -> bool:
    """Whether what stands could not as well lie on a side, or on its head: as a cube could, or a box from below."""
    others = (fit(scene, shape, size, found.rotation @ fallen, ROUGH, ROUGH_RAYS) for fallen in _FALLEN)
    return all(other is None or other.misfit > _UNLIKE * found.misfit for other in others)


def tilt(rotation: Array) -> float:
    """rad, between the vertical and an object's own z axis, with its rotation (3, 3)."""
    return float(np.arccos(np.clip(rotation[2, 2], -1.0, 1.0)))


def lean(rotation: Array, upright: Array) -> Quaternion:
    """Compute the rotation in the world that takes an object from `upright` to `rotation`, both (3, 3)."""
    return quaternions.from_matrix((rotation @ upright.T).tolist())


def _step(
    points: Array, shape: Shape, size: Vector3, rotation: Array, position: Array, middle: Array, good: float
) -> Array:
    """(6,) rotation vector and shift in the world by which points (n, 3) come nearer to the surface.

    `middle` (3,) m is where the shape would be by the middle of the points: it stays near, in what they do not tell.
    """
    jacobian, distance = _linear(points, shape, size, rotation, position)
    weighted = jacobian / (good**2 + distance**2)[:, None]
    normal = weighted.T @ jacobian + _PRIOR
    pull = np.concatenate([np.zeros(3), (middle - position) / _FIRM**2])
    return np.asarray(np.linalg.solve(normal, pull - weighted.T @ distance))


def _linear(points: Array, shape: Shape, size: Vector3, rotation: Array, position: Array) -> tuple[Array, Array]:
    """Derivatives (n, 6) of the distances of points from the surface by a turn and a shift of it, and those (n,)."""
    arms = points - position
    distance, slope = _slopes(shape, size, arms @ rotation)
    slope = slope @ rotation.T
    return np.hstack([-np.cross(arms, slope), -slope]), distance


def _slopes(shape: Shape, size: Vector3, points: Array) -> tuple[Array, Array]:
    """Signed distances (n,) of points from a surface, and their gradients (n, 3)."""
    here = signed_distances(shape, size, points)
    steps = [signed_distances(shape, size, points + _APART * axis) for axis in np.eye(3)]
    return here, np.column_stack([(there - here) / _APART for there in steps])


def _apart(shape: Shape, size: Vector3, one: Fit, other: Fit) -> float:
    """m, greatest distance of the surface of one fit from that of another: a cup's bottom is a small part of a cup."""
    points = surface(shape, size).points @ other.rotation.T + other.position
    return float(distances(shape, size, (points - one.position) @ one.rotation).max())


@functools.cache
def _all_rotations() -> list[Array]:
    """Rotations (3, 3), about as far from each other all over SO(3): a super-Fibonacci spiral (Alexa, CVPR 2022)."""
    places = np.arange(_TRIED) + 0.5
    inner, outer = np.sqrt(1.0 - places / _TRIED), np.sqrt(places / _TRIED)
    one, other = 2.0 * np.pi * places / math.sqrt(2.0), 2.0 * np.pi * places / _PSI
    turns = np.column_stack([inner * np.sin(one), inner * np.cos(one), outer * np.sin(other), outer * np.cos(other)])
    return [np.array(quaternions.to_matrix((x, y, z, w))) for x, y, z, w in turns.tolist()]


def _angle(rotation: Array) -> float:
    """rad, of a rotation (3, 3)."""
    return math.acos(min(max((float(np.trace(rotation)) - 1.0) / 2.0, -1.0), 1.0))
