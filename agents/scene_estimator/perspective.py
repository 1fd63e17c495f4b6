"""The two poses from which a square looks alike in perspective, for many squares at once.

T. Collins and A. Bartoli, "Infinitesimal Plane-Based Pose Estimation", IJCV 2014.
"""

from __future__ import annotations

import numpy as np

from agents.scene_estimator.detection import tag_corners
from agents.scene_estimator.reading import homographies
from dsr.math3d.batches import Array

POSES = 2
"""From which a square looks alike"""


def square_poses(rays: Array, sizes: Array) -> Array:
    """(n, POSES, 4, 4) camera_from_square; NaN where the square would not be before the camera.

    Args:
        rays: (n, 4, 3) with z = 1, through the corners in the order of `tag_corners`.
        sizes: (n,) m, of the sides.
    """
    seen = rays[..., :2]
    poses = np.tile(np.eye(4), (len(rays), POSES, 1, 1))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        poses[..., :3, :3] = rotations = _rotations(*_about_centres(seen))
        poses[..., :3, 3] = _translations(seen, (sizes[:, None, None] * tag_corners(1.0))[:, None] @ rotations.mT)
    poses[~(np.isfinite(poses).all(axis=(2, 3)) & (poses[..., 2, 3] > 0.0))] = np.nan
    return poses


def _about_centres(seen: Array) -> tuple[Array, Array]:
    """(n, 2) where centres of squares of side 1 are seen, and how that goes (n, 2, 2) with x and y of the squares."""
    ways = homographies(seen)
    by_x, by_y = ways[:, :, 0], -ways[:, :, 1]
    whole = ways[:, :, 2] + 0.5 * (by_x - by_y)
    centres, depths = whole[:, :2] / whole[:, 2:], whole[:, 2:]
    slopes = [(way[:, :2] - way[:, 2:] * centres) / depths for way in (by_x, by_y)]
    return centres, np.stack(slopes, axis=2)


def _rotations(centres: Array, slopes: Array) -> Array:
    """(n, POSES, 3, 3) camera_from_square of squares that are seen at `centres` (n, 2) with `slopes` (n, 2, 2)."""
    lengths = np.sqrt(1.0 + (centres**2).sum(axis=1))[:, None]
    facing = np.zeros((len(centres), 3, 3))  # turns the optical axis towards the centre
    facing[:, :2, :2] = np.eye(2) - centres[:, :, None] * (centres / (lengths * (lengths + 1.0)))[:, None]
    facing[:, :2, 2], facing[:, 2, :2], facing[:, 2, 2:] = centres / lengths, -centres / lengths, 1.0 / lengths
    flat = facing[:, :2, :2] @ slopes
    half, area = 0.5 * (flat**2).sum(axis=(1, 2)), flat[:, 0, 0] * flat[:, 1, 1] - flat[:, 0, 1] * flat[:, 1, 0]
    longest = half + np.sqrt(np.maximum(half**2 - area**2, 0.0))  # square of the larger singular value
    flat = flat / np.sqrt(longest)[:, None, None]
    off = np.sqrt(np.maximum(1.0 - (flat**2).sum(axis=1), 0.0))
    off[:, 1] *= np.where((flat[:, :, 0] * flat[:, :, 1]).sum(axis=1) > 0.0, -1.0, 1.0)
    (a, b), (c, d) = flat.transpose(1, 2, 0)
    across = np.stack([c * off[:, 1] - d * off[:, 0], b * off[:, 0] - a * off[:, 1]], axis=1)
    turned = np.empty((len(centres), POSES, 3, 3))
    turned[:, :, :2, :2], turned[:, :, 2, 2] = flat[:, None], (area / longest)[:, None]
    turned[:, 0, 2, :2], turned[:, 0, :2, 2] = off, across
    turned[:, 1, 2, :2], turned[:, 1, :2, 2] = -off, -across
    return np.asarray(facing[:, None] @ turned)


def _translations(seen: Array, turned: Array) -> Array:
    """(n, POSES, 3) m, from which corners `turned` (n, POSES, 4, 3) look most like those `seen` (n, 4, 2)."""
    count, seen = seen.shape[1], seen[:, None]
    off, sums = seen * turned[..., 2:] - turned[..., :2], seen.sum(axis=2)
    known, spread = off.sum(axis=2), (seen**2).sum(axis=(2, 3)) - (sums**2).sum(axis=2) / count
    ahead = ((sums * known).sum(axis=2) / count - (seen * off).sum(axis=(2, 3))) / spread
    return np.concatenate([(known + sums * ahead[..., None]) / count, ahead[..., None]], axis=2)
