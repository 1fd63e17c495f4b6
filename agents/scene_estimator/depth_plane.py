"""The planes of tags from the depth image: robust fits in inverse depth, of all tags at once.

On a plane n . X = d (camera frame), a pixel with ray r = (x, y, 1) has depth z with 1/z = (n / d) . r: linear
in the ray, and a stereo camera's error in 1/z is the same at all distances. So p = n / d is found by
reweighted linear least squares (Cauchy weights against wrong depths).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dsr.math3d.batches import Array, matrix_inverses
from dsr.vocabulary.intrinsics import Intrinsics

_INSET = 0.95  # of the tag's half diagonals, so that no pixel straddles its edge
_MAX_PIXELS = 2000
_MIN_PIXELS = 40
_MIN_VALID = 0.5  # of the pixels within the tag
_ENOUGH_PIXELS = 4 * _MIN_PIXELS / _MIN_VALID  # of the box around a tag: one that lies askew fills a quarter
_ITERATIONS = 5
_CAUCHY = 2.385  # scales, for 95 % efficiency on Gaussian errors
_NO_PLANE = 0.05  # residual scale, of the inverse depth, above which this is no plane
_MIN_COSINE = 0.1  # between normal and viewing ray


class DepthPlanes(NamedTuple):
    """Planes p . X = 1 in the camera frame; NaN where there is none."""

    p: Array
    """(n, 3) normal away from the camera over distance, 1/m."""
    covariance: Array
    """(n, 3, 3) of p, from the residuals, 1/m^2."""

    @property
    def exist(self) -> NDArray[np.bool_]:
        """(n,) which of them there are."""
        return np.asarray(np.isfinite(self.p).all(axis=1) & np.isfinite(self.covariance).all(axis=(1, 2)))

    @property
    def normals(self) -> Array:
        """(n, 3) unit normals towards the camera."""
        return np.asarray(-self.p / np.linalg.norm(self.p, axis=1, keepdims=True))

    def points(self, rays: Array) -> Array:
        """(n, k, 3) m, where rays (n, k, 3) meet their planes."""
        return np.asarray(rays / (rays @ self.p[:, :, None]))


def fit_depth_planes(
    corners: Array, depth: NDArray[np.float32], intrinsics: Intrinsics, *, noise_floor: float, correlation: float
) -> DepthPlanes:
    """Fit the planes within the outlines of tags.

    There is none where too little depth is known, and none where it is no plane that is seen from its front.

    Args:
        corners: (n, 4, 2) px, finite, in order around each tag.
        depth: (h, w) m along the optical axis; 0 or not finite where unknown.
        intrinsics: of the depth image, px.
        noise_floor: 1/m, least standard deviation of the inverse depth (hides quantisation).
        correlation: px, over which neighbouring depth errors are alike.
    """
    planes = DepthPlanes(np.full((len(corners), 3), np.nan), np.full((len(corners), 3, 3), np.nan))
    tag, u, v, stride = _pixels_within(corners, depth.shape, correlation)
    within = np.bincount(tag, minlength=len(corners))
    z = depth.ravel().take(v * depth.shape[1] + u).astype(np.float64)
    valid = np.isfinite(z) & (z > 0.0)
    known = np.bincount(tag[valid], minlength=len(corners))
    enough = (within >= _MIN_PIXELS) & (known >= np.maximum(_MIN_PIXELS, _MIN_VALID * within))
    valid &= enough[tag]
    if not valid.any():
        return planes
    if not valid.all():
        u, v, z = u[valid], v[valid], z[valid]
    cloud = _Pixels.of(*intrinsics.slopes_at(u, v), 1.0 / z, known[enough])
    p, precision, scale = _robust_fit(cloud, noise_floor)
    inverse_depths = cloud.along(p)
    lengths = np.linalg.norm(p, axis=1)[:, None] * np.sqrt(np.maximum((cloud.rays**2).sum(axis=1), 1.0))
    flattest = np.where(cloud.used, inverse_depths / lengths, np.inf).min(axis=1)
    is_plane = scale < _NO_PLANE * cloud.medians(inverse_depths)
    alike = np.maximum(1.0, correlation / stride[enough]) ** 2
    good = (flattest > _MIN_COSINE) & is_plane
    planes.p[np.flatnonzero(enough)[good]] = p[good]
    covariance = (scale**2 * alike)[:, None, None] * matrix_inverses(precision)
    planes.covariance[np.flatnonzero(enough)[good]] = covariance[good]
    return planes


class _Pixels(NamedTuple):
    """Pixels with depth of n tags, each with at most m; what a tag has less is not used."""

    rays: Array
    """(n, 3, m), 0 where not used"""
    inverse_depth: Array
    """(n, m) 1/m, 0 where not used"""
    used: NDArray[np.bool_]
    """(n, m)"""
    known: NDArray[np.int64]
    """(n,) how many are used"""

    @staticmethod
    def of(x: Array, y: Array, inverse_depth: Array, known: NDArray[np.int64]) -> _Pixels:
        """Those of pixels sorted by tag, with rays (x, y, 1) and inverse depths (k,), `known` (n,) of each tag."""
        used = np.arange(known.max()) < known[:, None]
        found = _Pixels(np.zeros((len(known), 3, used.shape[1])), np.zeros(used.shape), used, known)
        found.rays[:, 0][used], found.rays[:, 1][used], found.rays[:, 2] = x, y, used
        found.inverse_depth[used] = inverse_depth
        return found

    def along(self, p: Array) -> Array:
        """(n, m) 1/m, inverse depths where the rays meet planes p (n, 3)."""
        return np.asarray((p[:, None] @ self.rays)[:, 0])

    def medians(self, values: Array) -> Array:
        """(n,) the medians over the pixels that are used, of values (n, m), as exactly as depth images are stored."""
        told = np.where(self.used, values.astype(np.float32), np.float32(np.inf))  # these are sorted twice as fast
        ordered, rows = np.sort(told, axis=1), np.arange(len(values))
        middles = ordered[rows, (self.known - 1) // 2].astype(np.float64) + ordered[rows, self.known // 2]
        return np.asarray(0.5 * middles)

    def scales(self, residuals: Array, noise_floor: float) -> Array:
        """(n,) standard deviations of residuals (n, m), from the medians so that outliers do not matter."""
        return np.maximum(1.4826 * self.medians(np.abs(residuals)), noise_floor)


def _pixels_within(
    corners: Array, shape: tuple[int, ...], correlation: float
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Pixels inside the inset outlines of tags: tag, u and v of each, by tag, and the stride of each tag.

    Two pixels within a `correlation` (px) tell what all of them do.
    """
    centre = corners.mean(axis=1, keepdims=True)
    outline = centre + _INSET * (corners - centre)
    last = np.array([shape[1] - 1, shape[0] - 1])
    low = np.clip(np.ceil(outline.min(axis=1)), 0, last + 1).astype(np.int64)
    high = np.clip(np.floor(outline.max(axis=1)), -1, last).astype(np.int64)
    extent = np.maximum(high - low + 1, 0)
    area = extent.prod(axis=1)
    alike = np.minimum(0.5 * correlation, np.sqrt(area / _ENOUGH_PIXELS)).astype(np.int64)
    stride = np.maximum(1, np.maximum(alike, np.ceil(np.sqrt(area / _MAX_PIXELS)).astype(np.int64)))
    columns, rows = (-(-extent // stride[:, None])).T
    number = np.arange((columns * rows).max(initial=0))
    row, column = np.divmod(number, np.maximum(columns, 1)[:, None])
    u, v = (low[:, axis, None] + stride[:, None] * step for axis, step in ((0, column), (1, row)))
    across, down = u.astype(np.float64), v.astype(np.float64)
    edges = np.roll(outline, -1, axis=1) - outline
    left = right = number < (columns * rows)[:, None]
    for corner in range(4):
        x, y, along_x, along_y = np.hstack([outline[:, corner], edges[:, corner]]).T[:, :, None]
        side = along_x * down - along_y * across + (along_y * x - along_x * y)
        left, right = left & (side >= 0.0), right & (side <= 0.0)
    inside = left | right
    return np.nonzero(inside)[0], u[inside], v[inside], stride


def _robust_fit(pixels: _Pixels, noise_floor: float) -> tuple[Array, Array, Array]:
    """Planes p (n, 3), their precision matrices for unit noise (n, 3, 3), and the noise's scales (n,), 1/m.

    Each starts at the plane across the view at the median depth, which wrong depths at an edge cannot tilt.
    `noise_floor` is the least scale.
    """
    residuals = pixels.inverse_depth - pixels.medians(pixels.inverse_depth)[:, None]
    by_pixel = np.swapaxes(pixels.rays, 1, 2)
    for _ in range(_ITERATIONS):
        spread = _CAUCHY * pixels.scales(residuals, noise_floor)
        weighted = pixels.rays / (1.0 + (residuals / spread[:, None]) ** 2)[:, None]
        precision = weighted @ by_pixel
        p = (matrix_inverses(precision) @ (weighted @ pixels.inverse_depth[..., None]))[..., 0]
        residuals = pixels.inverse_depth - pixels.along(p)
    return p, precision, pixels.scales(residuals, noise_floor)
