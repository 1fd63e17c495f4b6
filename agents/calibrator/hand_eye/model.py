"""How the mount, the target, the lens and the hand's errors make the pixels that are seen: residuals and derivatives.

A right perturbation moves each pose, T exp(xi). The *slip* of a view is the pose of the hand in the frame where the
robot tells that the hand is. Common parameters are, in this order: the mount (6), the target (6), the logarithm of the
target's scale (1), the lens and the joint offsets as far as these are free.
"""

from __future__ import annotations

from typing import NamedTuple

import msgspec
import numpy as np

from agents.calibrator.hand_eye.observations import Observations
from dsr.math3d import transforms
from dsr.math3d.batches import inverses, skew
from dsr.math3d.transforms import Array
from dsr.vocabulary.distortion import Distortion
from dsr.vocabulary.intrinsics import Intrinsics

_STEP = 1e-6
"""Half the width of the central differences by coefficients of the lens, which have no unit"""
FIXED = 13
"""Common parameters that there always are"""


class Parameters(NamedTuple):
    """A guess of all that is unknown."""

    mount: Array
    """(4, 4) carrier_from_camera"""
    target: Array
    """(4, 4) holder_from_target"""
    scale: float
    """Logarithm of the target's true over its told size"""
    intrinsics: Intrinsics
    slips: Array
    """(v, 4, 4) told_from_true of the hand"""
    offsets: Array
    """(k,) what is to be added to each joint, rad or m"""


class Linear(NamedTuple):
    """Residuals of all points, seen minus predicted, and the derivatives of what is predicted."""

    residuals: Array
    """(v, n, 2) px; 0 of points that were not found"""
    by_common: Array
    """(v, n, 2, c)"""
    by_slip: Array
    """(v, n, 2, 6)"""


class ViewModel:
    """The measuring of one set of observations.

    Args:
        observations: what is seen.
        fits_lens: whether the intrinsics are unknown, too.
        fits_offsets: whether each joint has a constant error.
    """

    def __init__(self, observations: Observations, *, fits_lens: bool = False, fits_offsets: bool = False) -> None:
        self.observations, self.fits_lens, self.fits_offsets = observations, fits_lens, fits_offsets
        self.seen = observations.seen
        self._pixels = np.where(self.seen[..., None], observations.pixels, 0.0)
        self._holders = observations.holders

    def points(self, now: Parameters) -> Array:
        """(v, n, 3) m, the target's points before the camera."""
        carrier_from_target = self._holders_of(now) @ now.target
        camera_from_target = inverses(now.mount) @ carrier_from_target
        scaled = np.exp(now.scale) * self.observations.points
        return np.asarray(
            np.einsum("vij,nj->vni", camera_from_target[:, :3, :3], scaled) + camera_from_target[:, None, :3, 3]
        )

    def residuals(self, now: Parameters) -> Array:
        """(v, n, 2) px, seen minus predicted; 0 of points that were not found, NaN of those not before the camera."""
        points = self.points(now)
        ahead = np.where(points[..., 2:] > 0.0, points, np.nan)
        with np.errstate(invalid="ignore", over="ignore"):
            off = self._pixels - now.intrinsics.project(ahead)
        return np.where(self.seen[..., None], off, 0.0)

    def linearised(self, now: Parameters) -> Linear:
        """Residuals and derivatives at parameters under which all points that were found are before the camera."""
        holders, scaled = self._holders_of(now), np.exp(now.scale) * self.observations.points
        turn, shift = now.target[:3, :3], now.target[:3, 3]
        in_holder = scaled @ turn.T + shift  # (n, 3)
        in_carrier = np.einsum("vij,nj->vni", holders[:, :3, :3], in_holder) + holders[:, None, :3, 3]
        in_camera = (in_carrier - now.mount[:3, 3]) @ now.mount[:3, :3]
        pixels, by_point = now.intrinsics.project_with_derivative(in_camera)
        by_carrier = by_point @ now.mount[:3, :3].T  # (v, n, 2, 3)
        by_holder = by_carrier @ holders[:, None, :3, :3]
        unit = np.broadcast_to(np.eye(3), (*in_camera.shape, 3))
        parts = [
            by_point @ np.concatenate([-unit, skew(in_camera)], axis=-1),
            by_holder @ np.concatenate([np.broadcast_to(turn, (len(scaled), 3, 3)), -turn @ skew(scaled)], axis=-1),
            by_holder @ (scaled @ turn.T)[:, :, None],
        ]
        if self.fits_lens:
            parts.append(_by_lens(in_camera, now.intrinsics))
        if self.fits_offsets:
            parts.append(np.zeros((*pixels.shape, len(now.offsets))))
        if self.observations.is_in_hand:
            by_slip = by_carrier @ np.concatenate([-unit, skew(in_carrier)], axis=-1)
        else:
            moved = np.concatenate([np.broadcast_to(np.eye(3), (len(scaled), 3, 3)), -skew(in_holder)], axis=-1)
            by_slip = by_holder @ moved
        by_common = np.concatenate(parts, axis=-1)
        counts = self.seen[..., None]
        residuals = np.where(counts, self._pixels - pixels, 0.0)
        return Linear(residuals, np.where(counts[..., None], by_common, 0.0), np.where(counts[..., None], by_slip, 0.0))

    def moved(self, now: Parameters, common: Array, slips: Array) -> Parameters:
        """The parameters after a step: common (c,) and of each view's slip (v, 6)."""
        at = FIXED
        intrinsics, offsets = now.intrinsics, now.offsets
        if self.fits_lens:
            numbers = lens_numbers(intrinsics)
            intrinsics = with_numbers(intrinsics, numbers + common[at : at + len(numbers)])
            at += len(numbers)
        if self.fits_offsets:
            offsets = offsets + common[at:]
        return Parameters(
            now.mount @ transforms.exp(common[:6]).matrix,
            now.target @ transforms.exp(common[6:12]).matrix,
            now.scale + float(common[12]),
            intrinsics,
            now.slips @ np.array([transforms.exp(slip).matrix for slip in slips]).reshape(-1, 4, 4),
            offsets,
        )

    def _holders_of(self, now: Parameters) -> Array:
        """(v, 4, 4) carrier_from_holder with the slips."""
        return inverses(now.slips) @ self._holders if self.observations.is_in_hand else self._holders @ now.slips


def lens_numbers(intrinsics: Intrinsics) -> Array:
    """(4 + k,) fx, fy, cx, cy (px) and the k coefficients of the distortion."""
    coefficients = () if intrinsics.distortion is None else intrinsics.distortion.coefficients
    return np.array([intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy, *coefficients])


def with_numbers(intrinsics: Intrinsics, numbers: Array) -> Intrinsics:
    """The same camera with other `lens_numbers`."""
    fx, fy, cx, cy, *coefficients = numbers.tolist()
    lens = intrinsics.distortion
    distortion = None if lens is None else Distortion(lens.model, tuple(coefficients))
    return msgspec.structs.replace(intrinsics, fx=fx, fy=fy, cx=cx, cy=cy, distortion=distortion)


def _by_lens(points: Array, intrinsics: Intrinsics) -> Array:
    """(v, n, 2, 4 + k) derivatives of pixels of points (v, n, 3) by `lens_numbers`."""
    flat = points[..., :2] / points[..., 2:]
    lens = intrinsics.distortion
    shown = flat if lens is None else lens.distort(flat)
    focal = np.array([intrinsics.fx, intrinsics.fy])
    pinhole = np.zeros((*shown.shape, 4))
    pinhole[..., 0, 0], pinhole[..., 1, 1] = shown[..., 0], shown[..., 1]
    pinhole[..., 0, 2] = pinhole[..., 1, 3] = 1.0
    if lens is None:
        return pinhole
    columns = [pinhole]
    for index in range(len(lens.coefficients)):
        ends = []
        for step in (_STEP, -_STEP):
            coefficients = list(lens.coefficients)
            coefficients[index] += step
            ends.append(Distortion(lens.model, tuple(coefficients)).distort(flat))
        columns.append((focal * (ends[0] - ends[1]) / (2.0 * _STEP))[..., None])
    return np.concatenate(columns, axis=-1)
