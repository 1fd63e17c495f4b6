"""What tells the places and extents of the blocks of one piece of an image: the problem, and its most likely solution.

Three things tell a block: where the piece ends in the image, the depths of its pixels, and how wrong a depth may be
for all of them alike. Gauss-Newton steps lead from a first guess to the most likely blocks. The covariance is the
inverse of the Fisher information. Where something hides an edge, nothing tells the place of the face behind it but a
wide prior, so that its extent is as unsure.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.scene_estimator.blocks.block import GRAZING, Block, BlockKind, Faces, inside
from agents.scene_estimator.blocks.clusters import LEVEL, Cluster
from agents.scene_estimator.fitting import FrameView
from agents.scene_estimator.pose import NoiseModel
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Array, Pose

LONGEST, SHORTEST = 0.5, 0.01
"""m, edges of a block that is looked for"""

SURFACE = 0.001
"""m, standard deviation of a surface: real ones are not flat, edges are round"""

SUNK = 3.0
"""Standard deviations of the support's height, by which a block may seem to be in it."""

UNSEEN = 0.05
"""m, standard deviation of an extent before anything was seen of it"""

EXTENTS: dict[BlockKind, Array] = {
    "box": np.eye(3), "cube": np.ones((3, 1)), "cylinder": np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]]),
}  # fmt: skip
"""(3, n) extents along x, y, z by those that are free"""

TAILS = (30.0, 3.0)
"""Standard deviations, beyond which what fits not counts less and less: at first, and then"""

_POINTS, _EDGE_POINTS = 200, 80  # that are used of a piece
_EDGE = 0.5  # px, by which a piece ends outside the middle of its outermost pixels
_ANYWHERE = 1.0  # m, standard deviation of the place before anything was seen
_LEAST_BIAS = 1e-5  # m, standard deviation of the error of all depths where there is none
_ANY_YAW = 0.8  # rad, likewise, of the yaw: half a quarter turn
_STEPS = 8  # with each of the tails
_SETTLED = 0.05  # standard deviations, of the last step
_OFF = 1e-4  # m, rad, for difference quotients
_DAMPING = 1e-3  # of the information: what keeps steps short
_NO_BLOCK = 2.0  # standard deviations, median of what is missed, from which it is no block
_STRAINED = 3.0  # standard deviations, by which all depths, or the support's height, may be off, before that is doubted
_SHARE = 0.1  # of the points of a piece, which each of its blocks has at least


class BlockPrior(NamedTuple):
    """A block before anything was seen."""

    block: Block
    """Its kind, and its most likely place and extents"""
    sigma: Vector3 = (UNSEEN,) * 3
    """m, standard deviations of its extents"""


class Solved(NamedTuple):
    """The most likely blocks."""

    blocks: list[Block]
    covariances: list[Array]
    """(n, n) of each: x, y (m), yaw (rad) unless it is round, free extents, and its base (m)"""
    cost: float
    """Twice the negative logarithm of the evidence, by Laplace's approximation, up to what all fits of a piece share"""
    strained: bool
    """They fit only if all depths, or the height of the support, are far off"""


class _Surfaces(NamedTuple):
    """How the points of a piece lie on its blocks."""

    distances: Array
    """(n,) m, outside the nearest block"""
    normals: Array
    """(n, 3) in the world, of the face there"""
    owner: NDArray[np.intp]
    """(n,) which block is the nearest"""
    faces: list[Faces]
    """Of each block, on which of its faces the points would be"""


class _Nuisance(NamedTuple):
    """What nobody asks for, but what is seen depends on it."""

    base: float
    """m, height on which all blocks stand"""
    biases: Array
    """(k,) m, error that all depths of a block share"""
    leans: Array
    """(k, 2) rad, how each block leans, about the axes x and y of the world, on the middle of its foot"""
    inset: float
    """px, how far all pixels of the edge are within the things"""

    @staticmethod
    def of(values: Array, count: int) -> _Nuisance:
        """Those of `count` blocks, of values in the order of the fields."""
        biases, leans = np.split(values[1:-1], [count])
        return _Nuisance(float(values[0]), biases, leans.reshape(count, 2), float(values[-1]))


class BlockProblem:
    """What tells the places and the sizes of the blocks of one piece, of which the kinds are given.

    Parameters are, of each block, x, y of its foot, then the yaw unless it is a cylinder, and the free extents: length,
    width, height of a box, the edge of a cube, diameter, height of a cylinder. Then come those of `_Nuisance`. Two
    blocks of a piece touch: a gap of a pixel would be seen, and none is in the other.

    Args:
        view: depth and camera.
        cluster: a piece of it.
        noise: error model of the camera.
        guesses: one of each block.
        starts: first guesses of what is looked for; the search begins at the best one.
        base: m, height on which the blocks stand, with its standard deviation.
        tails: see `TAILS`.
    """

    def __init__(
        self,
        view: FrameView,
        cluster: Cluster,
        noise: NoiseModel,
        guesses: Sequence[BlockPrior],
        starts: Sequence[Sequence[Block]],
        *,
        base: tuple[float, float],
        tails: Sequence[float] = TAILS,
    ) -> None:
        self._view, self._level, self._tails = view, cluster.base, tails
        self._kinds: list[BlockKind] = [guess.block.kind for guess in guesses]
        chosen = np.linspace(0, len(cluster.points) - 1, min(_POINTS, len(cluster.points))).astype(int)
        self._points, rays = cluster.points[chosen], cluster.rays[chosen]
        self._along = rays / np.linalg.norm(rays, axis=1)[:, None]
        self._depth_std = noise.inverse_depth_std * cluster.depths[chosen] ** 2 * np.linalg.norm(rays, axis=1)
        news = len(cluster.points) / max(noise.depth_correlation, 1.0) ** 2  # depths that are wrong independently
        edge = np.linspace(0, len(cluster.contour) - 1, min(_EDGE_POINTS, len(cluster.contour))).astype(int)
        self._contour, self._edge = cluster.contour[edge], cluster.edge
        self._edge_std = np.hypot(cluster.edge.std, cluster.contour_sigma[edge])
        self._pixel = float(cluster.depths.mean()) / view.intrinsics.fx  # m
        counts = [len(chosen), len(self._contour), len(guesses) - 1]
        weights = [min(1.0, news / len(chosen)), min(1.0, self._edge.independent / len(self._contour)), 1.0]
        self._weight = np.repeat(weights, counts)
        count, bias_std = len(guesses), max(noise.depth_bias_std, _LEAST_BIAS)
        self._others = [base[0], *[0.0] * 3 * count, self._edge.inset]
        self._prior = self._parameters([guess.block for guess in guesses])
        own = [np.array([_ANYWHERE, _ANYWHERE, *_yaw(kind, _ANY_YAW), *free(kind, guess.sigma)])
               for kind, guess in zip(self._kinds, guesses, strict=True)]  # fmt: skip
        leaning = np.repeat([uprightness(guess.block) for guess in guesses], 2)
        self._prior_std = np.concatenate([*own, [base[1], *[bias_std] * count, *leaning, self._edge.inset_std]])
        self._start = min(map(self._parameters, starts), key=lambda start: self._cost(start, self._tails[0]))

    def _parameters(self, blocks: Sequence[Block]) -> Array:
        own = [[one.x, one.y, *_yaw(kind, one.yaw), *free(kind, one.size)]
               for kind, one in zip(self._kinds, blocks, strict=True)]  # fmt: skip
        return np.concatenate([*own, self._others])

    def _indices(self) -> list[NDArray[np.int64]]:
        """Of the parameters of each block."""
        counts = [2 + len(_yaw(kind, 0.0)) + EXTENTS[kind].shape[1] for kind in self._kinds]
        return [np.arange(end - count, end) for count, end in zip(counts, np.cumsum(counts), strict=True)]

    def _nuisance(self, p: Array) -> _Nuisance:
        return _Nuisance.of(p[-len(self._others) :], len(self._kinds))

    def _blocks(self, p: Array) -> list[Block]:
        """As they would be upright."""
        base, blocks = self._nuisance(p).base, []
        for kind, index in zip(self._kinds, self._indices(), strict=True):
            own, extents = p[index], EXTENTS[kind]
            x, y, z = (extents @ own[-extents.shape[1] :]).tolist()
            yaw = 0.0 if kind == "cylinder" else float(own[2])
            blocks.append(Block(kind, float(own[0]), float(own[1]), yaw, (x, y, z), base))
        return blocks

    def _surfaces(self, p: Array, blocks: Sequence[Block], held: _Surfaces | None = None) -> _Surfaces:
        """How the points lie on the nearest block, or on those faces on which they are held."""
        nuisance, each = self._nuisance(p), []
        for k, (one, bias, lean) in enumerate(zip(blocks, nuisance.biases, nuisance.leans, strict=True)):
            upright = _righted(one, lean)
            turn = upright.rotation_matrix
            points, along = upright.apply(self._points + bias * self._along), self._along @ turn.T
            on = one.distances(points, along, None if held is None else held.faces[k])
            each.append(on._replace(normals=on.normals @ turn))
        distances, normals = np.stack([on.distances for on in each]), np.stack([on.normals for on in each])
        owner = np.abs(distances).argmin(axis=0) if held is None else held.owner
        index = np.arange(len(self._points))
        return _Surfaces(distances[owner, index], normals[owner, index], owner, [on.faces for on in each])

    def _missed(self, p: Array, held: _Surfaces | None = None) -> Array:
        """What is missed by, in standard deviations: depths, then edge, then gaps between the blocks."""
        blocks = self._blocks(p)
        on = self._surfaces(p, blocks, held)
        cosines = np.einsum("ij,ij->i", on.normals, self._along)
        by_depth = on.distances / np.hypot(self._depth_std * cosines, SURFACE)
        nuisance = self._nuisance(p)
        seen = [self._outline(one, lean) for one, lean in zip(blocks, nuisance.leans, strict=True)]
        within = np.max([inside(outline, self._contour) for outline in seen], axis=0)
        by_edge = (within - _EDGE - nuisance.inset) / self._edge_std
        gaps = [one.gap(other) / self._pixel for one, other in pairwise(blocks)]
        return np.concatenate([by_depth, by_edge, gaps])

    def _outline(self, block: Block, lean: Array) -> Array:
        """(n, 2) px, corners of the image of what may be in the piece."""
        camera = _righted(block, lean) @ self._view.world_from_camera
        return block.above(self._level + self._edge.rise).outline(self._view._replace(world_from_camera=camera))

    def solve(self) -> Solved | None:
        """Gauss-Newton with damping, from a start that may be far off; None if it ends at no block."""
        p = self._start
        for tail in self._tails:
            p, cost = self._settled(p, tail)
        return self._judged(p, cost)

    def _slopes(self, p: Array, tail: float) -> tuple[Array, Array, Array]:
        """What is missed by (n,), by how much more for each parameter (n, m), and how much each counts (n,)."""
        held = self._surfaces(p, self._blocks(p))  # a point that goes over an edge to another face is no slope
        missed = self._missed(p, held)
        slopes = np.stack([(self._missed(p + step, held) - missed) / _OFF for step in _OFF * np.eye(len(p))], axis=1)
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
        normals = self._surfaces(p, self._blocks(p)).normals
        counts[: len(self._points)] *= np.einsum("ij,ij->i", normals, self._along) < -GRAZING
        return np.asarray((slopes * counts[:, None]).T @ slopes + np.diag(self._prior_std**-2))

    def _cost(self, p: Array, tail: float) -> float:
        """Twice the negative logarithm of the posterior; infinite for what is no block."""
        if min(min(one.size) for one in self._blocks(p)) < 0.5 * SHORTEST:
            return math.inf
        robust = tail**2 * np.log1p((self._missed(p) / tail) ** 2)
        return float(self._weight @ robust) + float((((p - self._prior) / self._prior_std) ** 2).sum())

    def _judged(self, p: Array, cost: float) -> Solved | None:
        blocks = self._blocks(p)
        if not math.isfinite(cost) or not self._are_blocks(p, blocks):
            return None
        information = self._information(p)
        cost += float(np.linalg.slogdet(information)[1]) + 2.0 * float(np.log(self._prior_std).sum())
        shown, covariances = self._leaned(p, blocks, np.asarray(np.linalg.inv(information)))
        off = self._nuisance((p - self._prior) / self._prior_std)
        is_strained = max(abs(off.base), float(np.abs(off.biases).max())) > _STRAINED
        return Solved(shown, covariances, cost, is_strained)

    def _leaned(self, p: Array, blocks: Sequence[Block], covariance: Array) -> tuple[list[Block], list[Array]]:
        """The blocks with x and y of their middles instead of their feet, and their covariances as of `Solved`."""
        shown, covariances, base = [], [], len(p) - len(self._others)
        for k, (block, index) in enumerate(zip(blocks, self._indices(), strict=True)):
            about_x, about_y = self._nuisance(p).leans[k].tolist()
            half, first = 0.5 * block.size[2], base + 1 + len(blocks) + 2 * k
            shown.append(block._replace(x=block.x + half * about_y, y=block.y - half * about_x))
            rows = np.eye(len(p))[np.append(index, base)]
            rows[0, first + 1], rows[1, first] = half, -half
            covariances.append(rows @ covariance @ rows.T)
        return shown, covariances

    def _are_blocks(self, p: Array, blocks: Sequence[Block]) -> bool:
        """Whether they have possible extents, stand on the support, and most of what is seen is where they tell."""
        sizes = [extent for one in blocks for extent in one.size]
        if not SHORTEST <= min(sizes) <= max(sizes) <= LONGEST or blocks[0].base < self._level - SUNK * LEVEL:
            return False
        missed, owner = np.abs(self._missed(p)), self._surfaces(p, blocks).owner
        by_depth, by_edge = np.split(missed, [len(self._points), len(self._points) + len(self._contour)])[:2]
        parts = [by_depth[owner == k] for k in range(len(blocks))]
        fewest = _SHARE * len(self._points) if len(blocks) > 1 else 1.0
        return min(map(len, parts)) >= fewest and max(map(np.median, [*parts, by_edge])) <= _NO_BLOCK


def uprightness(block: Block) -> float:
    """rad, standard deviation of how far a block leans that stands: its foot, and what it stands on, are not flat."""
    return SURFACE / min(block.size[:2])


def _righted(block: Block, lean: Array) -> Pose:
    """upright_from_world: what rights a block that leans (2,) rad about x and y, on the middle of its foot."""
    foot = Pose((block.x, block.y, block.base))
    return foot @ Pose.from_rotvec((0.0, 0.0, 0.0), (-float(lean[0]), -float(lean[1]), 0.0)) @ foot.inverse()


def free(kind: BlockKind, extents: Sequence[float]) -> Array:
    """(n,) the free extents of a kind of block of which all three are given, or their standard deviations, m."""
    share = EXTENTS[kind]
    return np.asarray((share / share.sum(axis=0)).T @ np.array(extents))


def _yaw(kind: BlockKind, yaw: float) -> list[float]:
    """The parameter of a turn, if the kind has any."""
    return [] if kind == "cylinder" else [yaw]
