"""The pose and the extents of a block that was found by depth, with its axes named as those of the true object.

Nothing tells which edge of a box without tag is its x axis, nor how a cylinder is turned about its own axis. Of all
descriptions of the same block, the judge takes the one that is turned least against the truth.
"""

from __future__ import annotations

from itertools import permutations, product

import numpy as np

from agents.scenario.format.model import ObjectSpec
from agents.scenario.format.units import Size
from dsr.math3d import quaternions
from dsr.math3d.transforms import Array, Pose

SAME_EXTENT = 0.005
"""m, up to which two descriptions fit the true extents alike: as near as a belief must be to the truth"""

_SIGNED = (
    np.diag(signs)[list(order)] for order in permutations(range(3)) for signs in product((1.0, -1.0), repeat=3)
)
_BOX = np.array([turn for turn in _SIGNED if np.linalg.det(turn) > 0])  # (24, 3, 3) all ways to name the axes of a box
_UPRIGHT, _UPSIDE_DOWN = (0.0, 0.0, 0.0, 1.0), (1.0, 0.0, 0.0, 0.0)


def alike(spec: ObjectSpec, size: Size, pose: Pose, true: Pose) -> tuple[Pose, Size]:
    """The description of a found block that is nearest to the true object: its pose, and its extents, m.

    Args:
        spec: the true object.
        size: m, extents of the found block along its own axes.
        pose: where it is: a percept or a belief.
        true: where the object truly is.
    """
    turns = _cylinder_turns(pose, true) if spec.shape else _BOX
    sizes = (_BOX[:1] if spec.shape else np.abs(turns)).swapaxes(1, 2) @ np.array(size)
    missed = np.abs(sizes - spec.size).max(axis=1)
    likeness = np.einsum("nij,ij->n", turns, pose.rotation_matrix.T @ true.rotation_matrix)
    possible = missed <= missed.min() + SAME_EXTENT
    best = int(np.where(possible, likeness, -np.inf).argmax())
    x, y, z = sizes[best % len(sizes)].tolist()
    turn = quaternions.from_matrix(turns[best].tolist())
    return Pose(pose.t, quaternions.product(pose.q, turn), pose.stamp), (x, y, z)


def _cylinder_turns(pose: Pose, true: Pose) -> Array:
    """(2, 3, 3) rotations of a cylinder, upright and upside down, each turned about its axis as near as can be."""
    apart = quaternions.product(quaternions.conjugate(pose.q), true.q)
    found = []
    for way in (_UPRIGHT, _UPSIDE_DOWN):
        yaw = quaternions.about_z(quaternions.product(apart, quaternions.conjugate(way)))
        found.append(quaternions.to_matrix(quaternions.product(yaw, way)))
    return np.array(found)
