"""The upright boxes and cylinders of one exposure: the most likely block for each piece that stands on a support.

The search begins at the smallest rectangle around the points from above. A piece may also be two blocks that touch.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.scene_estimator.blocks.block import Block
from agents.scene_estimator.blocks.clusters import LEVEL, Cluster, Relief, Support
from agents.scene_estimator.blocks.problem import EXTENTS, SUNK, TAILS, BlockPrior, BlockProblem, Solved, uprightness
from agents.scene_estimator.blocks.splitting import cut, upright_box
from agents.scene_estimator.blocks.touching import parted
from agents.scene_estimator.colored import LEANING
from agents.scene_estimator.fitting import FrameView
from agents.scene_estimator.pose import NoiseModel
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Array

MOSTLY_SEEN = 0.15
"""Share of a block's edge in the image up to which something may hide it, for its extents to be seen."""

_RAISED = 0.12  # m, standard deviation of where a block stands that is not on the support: anywhere up to `HIGHEST`
_LEAST_EDGE = 12  # outermost pixels that nothing hides, by which a block is known


class BlockSighting(NamedTuple):
    """One block in one exposure."""

    block: Block
    covariance: Array
    """(7, 7) of x, y, z of its centre (m), yaw (rad), and size x, y, z (m); a cylinder's x and y are its diameter"""
    color: Vector3
    """Red, green, blue, 0 to 1, as bright as it is seen"""
    leaning: float
    """rad, standard deviation of how far it leans from the upright, about any level axis"""
    hidden: float
    """Share of its edge in the image that something hides"""
    measured: bool
    """Its extents are what this exposure shows; else they are those that were known before"""
    strained: bool
    """It fits only if all depths, or the height of the support, are far off"""
    cost: float
    """Twice the negative logarithm of how likely the piece is by such a block, wherever that is and however large"""

    @property
    def size_sigma(self) -> Array:
        """(3,) m, standard deviations of its extents"""
        return np.asarray(np.sqrt(np.diag(self.covariance)[4:]))


class KnownBlock(NamedTuple):
    """A block of earlier frames."""

    block: Block
    sigma: Vector3
    """m, standard deviations of its extents"""


class BlockFinder:
    """Finds blocks in the frames of a camera.

    Args:
        noise: error model of the camera.
    """

    def __init__(self, noise: NoiseModel) -> None:
        self._noise = noise

    def clusters(self, view: FrameView, color: NDArray[np.uint8], supports: list[Support]) -> list[Cluster]:
        """What stands on supports.

        Args:
            view: depth and camera.
            color: (h, w, 3) RGB image of the same exposure, 0 to 255.
            supports: on which blocks stand.
        """
        reliefs = (
            Relief(view, color, support, self._noise.inverse_depth_std, self._noise.depth_bias_std)
            for support in supports
        )
        return [cluster for relief in reliefs for cluster in relief.clusters()]

    def fit(self, view: FrameView, cluster: Cluster, known: KnownBlock | None = None) -> BlockSighting | None:
        """The most likely block of a piece on its support; None if it is none, or if too little of it is seen.

        Args:
            view: depth and camera.
            cluster: a piece of it.
            known: what it was before. Its extents count if something hides part of it now.
        """
        if len(cluster.contour) < _LEAST_EDGE:
            return None
        seen, on = upright_box(cluster), (cluster.base, LEVEL)
        if known is None:
            kinds = [seen._replace(kind=kind) for kind in EXTENTS]
            fits = [self._solved(view, cluster, [BlockPrior(one)], [[one]], on) for one in kinds]
            return _best(cluster, fits, measured=True)
        unchanged = cluster.hidden > MOSTLY_SEEN
        guess = _guess(known, seen) if unchanged else BlockPrior(seen._replace(kind=known.block.kind))
        fit = self._solved(view, cluster, [guess], [[seen], [known.block]], on, TAILS[-1:])
        return _best(cluster, [fit], measured=not unchanged)

    def fit_unchanged(self, view: FrameView, cluster: Cluster, known: KnownBlock) -> BlockSighting | None:
        """A known block with the extents that it had, on its support, on something else or held; None if it is none.

        Args:
            view: depth and camera.
            cluster: a piece of it.
            known: what it was before. Its extents tell how high it is.
        """
        if len(cluster.contour) < _LEAST_EDGE:
            return None
        seen = upright_box(cluster)
        starts = [[seen._replace(size=known.block.size)], [known.block]]
        raised = cluster.base + seen.size[2] - known.block.size[2]
        footings = ((cluster.base, LEVEL), (raised, _RAISED))
        guess = [_guess(known, seen)]
        fits = [self._solved(view, cluster, guess, starts, base, TAILS[-1:]) for base in footings]
        return _best(cluster, fits, measured=False)

    def fit_two(self, view: FrameView, cluster: Cluster) -> tuple[BlockSighting, BlockSighting] | None:
        """The most likely two blocks that touch and are one piece; None if nothing speaks for two.

        The first guess is the cut of the piece by which the smallest boxes around its points have least volume. Then
        each is also taken for a cylinder, a cube and a box again, as far as there is more evidence for that.

        Args:
            view: depth and camera.
            cluster: a piece of it.
        """
        halves = cut(cluster) if len(cluster.contour) >= _LEAST_EDGE else None
        if halves is None:
            return None
        fit = self._solved_two(view, cluster, halves, halves)
        for k in range(2):
            for kind in reversed(EXTENTS):  # a box last: a cube or a cylinder may have shown where it is
                start = list(halves if fit is None else fit.blocks)
                same = start[k].kind == kind
                start[k] = start[k]._replace(kind=kind)
                other = None if same else self._solved_two(view, cluster, halves, start)
                fit = min((one for one in (fit, other) if one is not None), key=lambda one: one.cost, default=None)
        shares = None if fit is None else parted(view, cluster, fit.blocks)
        if fit is None or shares is None or fit.strained:
            return None
        first, second = (_sighting(fit, k, part, measured=True) for k, part in enumerate(shares))
        return first, second

    def _solved_two(
        self, view: FrameView, cluster: Cluster, halves: Sequence[Block], start: Sequence[Block]
    ) -> Solved | None:
        guesses = [BlockPrior(half._replace(kind=one.kind)) for half, one in zip(halves, start, strict=True)]
        return self._solved(view, cluster, guesses, [start], (cluster.base, LEVEL))

    def most_likely(self, view: FrameView, cluster: Cluster, known: Sequence[KnownBlock] = ()) -> list[BlockSighting]:
        """What has most evidence: a new block, two of them, or a known one anywhere; empty if it is none of these.

        Args:
            view: depth and camera.
            cluster: a piece of it.
            known: blocks of its colour.
        """
        fits = [self.fit(view, cluster), *(self.fit_unchanged(view, cluster, one) for one in known)]
        possible = [[sighting] for sighting in fits if sighting is not None]
        two = self.fit_two(view, cluster)
        return min([*possible, *([] if two is None else [[*two]])], key=lambda several: several[0].cost, default=[])

    def _solved(
        self, view: FrameView, cluster: Cluster, guesses: Sequence[BlockPrior], starts: Sequence[Sequence[Block]],
        base: tuple[float, float], tails: Sequence[float] = TAILS,
    ) -> Solved | None:  # fmt: skip
        return BlockProblem(view, cluster, self._noise, guesses, starts, base=base, tails=tails).solve()


def _best(cluster: Cluster, fits: Iterable[Solved | None], *, measured: bool) -> BlockSighting | None:
    """The most likely one."""
    best = min((fit for fit in fits if fit is not None), key=lambda fit: fit.cost, default=None)
    return None if best is None else _sighting(best, 0, cluster, measured=measured)


def _guess(known: KnownBlock, seen: Block) -> BlockPrior:
    """A known block near where something is seen."""
    return BlockPrior(known.block._replace(x=seen.x, y=seen.y), known.sigma)


def _sighting(fit: Solved, index: int, cluster: Cluster, *, measured: bool) -> BlockSighting:
    """One block of a solution, with the covariance of its centre instead of its base."""
    block, own = fit.blocks[index], fit.covariances[index]
    red, green, blue = cluster.color.tolist()
    extents, first = EXTENTS[block.kind], 2 if block.is_round else 3
    outward = np.zeros((7, len(own)))
    outward[[0, 1], [0, 1]] = outward[2, -1] = 1.0
    outward[4:, first:-1] = extents
    outward[2, first:-1] = 0.5 * extents[2]
    if not block.is_round:
        outward[3, 2] = 1.0
    covariance = outward @ own @ outward.T
    if block.is_round:
        covariance[3, 3] = math.pi**2
    return BlockSighting(
        block, covariance, (red, green, blue), _leaning(block, cluster.base), cluster.hidden,
        measured, fit.strained, fit.cost,
    )  # fmt: skip


def _leaning(block: Block, level: float) -> float:
    """Rad: what stands on a support at a height (m) leans as far as both are uneven, whatever else as it may."""
    return uprightness(block) if abs(block.base - level) < SUNK * LEVEL else LEANING
