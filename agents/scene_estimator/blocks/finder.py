"""The upright boxes and cylinders of one exposure: the most likely block for each piece that stands on a support.

Three things tell a block: where the piece ends in the image, the depths of its pixels, and how wrong a depth may be
for all of them alike. Gauss-Newton steps start at the smallest rectangle around the points from above; the covariance
is the inverse of the Fisher information. Where something hides an edge, nothing tells the place of the face behind
it but a wide prior, so that its extent is as unsure.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Literal, NamedTuple, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from agents.scene_estimator.blocks.block import GRAZING, Block, BlockKind, inside
from agents.scene_estimator.blocks.clusters import LEVEL, TOP, Cluster, Relief, Support
from agents.scene_estimator.colored import LEANING
from agents.scene_estimator.fitting import FrameView
from agents.scene_estimator.pose import NoiseModel
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Array

Footing = Literal["support", "anywhere"]
"""On what a block is taken to stand: on what all stand, or on something else, or in somebody's hold"""

LONGEST, SHORTEST = 0.5, 0.01
"""m, edges of a block that is looked for"""

MOSTLY_SEEN = 0.15
"""Share of a block's edge in the image up to which something may hide it, for its extents to be seen."""

_POINTS, _EDGE_POINTS = 200, 80  # that are used of a piece
_EDGE = 0.5  # px, by which a piece ends outside the middle of its outermost pixels
_SURFACE = 0.001  # m, standard deviation of a surface: real ones are not flat, edges are round
_UNSEEN = 0.05  # m, standard deviation of an extent before anything was seen of it
_ANYWHERE = 1.0  # m, likewise, of the place
_LEAST_BIAS = 1e-5  # m, standard deviation of the error of all depths where there is none
_ANY_YAW = 0.8  # rad, likewise, of the yaw: half a quarter turn
_TAILS = (30.0, 3.0)  # standard deviations, beyond which what fits not counts less and less: at first, and then
_STEPS = 8  # with each of these
_SETTLED = 0.05  # standard deviations, of the last step
_OFF = 1e-4  # m, rad, for difference quotients
_DAMPING = 1e-3  # of the information: what keeps steps short
_NO_BLOCK = 2.0  # standard deviations, median of what is missed, from which it is no block
_RAISED = 0.12  # m, standard deviation of where a block stands that is not on the support: anywhere up to `HIGHEST`
_STRAINED = 3.0  # standard deviations, by which all depths, or the support's height, may be off, before that is doubted
_SUNK = 3.0  # standard deviations of the support's height, by which a block may seem to be in it
_LEAST_EDGE = 12  # outermost pixels that nothing hides, by which a block is known
_OTHERS = 3  # parameters that nobody asks for
_EXTENTS: dict[BlockKind, Array] = {
    "box": np.eye(3), "cube": np.ones((3, 1)), "cylinder": np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]]),
}  # fmt: skip
"""(3, n) extents along x, y, z by those that are free"""


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
        kinds = tuple(_EXTENTS) if known is None else (known.block.kind,)
        return self._best(cluster, (_Problem(view, cluster, kind, self._noise, known) for kind in kinds))

    def fit_unchanged(self, view: FrameView, cluster: Cluster, known: KnownBlock) -> BlockSighting | None:
        """A known block with the extents that it had, on its support, on something else or held; None if it is none.

        Args:
            view: depth and camera.
            cluster: a piece of it.
            known: what it was before. Its extents tell how high it is.
        """
        kind = known.block.kind
        return self._best(cluster, (_Problem(view, cluster, kind, self._noise, known, on) for on in get_args(Footing)))

    def _best(self, cluster: Cluster, problems: Iterable[_Problem]) -> BlockSighting | None:
        """The most likely one; none if too little of the edge is seen, of which no problem can be made either."""
        if len(cluster.contour) < _LEAST_EDGE:
            return None
        possible = [fit for problem in problems if (fit := problem.solve()) is not None]
        return min(possible, key=lambda fit: fit.cost).sighting(cluster) if possible else None


def upright_box(cluster: Cluster) -> Block:
    """The smallest upright box around the points from above: where the search begins."""
    (x, y), (length, width), degrees = cv2.minAreaRect(cluster.points[:, :2].astype(np.float32))
    height = float(np.quantile(cluster.points[:, 2], TOP)) - cluster.base
    size = (max(length, SHORTEST), max(width, SHORTEST), max(height, SHORTEST))
    block = Block("box", float(x), float(y), math.radians(degrees), size, cluster.base)
    return block.turned(round(-block.yaw / (0.5 * math.pi)))


class _Solved(NamedTuple):
    block: Block
    covariance: Array
    """Of the parameters"""
    cost: float
    """Twice the negative logarithm of the evidence, by Laplace's approximation, up to what all fits of a piece share"""
    measured: bool
    """Whether the extents were free"""
    strained: bool
    """See `BlockSighting`"""

    def sighting(self, cluster: Cluster) -> BlockSighting:
        """With the covariance of its centre instead of its base."""
        red, green, blue = cluster.color.tolist()
        extents, first = _EXTENTS[self.block.kind], 2 if self.block.kind == "cylinder" else 3
        outward = np.zeros((7, len(self.covariance)))
        outward[[0, 1], [0, 1]] = outward[2, -1] = 1.0
        outward[4:, first:-1] = extents
        outward[2, first:-1] = 0.5 * extents[2]
        if first == 3:
            outward[3, 2] = 1.0
        covariance = outward @ self.covariance @ outward.T
        if first == 2:
            covariance[3, 3] = math.pi**2
        return BlockSighting(
            self.block, covariance, (red, green, blue), self._leaning(cluster.base), cluster.hidden,
            self.measured, self.strained, self.cost,
        )  # fmt: skip

    def _leaning(self, level: float) -> float:
        """Rad: what stands on a support at a height (m) leans as far as both are uneven, whatever else as it may."""
        stands = abs(self.block.base - level) < _SUNK * LEVEL
        return _SURFACE / min(self.block.size[:2]) if stands else LEANING


class _Problem:
    """What tells the place and the size of one piece, taken as a box or a cylinder.

    Parameters are x, y, then the yaw unless it is a cylinder, and the free extents: length, width, height of a box, the
    edge of a cube, diameter, height of a cylinder. Last come three that nobody asks for: the height on which it stands,
    the error that all depths share, and how far all pixels of the edge are within the thing.
    """

    def __init__(
        self,
        view: FrameView,
        cluster: Cluster,
        kind: BlockKind,
        noise: NoiseModel,
        known: KnownBlock | None,
        on: Footing | None = None,
    ) -> None:
        self._view, self._kind, self._level = view, kind, cluster.base
        chosen = np.linspace(0, len(cluster.points) - 1, min(_POINTS, len(cluster.points))).astype(int)
        self._points, rays = cluster.points[chosen], cluster.rays[chosen]
        self._along = rays / np.linalg.norm(rays, axis=1)[:, None]
        self._depth_std = noise.inverse_depth_std * cluster.depths[chosen] ** 2 * np.linalg.norm(rays, axis=1)
        news = len(cluster.points) / max(noise.depth_correlation, 1.0) ** 2  # depths that are wrong independently
        self._depth_weight = min(1.0, news / len(chosen))
        edge = np.linspace(0, len(cluster.contour) - 1, min(_EDGE_POINTS, len(cluster.contour))).astype(int)
        self._contour, self._edge = cluster.contour[edge], cluster.edge
        self._edge_std = np.hypot(cluster.edge.std, cluster.contour_sigma[edge])
        seen = upright_box(cluster)
        unchanged = known is not None and (cluster.hidden > MOSTLY_SEEN or on is not None)
        self._measured = not unchanged
        before, sigma = (known.block, known.sigma) if known is not None and unchanged else (seen, (_UNSEEN,) * 3)
        base = cluster.base + seen.size[2] - before.size[2] if on == "anywhere" else cluster.base
        self._others, bias_std = [base, 0.0, self._edge.inset], max(noise.depth_bias_std, _LEAST_BIAS)
        others_std = [_RAISED if on == "anywhere" else LEVEL, bias_std, self._edge.inset_std]
        self._prior = self._parameters(before._replace(x=seen.x, y=seen.y))
        yaw_std = [] if kind == "cylinder" else [_ANY_YAW]
        self._prior_std = np.array([_ANYWHERE, _ANYWHERE, *yaw_std, *_free(kind, sigma), *others_std])
        edge_weight = min(1.0, self._edge.independent / len(self._contour))
        self._weight = np.repeat([self._depth_weight, edge_weight], [len(chosen), len(self._contour)])
        sized = seen if on is None else seen._replace(size=before.size)
        starts = [self._parameters(block) for block in (sized, *(() if known is None else (known.block,)))]
        self._tails = _TAILS if known is None else _TAILS[-1:]
        self._start = min(starts, key=lambda start: self._cost(start, self._tails[0]))

    def _parameters(self, block: Block) -> Array:
        yaw = [] if self._kind == "cylinder" else [block.yaw]
        return np.array([block.x, block.y, *yaw, *_free(self._kind, block.size), *self._others])

    def _block(self, p: Array) -> Block:
        first = 2 if self._kind == "cylinder" else 3
        x, y, z = (_EXTENTS[self._kind] @ p[first:-_OTHERS]).tolist()
        yaw = 0.0 if first == 2 else float(p[2])
        return Block(self._kind, float(p[0]), float(p[1]), yaw, (x, y, z), float(p[-_OTHERS]))

    def _missed(self, p: Array) -> Array:
        """What is missed by, in standard deviations: depths, then edge."""
        block = self._block(p)
        _, shift, inset = p[-_OTHERS:]
        distances, normals = block.distances(self._points + shift * self._along, self._along)
        cosines = np.einsum("ij,ij->i", normals, self._along)
        by_depth = distances / np.hypot(self._depth_std * cosines, _SURFACE)
        seen = block.above(self._level + self._edge.rise)
        by_edge = (inside(seen.outline(self._view), self._contour) - _EDGE - inset) / self._edge_std
        return np.concatenate([by_depth, by_edge])

    def solve(self) -> _Solved | None:
        """Gauss-Newton with damping, from a start that may be far off; None if it ends at no block."""
        p = self._start
        for tail in self._tails:
            p, cost = self._settled(p, tail)
        return self._judged(p, cost)

    def _slopes(self, p: Array, tail: float) -> tuple[Array, Array, Array]:
        """What is missed by (n,), by how much more for each parameter (n, m), and how much each counts (n,)."""
        missed = self._missed(p)
        slopes = np.stack([(self._missed(p + step) - missed) / _OFF for step in _OFF * np.eye(len(p))], axis=1)
        return missed, slopes, self._weight / (1.0 + (missed / tail) ** 2)

    def _settled(self, p: Array, tail: float) -> tuple[Array, float]:
        """The best parameters near `p`, and the cost, if what misses by `tail` counts less."""
        precision = np.diag(self._prior_std**-2)
        cost, damping = self._cost(p, tail), _DAMPING
        for _ in range(_STEPS):
            missed, slopes, robust = self._slopes(p, tail)
            information = (slopes * robust[:, None]).T @ slopes + precision
            pull = (slopes * robust[:, None]).T @ missed + precision @ (p - self._prior)
            step = np.linalg.solve(information + damping * np.diag(np.diag(information)), pull)
            tried = p - step
            tried_cost = self._cost(tried, tail)
            if tried_cost < cost:
                p, cost, damping = tried, tried_cost, 0.2 * damping
                if step @ information @ step < _SETTLED**2:
                    break
            else:
                damping = 10.0 * max(damping, _DAMPING)
        return p, cost

    def _information(self, p: Array) -> Array:
        """Fisher's, with the prior. Points beyond a face that looks away tell only that it is not before them."""
        _, slopes, counts = self._slopes(p, self._tails[-1])
        _, normals = self._block(p).distances(self._points + p[-2] * self._along, self._along)
        counts[: len(self._points)] *= np.einsum("ij,ij->i", normals, self._along) < -GRAZING
        return np.asarray((slopes * counts[:, None]).T @ slopes + np.diag(self._prior_std**-2))

    def _cost(self, p: Array, tail: float) -> float:
        """Twice the negative logarithm of the posterior; infinite for what is no block."""
        if min(self._block(p).size) < 0.5 * SHORTEST:
            return math.inf
        robust = tail**2 * np.log1p((self._missed(p) / tail) ** 2)
        return float(self._weight @ robust) + float((((p - self._prior) / self._prior_std) ** 2).sum())

    def _judged(self, p: Array, cost: float) -> _Solved | None:
        missed = np.abs(self._missed(p))
        block = self._block(p)
        by_depth, by_edge = missed[: len(self._points)], missed[len(self._points) :]
        if not math.isfinite(cost) or not SHORTEST <= min(block.size) <= max(block.size) <= LONGEST:
            return None
        if max(float(np.median(by_depth)), float(np.median(by_edge))) > _NO_BLOCK:
            return None
        if block.base < self._level - _SUNK * LEVEL:
            return None
        information = self._information(p)
        covariance = np.asarray(np.linalg.inv(information)[: 1 - _OTHERS, : 1 - _OTHERS], np.float64)
        cost += float(np.linalg.slogdet(information)[1]) + 2.0 * float(np.log(self._prior_std).sum())
        off = np.abs((p - self._prior) / self._prior_std)[-_OTHERS:-1]
        return _Solved(block, covariance, cost, self._measured, bool(off.max() > _STRAINED))


def _free(kind: BlockKind, extents: Sequence[float]) -> Array:
    """(n,) the free extents of a kind of block of which all three are given, or their standard deviations, m."""
    share = _EXTENTS[kind]
    return np.asarray((share / share.sum(axis=0)).T @ np.array(extents))
