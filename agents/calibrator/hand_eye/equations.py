"""The linear algebra of the fit: points of a view in two strata, and normal equations in which slips are eliminated."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dsr.math3d.transforms import Array

_RANK = 1e-6
"""Size of a pattern over the largest one, from which on the points of a view show it"""
_LEAST, _WEAKEST = 1e-30, 1e-12
"""Least information, and least eigenvalue of information that was scaled to a unit diagonal"""


class Strata(NamedTuple):
    """What the points of a view have in common, and the rest, which have different standard deviations."""

    root: Array
    """(v, n, 1) roots of the points' weights"""
    axes: Array
    """(v, n, p) orthonormal patterns, or 0"""
    pixel: float
    """px, of each coordinate of the rest"""
    smooth: Array
    """(v,) px, of the coefficient of each pattern"""

    @staticmethod
    def of(weights: Array, patterns: Array, pixel: float, smooth: float) -> Strata:
        """Of points with weights (v, n) that may share patterns (n, p) of `smooth` px, beside `pixel` px each."""
        root = np.sqrt(weights)[..., None]
        axes, sizes, _ = np.linalg.svd(root * patterns, full_matrices=False)
        shown = sizes > _RANK * np.maximum(sizes.max(axis=1, keepdims=True), _RANK)
        return Strata(root, axes * shown[:, None, :], pixel, np.sqrt(pixel**2 + smooth**2 * weights.sum(axis=1)))

    @property
    def counts(self) -> Array:
        """(2, v) how many numbers each view has in either stratum."""
        shared = 2.0 * (np.abs(self.axes).sum(axis=1) > 0.0).sum(axis=1)
        return np.stack([shared, 2.0 * (self.root[..., 0] > 0.0).sum(axis=1) - shared])

    def parts(self, values: Array) -> tuple[Array, Array]:
        """Of (v, n, 2, k) px: what is shared (v, 2p, k) and the rest (v, 2n, k), in standard deviations."""
        views, points, _, count = values.shape
        flat = (self.root[..., None] * values).reshape(views, points, -1)
        shared = np.swapaxes(self.axes, 1, 2) @ flat
        rest = flat - self.axes @ shared
        shared = shared / self.smooth[:, None, None]
        return shared.reshape(views, -1, count), (rest / self.pixel).reshape(views, -1, count)

    def white(self, values: Array) -> Array:
        """(v, 2p + 2n, k): both parts of (v, n, 2, k)."""
        return np.concatenate(self.parts(values), axis=1)


def smooth_patterns(points: Array) -> Array:
    """(n, 6) the polynomials of second order on points (n, 3) of a target, along its two longest axes."""
    middle = points - points.mean(axis=0)
    flat = middle @ np.linalg.svd(middle, full_matrices=False)[2][:2].T
    x, y = (flat / np.abs(flat).max()).T
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)


class Normal(NamedTuple):
    """The normal equations at some parameters: information and gradient, of common ones, slips and between them."""

    common: Array
    """(c, c)"""
    between: Array
    """(v, c, 6)"""
    slips: Array
    """(v, 6, 6)"""
    common_gradient: Array
    """(c,)"""
    slip_gradient: Array
    """(v, 6)"""

    def reduced(self) -> tuple[Array, Array]:
        """Information (c, c) about the common parameters alone, and (v, c, 6) by how much each slip follows them."""
        follows = self.between @ np.linalg.inv(self.slips)
        whole = self.common - np.einsum("vik,vjk->ij", follows, self.between)
        return 0.5 * (whole + whole.T), follows

    def step(self, damping: float) -> tuple[Array, Array]:
        """Levenberg and Marquardt's step, common (c,) and of the slips (v, 6)."""
        common = self.common + damping * np.diag(np.diag(self.common) + _WEAKEST)
        slips = self.slips * (1.0 + damping * np.eye(6))
        whole, follows = self._replace(common=common, slips=slips).reduced()
        gradient = self.common_gradient - np.einsum("vik,vk->i", follows, self.slip_gradient)
        step = inverse(whole) @ gradient
        left = self.slip_gradient - np.einsum("vik,i->vk", self.between, step)
        return step, np.linalg.solve(slips, left[..., None])[..., 0]


def inverse(matrix: Array) -> Array:
    """Of a symmetric matrix whose numbers have different units; what is not determined at all gets a large variance."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), _LEAST))
    values, axes = np.linalg.eigh(scale[:, None] * matrix * scale)
    inner = (axes / np.maximum(values, _WEAKEST)) @ axes.T
    return np.asarray(scale[:, None] * inner * scale)
