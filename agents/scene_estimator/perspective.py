"""The two poses from which a square looks alike in perspective, for many squares at once.

T. Collins and A. Bartoli, "Infinitesimal Plane-Based Pose Estimation", IJCV 2014.
"""

from __future__ import annotations

import numpy as np

from agents.scene_estimator.detection import tag_corners
from agents.scene_estimator.reading import homographies
from dsr.math3d.batches import Array, matrix_inverses

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
        poses[..., :3, 3] = _translations(seen, rotations @ (sizes[:, None, None] * tag_corners(1.0)).mT[:, None])
    poses[~(np.isfinite(poses).all(axis=(2, 3)) & (poses[..., 2, 3] > 0.0))] = np.nan
    return poses


def _about_centres(seen: Array) -> tuple[Array, Array]:
    """(n, 2) where centres of squares of side 1 are seen, and how that goes (n, 2, 2) with x and y of the squares."""
    by_column, by_row, first = np.moveaxis(homographies(seen), 2, 0)
    whole = first + 0.5 * (by_column + by_row)
    centres, depths = whole[:, :2] / whole[:, 2:], whole[:, 2:]
    by_x, by_y = ((way[:, :2] - way[:, 2:] * centres) / depths for way in (by_column, -by_row))
    return centres, np.stack([by_x, by_y], axis=2)


def _rotations(centres: Array, slopes: Array) -> Array:
    """(n, POSES, 3, 3) camera_from_square of squares that are seen at `centres` (n, 2) with `slopes` (n, 2, 2)."""
    rays = np.concatenate([centres, np.ones((len(centres), 1))], axis=1)
    long = np.linalg.norm(rays, axis=1)[:, None]
    facing = np.zeros((len(centres), 3, 3))  # turns the optical axis towards the centre
    facing[:, :2, :2] = np.eye(2) - centres[:, :, None] * (centres / (long * (long + 1.0)))[:, None]
    facing[:, 2, :2], facing[:, :, 2] = -centres / long, rays / long
    by_turned = facing[:, :2, :2] - centres[:, :, None] * facing[:, 2:, :2]
    flat = matrix_inverses(by_turned) @ slopes
    half = 0.5 * (flat**2).sum(axis=(1, 2))
    longest = half + np.sqrt(np.maximum(half**2 - np.linalg.det(flat) ** 2, 0.0))  # square of its larger singular value
    flat = flat / np.sqrt(longest)[:, None, None]
    off = np.sqrt(np.maximum(1.0 - (flat**2).sum(axis=1), 0.0))
    off[:, 1] *= np.where((flat[:, :, 0] * flat[:, :, 1]).sum(axis=1) > 0.0, -1.0, 1.0)
    turned = np.empty((len(centres), POSES, 3, 3))
    turned[:, :, :2, :2], turned[:, 0, 2, :2], turned[:, 1, 2, :2] = flat[:, None], off, -off
    turned[..., 2] = np.cross(turned[..., 0], turned[..., 1])
    return np.asarray(facing[:, None] @ turned)


def _translations(seen: Array, turned: Array) -> Array:
    """(n, POSES, 3) m, from which corners `turned` (n, POSES, 3, 4) look most like those `seen` (n, 4, 2)."""
    x, y = np.moveaxis(seen, 2, 0)
    normal = np.zeros((len(seen), 3, 3))
    normal[:, 0, 0] = normal[:, 1, 1] = seen.shape[1]
    normal[:, :2, 2] = normal[:, 2, :2] = -seen.sum(axis=1)
    normal[:, 2, 2] = (seen**2).sum(axis=(1, 2))
    across, down, ahead = np.moveaxis(turned, 2, 0)
    off_x, off_y = x[:, None] * ahead - across, y[:, None] * ahead - down
    known = [off_x.sum(axis=2), off_y.sum(axis=2), -(x[:, None] * off_x + y[:, None] * off_y).sum(axis=2)]
    return np.asarray((matrix_inverses(normal)[:, None] @ np.stack(known, axis=2)[..., None])[..., 0])
