"""First guesses from above: the smallest box around the points of a piece, and the best cut into two of them."""

from __future__ import annotations

import math

import cv2
import numpy as np

from agents.scene_estimator.blocks.block import Block
from agents.scene_estimator.blocks.clusters import SMALLEST, TOP, Cluster
from agents.scene_estimator.blocks.problem import SHORTEST
from dsr.math3d.transforms import Array

_DIRECTIONS = 12  # of cuts, over half a turn
_STEP = 0.1  # of the points, from one cut to the next, at first
_POINTS = 400  # that are used for it
_SMALLER = 0.9  # of the volume of one box, that two have at most: else their points look like those of one


def upright_box(cluster: Cluster) -> Block:
    """The smallest upright box around the points from above: where the search begins."""
    return _around(cluster.points, cluster.base)


def cut(cluster: Cluster) -> tuple[Block, Block] | None:
    """The two upright boxes of least volume around the points on both sides of a vertical plane.

    None if two are hardly smaller than one: nothing tells then that the piece is more than one block.
    """
    points = cluster.points[:: max(1, len(cluster.points) // _POINTS)]
    if len(cluster.points) < SMALLEST:
        return None

    def halves(angle: float, share: float) -> tuple[Block, Block]:
        ordered = points[np.argsort(points[:, :2] @ (math.cos(angle), math.sin(angle)), kind="stable")]
        count = min(max(round(share * len(points)), 1), len(points) - 1)
        return _around(ordered[:count], cluster.base), _around(ordered[count:], cluster.base)

    def volume(at: tuple[float, float]) -> float:
        return sum(map(_volume, halves(*at)))

    turn, step = math.pi / _DIRECTIONS, _STEP
    shares = np.arange(step, 1.0 - 0.5 * step, step)
    best = min(((k * turn, float(share)) for k in range(_DIRECTIONS) for share in shares), key=volume)
    while step * len(points) > 1.0:  # to the point: a cut beside the right one gives each block a part of the other
        turn, step = 0.5 * turn, 0.5 * step
        around = [(best[0] + k * turn, best[1] + m * step) for k in (-1, 0, 1) for m in (-1, 0, 1)]
        best = min(around, key=volume)
    return halves(*best) if volume(best) < _SMALLER * _volume(_around(points, cluster.base)) else None


def _around(points: Array, base: float) -> Block:
    """The smallest upright box around points (n, 3) from a height (m) up."""
    (x, y), (length, width), degrees = cv2.minAreaRect(points[:, :2].astype(np.float32))
    height = float(np.quantile(points[:, 2], TOP)) - base
    size = (max(length, SHORTEST), max(width, SHORTEST), max(height, SHORTEST))
    block = Block("box", float(x), float(y), math.radians(degrees), size, base)
    return block.turned(round(-block.yaw / (0.5 * math.pi)))


def _volume(block: Block) -> float:
    """m^3"""
    return math.prod(block.size)
