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
    pixels, inside, stride = _pixels_within(corners, depth.shape)
    z = depth[pixels[..., 1], pixels[..., 0]].astype(np.float64)
    valid = inside & np.isfinite(z) & (z > 0.0)
    within, known = inside.sum(axis=1), valid.sum(axis=1)
    chosen = np.flatnonzero((within >= _MIN_PIXELS) & (known >= np.maximum(_MIN_PIXELS, _MIN_VALID * within)))
    if len(chosen) == 0:
        return planes
    valid, known = valid[chosen], known[chosen]
    used = np.arange(known.max()) < known[:, None]
    rays, inverse_depth = np.zeros((*used.shape, 3)), np.full(used.shape, np.inf)
    rays[used] = intrinsics.rays(pixels[chosen][valid].astype(np.float64))
    inverse_depth[used] = 1.0 / z[chosen][valid]
    p, precision, scale = _robust_fit(rays, inverse_depth, used, known, noise_floor)
    alike = np.maximum(1.0, correlation / stride[chosen]) ** 2
    inverse_depths = (rays @ p[:, :, None])[..., 0]
    cosines = inverse_depths / (np.linalg.norm(p, axis=1)[:, None] * np.linalg.norm(rays + ~used[..., None], axis=2))
    steepest = np.where(used, cosines, np.inf).min(axis=1)
    is_plane = scale < _NO_PLANE * _medians(np.where(used, inverse_depths, np.inf), known)
    good = (steepest > _MIN_COSINE) & is_plane
    planes.p[chosen[good]] = p[good]
    planes.covariance[chosen[good]] = ((scale**2 * alike)[:, None, None] * matrix_inverses(precision))[good]
    return planes


def _pixels_within(
    corners: Array, shape: tuple[int, ...]
) -> tuple[NDArray[np.int64], NDArray[np.bool_], NDArray[np.int64]]:
    """Pixels (n, m, 2) (u, v) around tags, which of them (n, m) are inside the inset outline, and the strides (n,)."""
    centre = corners.mean(axis=1, keepdims=True)
    outline = centre + _INSET * (corners - centre)
    last = np.array([shape[1] - 1, shape[0] - 1])
    low = np.clip(np.ceil(outline.min(axis=1)), 0, last + 1).astype(np.int64)
    high = np.clip(np.floor(outline.max(axis=1)), -1, last).astype(np.int64)
    extent = np.maximum(high - low + 1, 0)
    stride = np.maximum(1, np.ceil(np.sqrt(extent.prod(axis=1) / _MAX_PIXELS)).astype(np.int64))
    columns, rows = (-(-extent // stride[:, None])).T
    number = np.arange((columns * rows).max(initial=0))
    inside = number < (columns * rows)[:, None]
    row, column = np.divmod(number, np.maximum(columns, 1)[:, None])
    pixels = low[:, None, :] + stride[:, None, None] * np.stack([column, row], axis=-1)
    pixels[~inside] = 0
    edges = np.roll(outline, -1, axis=1) - outline
    left, right = inside.copy(), inside.copy()
    for corner, edge in zip(np.swapaxes(outline, 0, 1), np.swapaxes(edges, 0, 1), strict=True):
        side = edge[:, :1] * (pixels[..., 1] - corner[:, 1:]) - edge[:, 1:] * (pixels[..., 0] - corner[:, :1])
        left &= side >= 0.0
        right &= side <= 0.0
    return pixels, left | right, stride


def _robust_fit(
    rays: Array, inverse_depth: Array, used: NDArray[np.bool_], known: NDArray[np.int64], noise_floor: float
) -> tuple[Array, Array, Array]:
    """Planes p (n, 3), their precision matrices for unit noise (n, 3, 3), and the noise's scales (n,), 1/m.

    Each starts at the plane across the view at the median depth, which wrong depths at an edge cannot tilt.

    Args:
        rays: (n, m, 3), 0 where a tag has fewer pixels.
        inverse_depth: (n, m) 1/m, infinite there.
        used: (n, m) where it has pixels.
        known: (n,) how many.
        noise_floor: 1/m, least scale.
    """
    told = np.where(used, inverse_depth, 0.0)
    residuals = told - _medians(inverse_depth, known)[:, None]
    for _ in range(_ITERATIONS):
        spread = _CAUCHY * _scales(residuals, used, known, noise_floor)
        weights = 1.0 / (1.0 + (residuals / spread[:, None]) ** 2)
        weighted = np.swapaxes(rays * weights[..., None], 1, 2)
        precision = weighted @ rays
        p = (matrix_inverses(precision) @ (weighted @ told[..., None]))[..., 0]
        residuals = told - (rays @ p[:, :, None])[..., 0]
    return p, precision, _scales(residuals, used, known, noise_floor)


def _scales(residuals: Array, used: NDArray[np.bool_], known: NDArray[np.int64], noise_floor: float) -> Array:
    """Their standard deviations (n,), from the medians so that outliers do not matter."""
    return np.maximum(1.4826 * _medians(np.where(used, np.abs(residuals), np.inf), known), noise_floor)


def _medians(values: Array, known: NDArray[np.int64]) -> Array:
    """(n,) the median of each row (n, m); what is not known is infinite."""
    ordered, rows = np.sort(values, axis=1), np.arange(len(values))
    return np.asarray(0.5 * (ordered[rows, (known - 1) // 2] + ordered[rows, known // 2]))
