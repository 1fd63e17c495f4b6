"""The plane of a tag from the depth image: a robust fit in inverse depth.

On a plane n . X = d (camera frame), a pixel with ray r = (x, y, 1) has depth z with 1/z = (n / d) . r: linear
in the ray, and a stereo camera's error in 1/z is the same at all distances. So p = n / d is found by
reweighted linear least squares (Cauchy weights against wrong depths).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dsr.math3d.transforms import Array
from dsr.vocabulary.intrinsics import Intrinsics

_INSET = 0.95  # of the tag's half diagonals, so that no pixel straddles its edge
_MAX_PIXELS = 2000
_MIN_PIXELS = 40
_MIN_VALID = 0.5  # of the pixels within the tag
_ITERATIONS = 5
_CAUCHY = 2.385  # scales, for 95 % efficiency on Gaussian errors
_NO_PLANE = 0.05  # residual scale, of the inverse depth, above which this is no plane
_MIN_COSINE = 0.1  # between normal and viewing ray


@dataclass(frozen=True)
class DepthPlane:
    """A plane p . X = 1 in the camera frame."""

    p: Array
    """(3,) normal away from the camera over distance, 1/m."""
    covariance: Array
    """(3, 3) of p, from the residuals, 1/m^2."""

    @property
    def normal(self) -> Array:
        """(3,) unit normal towards the camera."""
        return np.asarray(-self.p / np.linalg.norm(self.p))

    def points(self, rays: Array) -> Array:
        """(n, 3) where rays (n, 3) meet the plane, m."""
        return np.asarray(rays / (rays @ self.p)[:, None])


def fit_depth_plane(
    corners: Array, depth: NDArray[np.float32], intrinsics: Intrinsics, *, noise_floor: float, correlation: float
) -> DepthPlane | None:
    """Fit the plane within a tag's outline.

    Args:
        corners: (4, 2) px, in order around the tag.
        depth: (h, w) m along the optical axis; 0 or not finite where unknown.
        intrinsics: of the depth image, px.
        noise_floor: 1/m, least standard deviation of the inverse depth (hides quantisation).
        correlation: px, over which neighbouring depth errors are alike.

    Returns:
        None if too little depth is known there, or it is no plane seen from its front.
    """
    pixels, stride = _pixels_within(corners, depth.shape)
    if len(pixels) < _MIN_PIXELS:
        return None
    z = depth[pixels[:, 1], pixels[:, 0]].astype(np.float64)
    valid = np.isfinite(z) & (z > 0.0)
    if valid.sum() < max(_MIN_PIXELS, _MIN_VALID * len(z)):
        return None
    rays = intrinsics.rays(pixels[valid].astype(np.float64))
    p, precision, scale = _robust_fit(rays, 1.0 / z[valid], noise_floor)
    alike = max(1.0, correlation / stride) ** 2
    plane = DepthPlane(p, np.asarray(scale**2 * alike * np.linalg.inv(precision)))
    inverse_depths = rays @ p
    cosines = inverse_depths / np.linalg.norm(p) / np.linalg.norm(rays, axis=1)
    well_seen = cosines.min() > _MIN_COSINE and scale < _NO_PLANE * float(np.median(inverse_depths))
    return plane if well_seen else None


def _pixels_within(corners: Array, shape: tuple[int, ...]) -> tuple[NDArray[np.int64], int]:
    """(n, 2) pixels (u, v) inside the inset outline, and the stride at which they were taken."""
    centre = corners.mean(axis=0)
    outline = centre + _INSET * (corners - centre)
    low = np.maximum(np.ceil(outline.min(axis=0)), 0).astype(int)
    high = np.minimum(np.floor(outline.max(axis=0)), [shape[1] - 1, shape[0] - 1]).astype(int)
    area = float(np.prod(np.maximum(high - low + 1, 0)))
    stride = max(1, int(np.ceil(np.sqrt(area / _MAX_PIXELS))))
    u, v = np.meshgrid(np.arange(low[0], high[0] + 1, stride), np.arange(low[1], high[1] + 1, stride))
    pixels = np.column_stack([u.ravel(), v.ravel()])
    edges = np.roll(outline, -1, axis=0) - outline
    offsets = pixels[:, None, :] - outline
    sides = edges[:, 0] * offsets[..., 1] - edges[:, 1] * offsets[..., 0]
    return pixels[(sides >= 0.0).all(axis=1) | (sides <= 0.0).all(axis=1)], stride


def _robust_fit(rays: Array, inverse_depth: Array, noise_floor: float) -> tuple[Array, Array, float]:
    """Plane p (3,), its precision matrix for unit noise (3, 3), and the noise's scale, 1/m.

    It starts at the plane across the view at the median depth, which wrong depths at an edge cannot tilt.
    """
    residuals = inverse_depth - np.median(inverse_depth)
    for _ in range(_ITERATIONS):
        weights = 1.0 / (1.0 + (residuals / (_CAUCHY * _scale(residuals, noise_floor))) ** 2)
        precision = (rays * weights[:, None]).T @ rays
        p = np.linalg.solve(precision, rays.T @ (weights * inverse_depth))
        residuals = inverse_depth - rays @ p
    return np.asarray(p, np.float64), precision, _scale(residuals, noise_floor)


def _scale(residuals: Array, noise_floor: float) -> float:
    """Their standard deviation, from the median so that outliers do not matter."""
    return max(1.4826 * float(np.median(np.abs(residuals))), noise_floor)
