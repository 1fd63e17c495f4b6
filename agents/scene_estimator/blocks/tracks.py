"""Which block of a frame is which known one: by colour, extents and place, all blocks at once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from agents.colors import TOLERANCE, spectral_angle
from agents.scene_estimator.blocks.block import Block
from agents.scene_estimator.blocks.finder import BlockSighting, KnownBlock
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Array

_MODEL = 0.002
"""m, least standard deviation of an extent when two are compared: errors of edges do not average out"""
_ANOTHER_SIZE = 16.0
"""Sum over three extents of squares over variances, from which it is another block: one in 900 exceeds it (chi^2, 3)"""
_STEP = 0.03
"""m, by which a block may have gone from frame to frame"""
_JUMPED = 9.0
"""Most that the place adds to the cost: blocks are also taken elsewhere"""
_REMEMBERED = 30.0
"""Frames whose extents are averaged"""
_TURN = 0.3
"""rad by which a block may have turned from frame to frame, where extents do not tell which edge is which"""
_NO_MATCH = 1e6


@dataclass
class BlockTrack:
    """A known block with what all frames told of it."""

    name: str
    """Of its node."""
    block: Block
    """Where it was last, and its extents by all frames."""
    sigma: Array
    """(3,) m, standard deviations of its extents"""
    color: Vector3
    """Red, green, blue, 0 to 1"""
    frames: float = 1.0
    """How many frames count."""

    @property
    def known(self) -> KnownBlock:
        """What helps to find it again."""
        x, y, z = self.sigma.tolist()
        return KnownBlock(self.block, (x, y, z))

    def take(self, sighting: BlockSighting) -> Block:
        """Go where it is seen. Extents that are seen are averaged: the surest frame tells how sure they are.

        Frames of one camera share most of their errors, so that more of them make nothing surer.
        """
        block, quarters = self.aligned(sighting)
        sigma = _turned(sighting.size_sigma, quarters)
        before, frames = np.array(self.block.size), min(self.frames, _REMEMBERED)
        size = before
        if sighting.measured and block.kind == self.block.kind:
            gain = 1.0 / (1.0 + frames * np.maximum(sigma, 1e-9) ** 2 / self.sigma**2)
            size = before + gain * (np.array(block.size) - before)
            self.sigma = np.minimum(self.sigma, np.maximum(sigma, 1e-6))
            self.frames = frames + 1.0
        x, y, z = size.tolist()
        self.block = block._replace(kind=self.block.kind, size=(x, y, z))
        return self.block

    def aligned(self, sighting: BlockSighting) -> tuple[Block, int]:
        """The block that is seen with its axes named as before, and by how many quarter turns it is turned for that."""
        if self.block.is_round or sighting.block.is_round:
            return sighting.block, 0

        def cost(quarters: int) -> float:
            turned = sighting.block.turned(quarters)
            off = math.remainder(turned.yaw - self.block.yaw, 2.0 * math.pi)
            return self._unlike(sighting, quarters) + (off / _TURN) ** 2

        best = min(range(-1, 3), key=cost)
        return sighting.block.turned(best), best

    def cost(self, sighting: BlockSighting) -> float:
        """How unlikely it is that a sighting is this block; `_NO_MATCH` if it is another one."""
        angle = self.unlike_color(sighting.color)
        unlike = min(self._unlike(sighting, quarters) for quarters in range(2))
        if angle > 1.0 or unlike > _ANOTHER_SIZE or sighting.block.is_round != self.block.is_round:
            return _NO_MATCH
        gone = math.dist(sighting.block.centre[:2], self.block.centre[:2]) / _STEP
        return angle**2 + unlike + min(gone**2, _JUMPED)

    def unlike_color(self, color: Sequence[float]) -> float:
        """How far a colour is from its own; 1 is as far as its own pixels may be."""
        return spectral_angle(color, self.color) / TOLERANCE

    def _unlike(self, sighting: BlockSighting, quarters: int) -> float:
        apart = np.array(sighting.block.turned(quarters).size) - self.block.size
        variance = _turned(sighting.size_sigma, quarters) ** 2 + self.sigma**2 + _MODEL**2
        return float((apart**2 / variance).sum())


def assigned(tracks: list[BlockTrack], sightings: list[BlockSighting]) -> list[BlockTrack | None]:
    """The block of each sighting, each block once, with the least costs together; None for a new one."""
    found: list[BlockTrack | None] = [None] * len(sightings)
    if tracks and sightings:
        costs = np.array([[track.cost(sighting) for track in tracks] for sighting in sightings])
        for row, column in zip(*linear_sum_assignment(costs), strict=True):
            if costs[row, column] < _NO_MATCH:
                found[row] = tracks[column]
    return found


def _turned(sigma: Array, quarters: int) -> Array:
    return sigma[[1, 0, 2]] if quarters % 2 else sigma
