"""SE(3) for many transforms or points at once, with numpy.

Transforms are matrices (n, 4, 4); twists (n, 6) are translation (m) and rotation (rad).
"""

from __future__ import annotations

import contextlib

import numpy as np
from numpy.typing import NDArray

from dsr.math3d import quaternions

Array = NDArray[np.float64]

_SMALL_ANGLE = 1e-4  # rad
_NEARLY_PI = -0.9  # cosine of the angle from which on the sine tells it badly


def skew(vectors: Array) -> Array:
    """(..., 3, 3) matrices with `skew(a) @ b = a x b`, of vectors a (..., 3)."""
    result = np.zeros((*vectors.shape, 3))
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    result[..., 0, 1], result[..., 0, 2], result[..., 1, 2] = -z, y, -x
    result[..., 1, 0], result[..., 2, 0], result[..., 2, 1] = z, -y, x
    return result


def inverses(matrices: Array) -> Array:
    """The inverses of rigid transforms (..., 4, 4)."""
    result = np.zeros_like(matrices)
    turned = np.swapaxes(matrices[..., :3, :3], -1, -2)
    result[..., :3, :3] = turned
    result[..., :3, 3] = -(turned @ matrices[..., :3, 3:])[..., 0]
    result[..., 3, 3] = 1.0
    return result


def adjoints(matrices: Array) -> Array:
    """(..., 6, 6) matrices that move twists from the child's frame to the parent's: T exp(xi) = exp(Ad xi) T."""
    rotations = matrices[..., :3, :3]
    result = np.zeros((*matrices.shape[:-2], 6, 6))
    result[..., :3, :3] = result[..., 3:, 3:] = rotations
    result[..., :3, 3:] = skew(matrices[..., :3, 3]) @ rotations
    return result


def exps(twists: Array) -> Array:
    """The transforms (n, 4, 4) whose logarithms are the twists (n, 6); Barfoot and Furgale 2014."""
    phi = twists[:, 3:]
    squared = (phi**2).sum(axis=1)
    is_small = squared < _SMALL_ANGLE**2
    safe = np.where(is_small, 1.0, squared)
    angle = np.sqrt(safe)
    first = np.where(is_small, 1.0 - squared / 6.0, np.sin(angle) / angle)[:, None, None]
    second = np.where(is_small, 0.5 - squared / 24.0, (1.0 - np.cos(angle)) / safe)[:, None, None]
    third = np.where(is_small, 1.0 / 6.0 - squared / 120.0, (1.0 - first[:, 0, 0]) / safe)[:, None, None]
    turns = skew(phi)
    twice = turns @ turns
    result = np.zeros((len(twists), 4, 4))
    result[:, :3, :3] = np.eye(3) + first * turns + second * twice
    result[:, :3, 3] = ((np.eye(3) + second * turns + third * twice) @ twists[:, :3, None])[..., 0]
    result[:, 3, 3] = 1.0
    return result


def matrix_inverses(matrices: Array) -> Array:
    """The inverses of any square matrices (n, k, k); NaN of those that have none."""
    return solutions(matrices, np.eye(matrices.shape[-1]))


def solutions(matrices: Array, known: Array) -> Array:
    """(n, k, m) the x of `matrices @ x = known`, for square matrices (n, k, k); NaN where there is none.

    Args:
        matrices: (n, k, k)
        known: (n, k, m), or (k, m) for all of them.
    """
    known = np.broadcast_to(known, (len(matrices), *known.shape[-2:]))
    finite = np.isfinite(matrices).all(axis=(1, 2))
    try:
        result = np.asarray(np.linalg.solve(matrices, known))
    except np.linalg.LinAlgError:  # of one of them
        result = np.full(known.shape, np.nan)
        for place in np.flatnonzero(finite).tolist():
            with contextlib.suppress(np.linalg.LinAlgError):
                result[place] = np.linalg.solve(matrices[place], known[place])
    result[~finite] = np.nan
    return result


def logs(matrices: Array) -> Array:
    """Twists (n, 6) of transforms (n, 4, 4), with angles of at most pi; Barfoot and Furgale 2014."""
    phi = rotvecs(matrices[:, :3, :3])
    squared = (phi**2).sum(axis=1)
    safe = np.sqrt(np.maximum(squared, _SMALL_ANGLE**2))
    quotient = np.where(squared < _SMALL_ANGLE**2, 1.0 / 12.0, (1.0 - 0.5 * safe / np.tan(0.5 * safe)) / safe**2)
    result, turns, t = np.empty((len(matrices), 6)), skew(phi), matrices[:, :3, 3:]
    turned = turns @ t
    result[:, :3] = (t - 0.5 * turned + quotient[:, None, None] * (turns @ turned))[..., 0]
    result[:, 3:] = phi
    return result


def rotvecs(rotations: Array) -> Array:
    """(n, 3) rotation vectors (rad) of matrices (n, 3, 3), of at most half a turn.

    They come from the antisymmetric parts, unless these vanish towards half a turn.
    """
    r = rotations
    double = np.stack([r[:, 2, 1] - r[:, 1, 2], r[:, 0, 2] - r[:, 2, 0], r[:, 1, 0] - r[:, 0, 1]], axis=1)
    sine = 0.5 * np.sqrt((double**2).sum(axis=1))
    cosine = 0.5 * (r[:, 0, 0] + r[:, 1, 1] + r[:, 2, 2] - 1.0)
    angle = np.arctan2(sine, cosine)
    result: Array = double * (0.5 * np.where(sine < _SMALL_ANGLE, 1.0, angle / np.maximum(sine, _SMALL_ANGLE)))[:, None]
    for index in np.flatnonzero(cosine < _NEARLY_PI).tolist():
        result[index] = quaternions.to_rotvec(quaternions.from_matrix(rotations[index].tolist()))
    return result


def inverse_left_jacobians(twists: Array) -> Array:
    """(n, 6, 6), d log(exp(xi) T) / d xi for the logarithms `twists` (n, 6) of T, to second order in them."""
    ad = np.zeros((len(twists), 6, 6))
    ad[:, :3, :3] = ad[:, 3:, 3:] = skew(twists[:, 3:])
    ad[:, :3, 3:] = skew(twists[:, :3])
    result: Array = np.eye(6) - 0.5 * ad + ad @ ad / 12.0
    return result


def rigid_fit(source: Array, target: Array, weights: Array | None = None) -> tuple[Array, Array]:
    """Rotation R (3, 3) and shift t (3,) for which `R @ source + t` is nearest to `target`, by least squares.

    W. Kabsch, "A solution for the best rotation to relate two sets of vectors", Acta Cryst. A32, 1976.

    Args:
        source: (n, 3) m.
        target: (n, 3) m, of the same points.
        weights: (n,) of the squared distances; all alike if None. Their sum is not zero.
    """
    shares = np.full(len(source), 1.0) if weights is None else weights
    shares = shares / shares.sum()
    source_mean, target_mean = shares @ source, shares @ target
    u, _, vt = np.linalg.svd((target - target_mean).T @ (shares[:, None] * (source - source_mean)))
    rotation: Array = u @ np.diag((1.0, 1.0, np.linalg.det(u @ vt))) @ vt
    return rotation, target_mean - rotation @ source_mean
