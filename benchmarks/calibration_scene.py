"""A camera above cubes that is not where it is believed to be, with percepts as they are measured; for calibrations."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from agents.calibrator.config import CalibratorConfig
from agents.calibrator.solve.fusing import fuse
from agents.calibrator.solve.problem import ObjectSighting
from agents.plant.poses import DISTANCES, SIGMA_ROTATION, SIGMA_TRANSLATION
from dsr.math3d.transforms import Array, Pose, looking_at

FRAMES = 10
"""Percepts of each cube in a view: a second of a camera"""
LAYOUTS = {f"{2000 * half:.0f} mm": half for half in (0.021, 0.03, 0.045, 0.065, 0.10, 0.16)}
"""Four cubes of 40 mm at the corners of a square, by half the distance of their centres, m: clustered to covering"""

_CENTRE = (0.35, 0.0, 0.02)
_APART = 0.05  # m between the centres of cubes that are placed at random, at least
_BELIEF = np.array([2e-4, 2e-4, 3e-4, 4.9e-3, 4.9e-3, 1.3e-3])  # m, rad: what the belief says of a cube that rests
_BELIEF_ERROR = np.array([2e-4, 2e-4, 0.0, 0.0, 0.0, 1e-3])  # m, rad: it lies flat on the table
EVALUATED_FROM = ((0.33, -0.02, 0.50), (0.19, -0.02, 0.46), (0.32, 0.156, 0.46), (0.32, -0.156, 0.46))
_GRIPPER_FROM_CAMERA = Pose((0.0, 0.056, 0.0), (0.0, 0.0, 1.0, 0.0))


class Distortion(NamedTuple):
    """How far the camera may be from where it is believed, along and about each axis."""

    metres: float
    radians: float


BUMPED = Distortion(0.10, math.radians(15.0))
MEASURED_BY_HAND = Distortion(0.005, math.radians(2.0))


class Depth(NamedTuple):
    """Errors of depth along the viewing ray beyond those of the tag's pose."""

    bias: tuple[float, float] = (0.0, 0.0)
    """m, least and greatest of what each cube has."""
    jitter: float = 0.0
    """m, standard deviation in each frame."""


EXACT = Depth()
DEPTH = Depth((0.005, 0.015), 0.003)
"""As in the scenario `hovering`."""


class Trial(NamedTuple):
    """One calibration to do."""

    sightings: list[ObjectSighting]
    truth: Pose
    """gripper_from_camera"""
    believed: Pose
    """The same, before."""
    cubes: list[Pose]
    """world_from_cube"""

    def error_elsewhere(self, found: Pose) -> float:
        """M by which the cubes are misplaced from four other arm poses, with the camera mounted as it was `found`."""
        errors = []
        for place in EVALUATED_FROM:
            world_from_gripper = looking(place) @ _GRIPPER_FROM_CAMERA.inverse()
            moved = world_from_gripper @ found @ (world_from_gripper @ self.truth).inverse()
            errors += [math.dist((moved @ cube).t, cube.t) for cube in self.cubes]
        return float(np.mean(errors))


def make_trial(
    rng: np.random.Generator,
    places: Array,
    *,
    views: int = 1,
    distortion: Distortion = BUMPED,
    flipped: float = 0.0,
    depth: Depth = EXACT,
) -> Trial:
    """A wrist camera that looks down on cubes at `places` (n, 2; m from the centre), then from other arm poses too.

    Args:
        rng: of noise and distortion.
        places: of the cubes.
        views: arm poses, at most 5.
        distortion: greatest difference between the camera's true and believed mount.
        flipped: share of the sightings whose orientation is wrong in all frames of a view.
        depth: further errors.
    """
    truth = _GRIPPER_FROM_CAMERA
    shift = rng.uniform(-1.0, 1.0, 6) * np.repeat(distortion, 3)
    cubes = [
        Pose.from_rotvec((_CENTRE[0] + x, _CENTRE[1] + y, _CENTRE[2]), (0.0, 0.0, rng.uniform(-math.pi, math.pi)))
        for x, y in places.tolist()
    ]
    beliefs = [_belief(rng, cube) for cube in cubes]
    biases = rng.uniform(*depth.bias, len(cubes))
    sightings = []
    for view, place in enumerate(((*_CENTRE[:2], 0.62), *EVALUATED_FROM)[:views]):
        world_from_camera = looking(place)
        gripper_from_world = truth @ world_from_camera.inverse()
        for number, (cube, belief) in enumerate(zip(cubes, beliefs, strict=True)):
            exact = world_from_camera.inverse() @ cube
            off = biases[number] + depth.jitter * rng.normal(size=FRAMES)
            seen = _seen(rng, exact @ _flip(rng) if rng.random() < flipped else exact, off)
            sightings.append(ObjectSighting(f"cube_{number + 1}", view, seen, gripper_from_world @ belief))
    return Trial(sightings, truth, truth @ Pose.from_rotvec(shift[:3], shift[3:]), cubes)


def scattered(rng: np.random.Generator, count: int, half: float = 0.15) -> Array:
    """(count, 2) places at random within a square of half width `half` (m) that do not touch."""
    places: list[Array] = []
    while len(places) < count:
        place = rng.uniform(-half, half, 2)
        if all(np.abs(place - other).max() > _APART for other in places):
            places.append(place)
    return np.array(places)


def square(half: float) -> Array:
    """(4, 2) corners of a square of half width `half` (m)."""
    return half * np.array([(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)])


def looking(place: tuple[float, float, float]) -> Pose:
    """world_from_camera of a camera at `place` (m) that looks at the middle of the cubes, its x axis horizontal."""
    return looking_at(place, _CENTRE, (1.0, 0.0, 0.0))


def _belief(rng: np.random.Generator, cube: Pose) -> Pose:
    error = rng.normal(size=6) * _BELIEF_ERROR
    return (cube @ Pose.from_rotvec(error[:3], error[3:])).with_covariance(np.diag(_BELIEF**2))


def _seen(rng: np.random.Generator, exact: Pose, off: Array) -> Pose:
    """camera_from_cube of the frames of one view, with the errors measured on images, and `off` (m) along the ray."""
    config, distance = CalibratorConfig(), float(np.linalg.norm(exact.t))
    sigmas = np.repeat([np.interp(distance, DISTANCES, sigma) for sigma in (SIGMA_TRANSLATION, SIGMA_ROTATION)], 3)
    percepts = []
    for error, farther in zip(rng.normal(size=(FRAMES, 6)) * sigmas, off.tolist(), strict=True):
        moved = Pose(exact.translation * (1.0 + farther / distance), exact.q)
        percept = moved @ Pose.from_rotvec(error[:3], error[3:])
        ray = percept.rotation_matrix.T @ percept.translation / distance
        covariance = np.diag(sigmas**2)
        covariance[:3, :3] += config.depth_bias**2 * np.outer(ray, ray)
        percepts.append(percept.with_covariance(covariance))
    return fuse(percepts, config.depth_bias, config.depth_scatter)


def _flip(rng: np.random.Generator) -> Pose:
    """A tag taken for one that is tilted the other way: 15 to 90 degrees about an axis in its plane."""
    angle, direction = math.radians(rng.uniform(15.0, 90.0)), rng.uniform(-math.pi, math.pi)
    return Pose.from_rotvec((0.0, 0.0, 0.0), (angle * math.cos(direction), angle * math.sin(direction), 0.0))
