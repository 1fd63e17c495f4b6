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
_QUANTILES = np.linspace(0.1, 0.9, 9)  # of the points, where they are cut
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
    best, least = None, _SMALLER * _volume(_around(points, cluster.base))
    for angle in np.arange(_DIRECTIONS) * math.pi / _DIRECTIONS:
        along = points[:, :2] @ (math.cos(angle), math.sin(angle))
        for place in np.quantile(along, _QUANTILES):
            two = _around(points[along <= place], cluster.base), _around(points[along > place], cluster.base)
            volume = sum(map(_volume, two))
            if volume < least:
                best, least = two, volume
    return best


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
