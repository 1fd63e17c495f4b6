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
_ENOUGH_PIXELS = _MIN_PIXELS / _MIN_VALID
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
    outlines = _inset(corners)
    u, v, within, stride = _pixels_within(outlines, depth.shape, correlation)
    z = depth.ravel().take(v * depth.shape[1] + u).astype(np.float64)
    used = np.isfinite(z) & (z > 0.0) & (np.arange(u.shape[1]) < within[:, None])
    known = used.sum(axis=1)
    some = np.flatnonzero((within >= _MIN_PIXELS) & (known >= np.maximum(_MIN_PIXELS, _MIN_VALID * within)))
    if not len(some):
        return planes
    u, v, z, used = u[some], v[some], z[some], used[some]
    x, y = (slopes.reshape(u.shape) for slopes in intrinsics.slopes_at(u.ravel(), v.ravel()))
    pixels = _Pixels.of(x, y, 1.0 / np.where(used, z, 1.0), used)
    p, covariance, scale = _robust_fit(pixels, noise_floor)
    rays = intrinsics.rays(outlines[some])
    cosines = (rays @ p[:, :, None])[..., 0] / (np.linalg.norm(rays, axis=2) * np.linalg.norm(p, axis=1)[:, None])
    good = (cosines.min(axis=1) > _MIN_COSINE) & (scale < _NO_PLANE * pixels.median)
    alike = np.maximum(1.0, correlation / stride[some]) ** 2
    planes.p[some[good]] = p[good]
    planes.covariance[some[good]] = (alike[:, None, None] * covariance)[good]
    return planes


class _Pixels(NamedTuple):
    """Pixels of n tags with up to m each, as equations a + b x + c y = d of the plane of their tag.

    The equations are about the middle of each tag and its median inverse depth, which keeps them well conditioned.
    """

    equations: Array
    """(n, 3, m) 1, x, y: slopes of the rays, from `middle`; 0 where there is no depth"""
    inverse_depth: Array
    """(n, m) 1/m, d: beyond `median`"""
    products: Array
    """(n, 9, m) products of equations with each other (1, x, y, xx, xy, yy), and with d; 0 where there is no depth"""
    unknown: NDArray[np.float32]
    """(n, m) infinite where there is no depth, 0 elsewhere"""
    known: NDArray[np.int64]
    """(n,) how many have depth"""
    middle: Array
    """(n, 2) slopes"""
    median: Array
    """(n,) 1/m, of the inverse depths"""

    @staticmethod
    def of(x: Array, y: Array, inverse_depth: Array, used: NDArray[np.bool_]) -> _Pixels:
        """Those with rays (x, y, 1), all (n, m), as far as they are `used`."""
        known, unknown = used.sum(axis=1), np.where(used, np.float32(0.0), np.float32(np.inf))
        middle = np.stack([(axis * used).sum(axis=1) / known for axis in (x, y)], axis=1)
        median = _medians(inverse_depth, unknown, known)
        weight = used.astype(np.float64)
        d = (inverse_depth - median[:, None]) * weight
        products = np.empty((len(x), 9, x.shape[1]))
        equations = products[:, :3]
        equations[:, 0] = weight
        equations[:, 1], equations[:, 2] = (x - middle[:, :1]) * weight, (y - middle[:, 1:]) * weight
        products[:, 3:5] = equations[:, 1:2] * equations[:, 1:]
        products[:, 5] = equations[:, 2] ** 2
        products[:, 6:] = equations * d[:, None]
        return _Pixels(equations, d, products, unknown, known, middle, median)

    def solved(self, weights: Array) -> tuple[Array, Array]:
        """a, b and c (n, 3) by weighted least squares, and the inverses of their normal matrices (n, 3, 3)."""
        one, x, y, xx, xy, yy, *with_d = (self.products @ weights[..., None])[..., 0].T
        normal = np.stack([np.stack(row, axis=1) for row in ((one, x, y), (x, xx, xy), (y, xy, yy))], axis=1)
        inverse = matrix_inverses(normal)
        return (inverse @ np.stack(with_d, axis=1)[..., None])[..., 0], inverse

    def residuals(self, solution: Array) -> Array:
        """(n, m) 1/m, of the inverse depths; 0 where there is no depth."""
        return np.asarray(self.inverse_depth - (solution[:, None] @ self.equations)[:, 0])

    def scales(self, residuals: Array, noise_floor: float) -> Array:
        """(n,) standard deviations of residuals (n, m), from the medians so that outliers do not matter."""
        return np.maximum(1.4826 * _medians(np.abs(residuals), self.unknown, self.known), noise_floor)

    def planes(self, solution: Array, covariance: Array) -> tuple[Array, Array]:
        """The p (n, 3) of planes p . ray = 1/z with a, b and c (n, 3), and their covariances (n, 3, 3)."""
        by_solution = np.zeros((len(solution), 3, 3))
        by_solution[:, 0, 1] = by_solution[:, 1, 2] = by_solution[:, 2, 0] = 1.0
        by_solution[:, 2, 1:] = -self.middle
        p = (by_solution @ solution[:, :, None])[..., 0]
        p[:, 2] += self.median
        return p, by_solution @ covariance @ by_solution.mT


def _medians(values: Array, unknown: NDArray[np.float32], known: NDArray[np.int64]) -> Array:
    """(n,) the medians of the `known` (n,) values (n, m), as exactly as depth images are stored."""
    ordered, rows = np.sort(values.astype(np.float32) + unknown, axis=1), np.arange(len(values))
    middles = ordered[rows, (known - 1) // 2].astype(np.float64) + ordered[rows, known // 2]
    return np.asarray(0.5 * middles)


def _inset(corners: Array) -> Array:
    """(n, 4, 2) px, outlines of tags within which no pixel straddles an edge."""
    centre = corners.mean(axis=1, keepdims=True)
    return np.asarray(centre + _INSET * (corners - centre))


def _pixels_within(
    outlines: Array, shape: tuple[int, ...], correlation: float
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """The u and v (n, m) of pixels inside outlines (n, 4, 2), how many each has (n,), and the stride of each (n,).

    What an outline has less than others is (0, 0). Two pixels within a `correlation` (px) tell what all of them do.
    """
    last = np.array([shape[1] - 1, shape[0] - 1])
    low = np.clip(np.ceil(outlines.min(axis=1)), 0, last + 1).astype(np.int64)
    high = np.clip(np.floor(outlines.max(axis=1)), -1, last).astype(np.int64)
    rows, row = high[:, 1:] - low[:, 1:] + 1, np.arange((high - low + 1)[:, 1].max(initial=0))
    v = low[:, 1:] + row
    left, right = _spans(outlines, v.astype(np.float64))
    first = np.ceil(np.clip(left, low[:, :1], high[:, :1] + 1)).astype(np.int64)
    last_of_row = np.floor(np.clip(right, low[:, :1] - 1, high[:, :1])).astype(np.int64)
    area = np.where(row < rows, np.maximum(last_of_row - first + 1, 0), 0).sum(axis=1)
    alike = np.minimum(0.5 * correlation, np.sqrt(area / _ENOUGH_PIXELS)).astype(np.int64)
    stride = np.maximum(1, np.maximum(alike, np.ceil(np.sqrt(area / _MAX_PIXELS)).astype(np.int64)))
    apart = stride[:, None]
    first = low[:, :1] - (low[:, :1] - first) // apart * apart
    is_read = (row < rows) & (row % apart == 0)
    counts = np.where(is_read, np.maximum((last_of_row - first) // apart + 1, 0), 0)
    return *_rows_of_pixels(first, v, counts, stride), counts.sum(axis=1), stride


def _rows_of_pixels(
    u: NDArray[np.int64], v: NDArray[np.int64], counts: NDArray[np.int64], stride: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The u and v (n, m) of pixels in rows (n, rows): `counts` of them from u and v on, each a stride (n,) apart."""
    ends = counts.cumsum(axis=1)
    within = ends[:, -1] if ends.shape[1] else np.zeros(len(ends), np.int64)
    number = np.arange(within.max(initial=0))
    found = np.zeros((2, len(counts), len(number)), np.int64)
    is_there = number < within[:, None]
    of_row = np.repeat(u - stride[:, None] * (ends - counts), counts.ravel())
    found[0][is_there] = of_row
    found[0] += np.where(is_there, stride[:, None] * number, 0)
    found[1][is_there] = np.repeat(v, counts.ravel())
    return found[0], found[1]


def _spans(outlines: Array, v: Array) -> tuple[Array, Array]:
    """Left and right ends (n, rows) px of convex outlines (n, 4, 2) in rows v (n, rows).

    The right end is left of the left one where an outline has nothing in a row.
    """
    along = np.roll(outlines, -1, axis=1) - outlines
    before = np.roll(along, 1, axis=1)
    turned = np.sign((before[..., 0] * along[..., 1] - before[..., 1] * along[..., 0]).sum(axis=1))[:, None, None]
    down, across = turned * along[..., 1:], turned * along[..., :1]
    inwards = across * (v[:, None] - outlines[..., 1:])
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = outlines[..., :1] + inwards / down
    left = np.where(down < 0.0, ends, -np.inf).max(axis=1)
    right = np.where(down > 0.0, ends, np.inf).min(axis=1)
    beyond = ((down == 0.0) & (inwards < 0.0)).any(axis=1) | (turned[:, 0] == 0.0)
    return left, np.where(beyond, -np.inf, right)


def _robust_fit(pixels: _Pixels, noise_floor: float) -> tuple[Array, Array, Array]:
    """Planes p (n, 3) with covariances (n, 3, 3) for errors that are not alike, and the scales (n,) of these, 1/m.

    Each starts at the plane across the view at the median depth, which wrong depths at an edge cannot tilt.
    `noise_floor` is the least scale.
    """
    residuals = pixels.inverse_depth
    for _ in range(_ITERATIONS):
        spread = _CAUCHY * pixels.scales(residuals, noise_floor)
        solution, inverse = pixels.solved(1.0 / (1.0 + (residuals / spread[:, None]) ** 2))
        residuals = pixels.residuals(solution)
    scale = pixels.scales(residuals, noise_floor)
    return *pixels.planes(solution, (scale**2)[:, None, None] * inverse), scale
