"""Poses of the tags of an image with their covariances: corners, depth and the tags' sizes, weighed together.

Four things tell where a tag is: its corners in the image, the plane of the depth within it, the side that it
should have, and how wrong each may be. Gauss-Newton steps from several starts find the most likely pose. All
starts of all tags take their steps at once. The covariance of a pose is the inverse of the Fisher information.
Corners alone fit two poses where perspective is weak (Schweighofer and Pinz 2006); depth decides.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from agents.scene_estimator.depth_plane import DepthPlanes, fit_depth_planes
from agents.scene_estimator.detection import Tag, tag_corners
from agents.scene_estimator.perspective import POSES, square_poses
from dsr.math3d import quaternions
from dsr.math3d.batches import Array, exps, inverses, logs, matrix_inverses, solutions
from dsr.math3d.transforms import Pose
from dsr.vocabulary.intrinsics import Intrinsics

Positive = Annotated[float, msgspec.Meta(gt=0)]
NotNegative = Annotated[float, msgspec.Meta(ge=0)]
_SIZE_RATIO = 1.5
"""Seen over true size of a tag; outside 1/1.5 to 1.5 the depth is that of something else."""
_WRONG_SIZE = 0.02
"""Probability that somebody told a wrong size; all sizes up to `_SIZE_RATIO` are alike then."""
_NO_SQUARE = 27.6
"""Sum of squares over their variances of what corners miss the best square by: exceeded by one in 1e6 (chi^2, 2)"""
_LONG_TAIL = 2.45
"""Standard deviations from which a corner weighs less (Huber 1964): 95 % of normal errors in two dimensions are less"""
_FINEST = 0.2
"""px, least standard deviation of a corner when outliers are told: errors of detectors have long tails"""
_CERTAIN = 50.0  # log odds
_STEPS = 20  # of Gauss-Newton; four or five do
_SETTLED = 1e-2  # standard deviations of the result, of the last step
_SAME = 0.1  # standard deviations, between starts that end at one pose
_STARTS, _BY_DEPTH = POSES + 1, POSES  # of each tag; the one from the plane of its depth
_LATER, _EARLIER = np.tril_indices(_STARTS, -1)  # of the pairs of starts of one tag
_TILT = slice(2, 5)
"""Of a twist: the shift along the normal of a tag and the turns about its x and y, which alone move its plane"""


class NoiseModel(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A model of the sensor's errors."""

    corner_std: NotNegative = 0.12
    """px, of corners in sharp images of a real lens, beside the reader's own 0.05: together 0.13, as measured."""
    depth_bias_std: NotNegative = 0.01
    """m, systematic error of depth along the ray: not visible in the residuals, does not average out."""
    depth_ripple_std: NotNegative = 5e-4
    """m, systematic error of depth from one edge of a tag to the middle: by the brightness of what is printed there."""
    inverse_depth_floor: Positive = 3e-4
    """1/m, least standard deviation of a pixel's inverse depth."""
    inverse_depth_std: Positive = 2.5e-3
    """1/m, standard deviation of a pixel's inverse depth, by which a shape fits or not"""
    depth_correlation: NotNegative = 4.0
    """px, over which neighbouring depth errors are alike: stereo compares patches."""
    blur: NotNegative = 7.5e-4
    """s: a moving tag's edges are found inside by so much times their speed, and are as uncertain: part of exposure."""
    size_below: NotNegative = 0.5
    """m, distance beyond which depth alone tells the distance: its bias is common to all tags, wrong sizes are not."""
    size_std: Positive = 0.01
    """Standard deviation of a tag's side over the side that it should have: half a millimetre of a tag of 50 mm."""


class _Plane(NamedTuple):
    """What depth tells: p of a plane p . X = 1 in the camera frame."""

    p: Array
    """(3,) 1/m"""
    information: Array
    """(3, 3) inverse of its covariance, m^2"""


class TagFit(NamedTuple):
    """A most likely pose."""

    pose: Array
    """(4, 4) camera_from_tag"""
    covariance: Array
    """(6, 6) of a right perturbation"""
    cost: float
    """Twice the negative logarithm of the likelihood, up to a constant"""


def estimate_tag_pose(
    tag: Tag, depth: NDArray[np.float32] | None, intrinsics: Intrinsics, tag_size: float, noise: NoiseModel
) -> Pose | None:
    """`camera_from_tag` (x right, y up as printed, z off the face) with covariance; None if it cannot be told.

    Where several poses are about as likely, it is the most likely one, with a covariance that spans them.

    Args:
        tag: its corners, px.
        depth: (h, w) m, of the same exposure and intrinsics; None without a depth camera.
        intrinsics: px, and the distortion of the lens.
        tag_size: side of the black square, m.
        noise: error model of the sensor.
    """
    return most_likely(possible_tag_poses([tag], depth, intrinsics, [tag_size], noise)[0])


def possible_tag_poses(
    tags: Sequence[Tag],
    depth: NDArray[np.float32] | None,
    intrinsics: Intrinsics,
    tag_sizes: Sequence[float],
    noise: NoiseModel,
) -> list[list[TagFit]]:
    """Of each tag of an image all poses that fit best among their neighbours, the most likely one first.

    There is none for corners that no square could have: part of the tag is hidden, or a motion blurred it.

    Args:
        tags: their corners, px.
        depth: (h, w) m, of the same exposure and intrinsics; None without a depth camera.
        intrinsics: px, and the distortion of the lens.
        tag_sizes: side of each black square, m.
        noise: error model of the sensor.
    """
    found: list[list[TagFit]] = [[] for _ in tags]
    corners = np.array([tag.corners for tag in tags], np.float64).reshape(-1, 4, 2)
    rays = intrinsics.rays(corners)
    usable = np.flatnonzero(np.isfinite(rays).all(axis=(1, 2)))
    if len(usable) == 0:
        return found
    corners, rays = corners[usable], rays[usable]
    sizes, stds = np.array(tag_sizes)[usable], np.array([tag.corner_std for tag in tags])[usable]
    starts, scales = np.full((len(usable), _STARTS, 4, 4), np.nan), np.zeros((len(usable), _STARTS))
    starts[:, :POSES] = square_poses(rays, sizes)
    planes, size_stds = _no_planes(len(usable)), np.full(len(usable), noise.size_std)
    if depth is not None:
        planes = _planes(corners, rays, depth, intrinsics, sizes, noise)
        known, told = np.flatnonzero(planes.exist), DepthPlanes(*(values[planes.exist] for values in planes))
        starts[known, _BY_DEPTH] = _poses_on_planes(rays[known], told, sizes[known])
        scales[known, _BY_DEPTH] = np.log(_sides(told, rays[known]) / sizes[known])
        size_stds[known[told.points(rays[known])[..., 2].mean(axis=1) > noise.size_below]] = np.inf
        planes.covariance[known] = _plane_covariances(told, rays[known], sizes[known], noise)
    information = np.where(planes.exist[:, None, None], matrix_inverses(planes.covariance), 0.0)
    problem = _TagProblem(corners, stds, intrinsics, sizes, size_stds, np.nan_to_num(planes.p), information)
    for place, fits in zip(usable.tolist(), _different(problem.solve(starts, scales)), strict=True):
        found[place] = fits
    return found


def most_likely(fits: list[TagFit]) -> Pose | None:
    """The best of several, with a covariance that spans the others as far as they are likely; None if there is none."""
    if not fits:
        return None
    best = min(fits, key=lambda fit: fit.cost)
    covariance = best.covariance.copy()
    others = [fit for fit in fits if fit is not best]
    if others:
        aparts = logs(inverses(best.pose) @ np.array([other.pose for other in others]))
        for other, apart in zip(others, aparts, strict=True):
            doubt = 1.0 / (1.0 + math.exp(min(0.5 * (other.cost - best.cost), _CERTAIN)))
            covariance += doubt * np.outer(apart, apart)
    rotation = quaternions.from_matrix(best.pose[:3, :3].tolist())
    x, y, z = best.pose[:3, 3].tolist()
    return Pose.unchecked((x, y, z), rotation, cov=tuple(covariance.ravel().tolist()))


class _Fits(NamedTuple):
    """What came of the starts of n tags."""

    poses: Array
    """(n, starts, 4, 4)"""
    information: Array
    """(n, starts, 6, 6) inverses of their covariances"""
    costs: Array
    """(n, starts); infinite where there is no pose before the camera, or none of a square"""


def _different(fits: _Fits) -> list[list[TagFit]]:
    """Of each tag the fits without repetitions, the most likely one first."""
    order = np.argsort(fits.costs, axis=1, kind="stable")
    poses, information, costs = (np.take_along_axis(values, _as_index(order, values), axis=1) for values in fits)
    new = np.isfinite(costs)
    tags, pairs = np.nonzero(new[:, _LATER] & new[:, _EARLIER])
    later, earlier = _LATER[pairs], _EARLIER[pairs]
    aparts = logs(inverses(poses[tags, later]) @ poses[tags, earlier])[:, :, None]
    alike = np.zeros((len(new), len(_LATER)), bool)
    alike[tags, pairs] = (aparts.mT @ information[tags, later] @ aparts)[:, 0, 0] <= _SAME**2
    for pair, (later_one, earlier_one) in enumerate(zip(_LATER, _EARLIER, strict=True)):
        new[:, later_one] &= ~(alike[:, pair] & new[:, earlier_one])
    tags, starts = np.nonzero(new)
    covariances = matrix_inverses(information[tags, starts])
    even = 0.5 * (covariances + covariances.mT)  # they are symmetric but for rounding
    found: list[list[TagFit]] = [[] for _ in new]
    for tag, start, covariance in zip(tags.tolist(), starts.tolist(), even, strict=True):
        found[tag].append(TagFit(poses[tag, start], covariance, float(costs[tag, start])))
    return found


def _as_index(order: NDArray[np.int64], values: Array) -> NDArray[np.int64]:
    return order.reshape(*order.shape, *[1] * (values.ndim - 2))


class _TagProblem(NamedTuple):
    """Corners, depth and sizes of n tags as least squares problems in the poses and the logarithms of the scales."""

    corners: Array
    """(n, 4, 2) px"""
    corner_stds: Array
    """(n,) px"""
    intrinsics: Intrinsics
    sizes: Array
    """(n,) m, sides"""
    size_stds: Array
    """(n,) of the logarithm of the scale; infinite where the size tells nothing"""
    planes: Array
    """(n, 3) 1/m, p of the depth"""
    plane_information: Array
    """(n, 3, 3) m^2, 0 without depth"""

    def solve(self, starts: Array, scales: Array) -> _Fits:
        """The most likely poses near starts (n, k, 4, 4) with logarithms of scales (n, k); NaN where there is none."""
        shape = scales.shape
        poses, scales = starts.reshape(-1, 4, 4).copy(), scales.reshape(-1).copy()
        costs, missed = np.full(len(poses), np.inf), np.full(len(poses), np.inf)
        all_information = np.full((len(poses), 7, 7), np.nan)
        moving = np.flatnonzero(np.isfinite(poses).all(axis=(1, 2)))
        for _ in range(_STEPS):
            if len(moving) == 0:
                break
            information, gradient, cost, off = self._linear(moving // shape[1], poses[moving], scales[moving])
            costs[moving], missed[moving], all_information[moving] = cost, off, information
            step = solutions(information, gradient[:, :, None])[..., 0]
            poses[moving] = poses[moving] @ exps(step[:, :6])
            scales[moving] += step[:, 6]
            moving = moving[(gradient * step).sum(axis=1) >= _SETTLED**2]  # without those that have no step
        failed = ~(missed < _NO_SQUARE) | ~np.isfinite(poses).all(axis=(1, 2))
        costs[failed] = np.inf
        of_pose = _without_last(all_information)
        return _Fits(poses.reshape(*shape, 4, 4), of_pose.reshape(*shape, 6, 6), costs.reshape(shape))

    def _linear(self, tags: NDArray[np.int64], poses: Array, scales: Array) -> tuple[Array, Array, Array, Array]:
        """Information (m, 7, 7), gradient (m, 7), costs (m,) and what corners miss (m,), at poses and scales of tags.

        NaN where a corner is not before the camera, or nowhere in its image.
        """
        stds = self.corner_stds[tags]
        pixels, by_twist = self._seen(np.exp(scales)[:, None, None] * self._squares(tags), poses)
        rows = by_twist.reshape(-1, 8, 7) / stds[:, None, None]
        residual = (self.corners[tags] - pixels) / stds[:, None, None]
        off = np.sqrt((residual**2).sum(axis=2))
        weights = np.repeat(np.minimum(1.0, _LONG_TAIL / np.maximum(off, 1e-12)), 2, axis=1)
        weighted = np.swapaxes(rows * weights[..., None], 1, 2)
        information = weighted @ rows
        gradient = (weighted @ residual.reshape(-1, 8, 1))[..., 0]
        cost = np.where(off < _LONG_TAIL, off**2, _LONG_TAIL * (2.0 * off - _LONG_TAIL)).sum(axis=1)
        missed = cost * (stds / np.maximum(stds, _FINEST)) ** 2
        cost = cost + self._add_depth(tags, poses, information, gradient)
        return information, gradient, cost + self._add_size(tags, scales, information, gradient), missed

    def _seen(self, square: Array, poses: Array) -> tuple[Array, Array]:
        """Pixels (m, 4, 2) of corners (m, 4, 3) m at poses, and their derivatives (m, 4, 2, 7) by twists and scales."""
        rotations = poses[:, :3, :3]
        points = square @ rotations.mT + poses[:, None, :3, 3]
        points[~(points[..., 2].min(axis=1) > 0.0)] = np.nan
        pixels, by_point = self.intrinsics.project_with_derivative(points)
        by_shift = (by_point.reshape(-1, 8, 3) @ rotations).reshape(-1, 4, 2, 3)
        by_x, by_y, by_z = np.moveaxis(by_shift, 3, 0)
        x, y = square[..., :1], square[..., 1:2]
        others = [y * by_z, -x * by_z, x * by_y - y * by_x, x * by_x + y * by_y]
        return pixels, np.concatenate([by_shift, np.stack(others, axis=3)], axis=3)

    def _squares(self, tags: NDArray[np.int64]) -> Array:
        """(m, 4, 3) m, corners in the frames of tags."""
        return self.sizes[tags][:, None, None] * tag_corners(1.0)

    def _add_depth(self, tags: NDArray[np.int64], poses: Array, information: Array, gradient: Array) -> Array:
        """The costs (m,) of what depth tells of tags; its information and gradient are added in place."""
        p, by_tilt = _planes_of(poses)
        apart, told = (self.planes[tags] - p)[:, :, None], self.plane_information[tags]
        weighted = by_tilt.mT @ told
        information[:, _TILT, _TILT] += weighted @ by_tilt
        gradient[:, _TILT] += (weighted @ apart)[..., 0]
        return np.asarray((apart.mT @ told @ apart)[:, 0, 0])

    def _add_size(self, tags: NDArray[np.int64], scales: Array, information: Array, gradient: Array) -> Array:
        """The costs (m,) of what sizes tell of tags; none if the size that was told is plainly wrong."""
        std = self.size_stds[tags]
        is_told = np.isfinite(std)
        std = np.where(is_told, std, 1.0)
        wrong = _WRONG_SIZE * std * math.sqrt(2.0 * math.pi) / (2.0 * math.log(_SIZE_RATIO))
        right = np.exp(-0.5 * (scales / std) ** 2)
        weight = np.where(is_told, right / (right + wrong) / std**2, 0.0)
        information[:, 6, 6] += weight
        gradient[:, 6] -= weight * scales
        return np.where(is_told, -2.0 * np.log(right + wrong), 0.0)


def _without_last(information: Array) -> Array:
    """(n, 6, 6) what is told of the others of (n, 7, 7) if nothing is known of the last one: Schur complements."""
    rest = information[:, :6, 6]
    return np.asarray(information[:, :6, :6] - rest[:, :, None] * (rest / information[:, 6, 6:])[:, None])


def _planes_of(poses: Array) -> tuple[Array, Array]:
    """The p (n, 3) of tags' planes p . X = 1, and their derivatives (n, 3, 3) by `_TILT` of right perturbations."""
    centres, normals = poses[:, :3, 3], poses[:, :3, 2]
    distances = (normals * centres).sum(axis=1)[:, None]
    p = normals / distances
    turned = np.stack([-poses[:, :3, 1], poses[:, :3, 0]], axis=2)
    by_turn = (turned - p[:, :, None] * (centres[:, None] @ turned)) / distances[..., None]
    return p, np.concatenate([-(p / distances)[:, :, None], by_turn], axis=2)


def _no_planes(count: int) -> DepthPlanes:
    return DepthPlanes(np.full((count, 3), np.nan), np.full((count, 3, 3), np.nan))


def _planes(
    corners: Array, rays: Array, depth: NDArray[np.float32], intrinsics: Intrinsics, sizes: Array, noise: NoiseModel
) -> DepthPlanes:
    """The tags' planes, unless the depth there contradicts their sizes."""
    planes = fit_depth_planes(
        corners,
        depth,
        intrinsics,
        noise_floor=noise.inverse_depth_floor,
        correlation=noise.depth_correlation,
    )
    ratios = _sides(planes, rays) / sizes
    planes.p[~((ratios > 1.0 / _SIZE_RATIO) & (ratios < _SIZE_RATIO))] = np.nan
    return planes


def _sides(planes: DepthPlanes, rays: Array) -> Array:
    """(n,) m, mean sides of what has its corners on rays (n, 4, 3) in planes."""
    points = planes.points(rays)
    return np.asarray(np.linalg.norm(np.roll(points, -1, axis=1) - points, axis=2).mean(axis=1))


def _plane_covariances(planes: DepthPlanes, rays: Array, sizes: Array, noise: NoiseModel) -> Array:
    """(n, 3, 3) of p, with the systematic errors of depth, for tags whose corners are on rays (n, 4, 3).

    A bias b of the depth z scales p by b / z: the tag moves along its ray. If b is the same for the whole tag, or
    grows with z^2 (a shift of disparity), the ends of a tilted tag move unequally: that adds or takes
    (p - e_z / z) b / z. A ripple tilts the plane about the middle of the tag, along x and y of the image.
    """
    centres = planes.points(rays).mean(axis=1)
    distances = centres[:, 2:]
    bias = noise.depth_bias_std / distances
    slope = noise.depth_ripple_std / (0.5 * sizes[:, None] * distances)  # 1/m, of inverse depth over a unit of the ray
    across = np.eye(3)[None] - np.eye(3)[2] * (centres / distances)[..., None]
    directions = np.stack(
        [
            bias * planes.p,
            bias * (planes.p - np.eye(3)[2] / distances),
            slope * across[:, 0],
            slope * across[:, 1],
        ],
        axis=2,
    )
    return np.asarray(planes.covariance + directions @ np.swapaxes(directions, 1, 2))


def _poses_on_planes(rays: Array, planes: DepthPlanes, sizes: Array) -> Array:
    """(n, 4, 4) the poses that planes and the corners' rays (n, 4, 3) give: axes by Procrustes (Schonemann 1966)."""
    points = planes.points(rays)
    centres = points.mean(axis=1)
    offsets, normals = points - centres[:, None], planes.normals
    square = sizes[:, None, None] * tag_corners(1.0)
    by_x, by_y = (np.einsum("nk,nki->ni", square[..., axis], offsets) for axis in (0, 1))
    x = by_x + np.cross(by_y, normals)
    x -= normals * (normals * x).sum(axis=1, keepdims=True)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    poses = np.tile(np.eye(4), (len(rays), 1, 1))
    poses[:, :3, :3] = np.stack([x, np.cross(normals, x), normals], axis=2)
    poses[:, :3, 3] = centres
    return poses
