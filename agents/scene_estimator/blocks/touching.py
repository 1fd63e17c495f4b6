"""A piece of the image that is several known blocks of one colour: the share of each, by where they were before."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from agents.scene_estimator.blocks.block import Block, inside
from agents.scene_estimator.blocks.clusters import NEAR_CUT, SMALLEST, Cluster
from agents.scene_estimator.fitting import FrameView
from dsr.math3d.transforms import Array

_AT = 0.01  # m from the surface of a block, up to which a point may be its own: blocks move little from frame to frame
_SHARE = 0.1  # of the points of a piece, from which a block has a share in it


def has_share(cluster: Cluster, block: Block) -> bool:
    """Whether some of a piece is where the surface of a block was."""
    return bool((_apart(cluster, block) < _AT).mean() > _SHARE)


def parted(view: FrameView, cluster: Cluster, blocks: Sequence[Block]) -> list[Cluster] | None:
    """The part of a piece for each of several blocks, in their order; None if one of them gets too little.

    Each point goes to the block whose surface is nearest. What of the edge two blocks may have tells of neither.

    Args:
        view: depth and camera.
        cluster: a piece of it.
        blocks: where they were, two or more.
    """
    owner = np.argmin([_apart(cluster, block) for block in blocks], axis=0)
    outlines = [block.outline(view) for block in blocks]
    within = np.array([inside(outline, cluster.contour) for outline in outlines])
    first, second = np.sort(within, axis=0)[[-1, -2]]
    nearest, is_clear = within.argmax(axis=0), first - second > NEAR_CUT
    parts = []
    for k, outline in enumerate(outlines):
        own, clear = owner == k, (nearest == k) & is_clear
        edge, sigma = cluster.contour[clear], cluster.contour_sigma[clear]
        if own.sum() < SMALLEST // 4:
            return None
        hidden = max(0.0, 1.0 - len(edge) / max(_steps(outline), 1.0))
        points, rays, depths = cluster.points[own], cluster.rays[own], cluster.depths[own]
        part = cluster._replace(points=points, rays=rays, depths=depths, contour=edge, contour_sigma=sigma)
        parts.append(part._replace(hidden=hidden))
    return parts


def _apart(cluster: Cluster, block: Block) -> Array:
    """(n,) m, how far the points of a piece are from the surface of a block."""
    along = cluster.rays / np.linalg.norm(cluster.rays, axis=1)[:, None]
    return np.abs(block.distances(cluster.points, along).distances)


def _steps(outline: Array) -> float:
    """How many pixels an outline (n, 2) has, from each to a neighbour beside it or across its corner."""
    return float(np.abs(np.roll(outline, -1, axis=0) - outline).max(axis=1).sum())
