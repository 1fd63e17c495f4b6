"""How a camera is tilted, as its own image of the supports tells: they are level, whatever is believed of the camera.

A camera that somebody bumped, or that was never calibrated well, shows a level table tilted. Blocks stand upright on
the table that is seen, not on the believed one.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from agents.scene_estimator.blocks.clusters import LEVEL, Support
from agents.scene_estimator.fitting import FrameView
from dsr.math3d.transforms import Array, Pose

ANY_TILT = 0.1
"""rad, standard deviation of the error of a camera's believed tilt, before its image of a support was seen"""

_SPARSE = 6  # px apart, and
_ENOUGH = 100  # count of pixels that tell a tilt
_GATES = (0.05, 0.03, 0.02, 0.01, 0.01)  # m from the surface, beyond which a pixel is something else: less and less


class LevelledView(NamedTuple):
    """One exposure, by a camera whose tilt its image of the supports tells."""

    view: FrameView
    """With the pose of the camera that makes the supports level; where they are, and the yaw, are as believed"""
    tilt_sigma: float
    """rad, standard deviation of its tilt, about any level axis"""


def levelled(view: FrameView, supports: list[Support]) -> LevelledView:
    """Turn a camera about what is in the middle of the supports, until they are level in its image.

    The turn is found by least squares on heights, with Tukey's weights, so that things on the supports do not count. It
    has a prior, `ANY_TILT`. A support is not quite flat (`LEVEL`), which the standard deviation of the turn says.

    Args:
        view: depth and camera.
        supports: those that are level, on which blocks stand.
    """
    places, rises = _heights(view, supports)
    if len(rises) < _ENOUGH:
        return LevelledView(view, ANY_TILT)
    middle = np.median(places, axis=0)
    away = places - middle
    plane = np.array([float(np.median(rises)), 0.0, 0.0])  # m, and its slopes along x and y
    design = np.column_stack([np.ones(len(rises)), away[:, 0], away[:, 1]])
    information = np.zeros((3, 3))
    for gate in _GATES:
        off = (rises - design @ plane) / gate
        weights = np.where(np.abs(off) < 1.0, (1.0 - off**2) ** 2, 0.0)
        if weights.sum() < _ENOUGH:
            return LevelledView(view, ANY_TILT)
        information = (design * weights[:, None]).T @ design / (weights.sum() * LEVEL**2)
        information[[1, 2], [1, 2]] += ANY_TILT**-2
        plane = np.linalg.solve(information, (design * weights[:, None]).T @ rises / (weights.sum() * LEVEL**2))
    sigma = math.sqrt(float(np.linalg.eigvalsh(np.linalg.inv(information)[1:, 1:])[-1]))
    return LevelledView(view._replace(world_from_camera=_turned(view.world_from_camera, plane[1:], middle)), sigma)


def _turned(world_from_camera: Pose, slopes: Array, middle: Array) -> Pose:
    """The pose turned about a point of the world (3,), so that what has slopes (2,) along x and y becomes level."""
    steep = max(float(np.hypot(*slopes)), 1e-12)
    along_x, along_y = (math.atan(steep) / steep * slopes).tolist()
    turn = Pose.from_rotvec((0.0, 0.0, 0.0), (-along_y, along_x, 0.0))
    about = Pose(middle) @ turn @ Pose(-middle)
    return (about @ world_from_camera.with_covariance(None)).with_stamp(world_from_camera.stamp)


def _heights(view: FrameView, supports: list[Support]) -> tuple[Array, Array]:
    """(n, 3) m, points of the world near the believed supports, and (n,) m, how far they seem to be above them."""
    sparse = np.s_[::_SPARSE, ::_SPARSE]
    depth = view.depth[sparse]
    x, y = (np.broadcast_to(slope, view.depth.shape)[sparse] for slope in view.intrinsics.slopes())
    seen = np.isfinite(depth) & (depth > 0.0)
    rays = np.column_stack([x[seen], y[seen], np.ones(int(seen.sum()))])
    points = view.world_from_camera.apply(rays * depth[seen, None].astype(np.float64))
    places, rises = [np.empty((0, 3))], [np.empty(0)]
    for support in supports:
        rise = points[:, 2] - support.pose.t[2]
        near = np.abs(rise) < _GATES[0]
        near[near] = support.covers(points[near])
        places.append(points[near])
        rises.append(rise[near])
    return np.concatenate(places), np.concatenate(rises)
