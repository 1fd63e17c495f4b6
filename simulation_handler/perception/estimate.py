"""The poses of objects at rest, averaged over their percepts, of all objects at once.

An information filter averages the noise of the percepts, which changes from frame to frame. The systematic error
along the viewing ray is the same in all of them and stays out of the average: see `Estimate.total_covariance`. How much
of their stated covariance is noise, their scatter tells: see `Estimate.noise_shares`.

Older percepts count less and less. What the filter takes the noise of such an average for is as much as that of as many
percepts as its window has. Its true noise is half of that, for twice as many percepts are in it: see `Estimate.faded`.

Some percepts do not tell how an object is turned, or tell it about some axes only (`perception/turns.py`). About the
other axes they leave the estimate and its covariance as they are.

Each of many objects has three numbers of place and three of rotation. What is worked out of them in one piece costs a
fifth of what it costs object by object.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dsr.math3d import quaternions
from dsr.math3d.batches import matrix_inverses
from dsr.math3d.quaternions import Quaternion, Vector3
from dsr.perception.consensus import tells_rotation
from dsr.perception.scales import LIKELY_SIGMAS, RECENT_PERCEPTS, SAME_PLACE, SURE_SIGMAS
from simulation_handler.config import BeliefConfig
from simulation_handler.perception.percepts import Array, Covariances, WeighedPercept
from simulation_handler.perception.turns import ToldAxes, are_told, tell_none, told_axes, updated
from simulation_handler.scales import PLACE_FLOOR, TURN_FLOOR

Innovation = Array
"""(2, 3) from an estimate to a percept, in the world frame: shift, m, and rotation vector, rad"""
Compared = tuple[WeighedPercept, Innovation]
"""A percept, and how far it was from the estimate when it came."""

_EYE = np.eye(3)
_DIRECTIONS = np.array((len(_EYE) - 1, len(_EYE)), dtype=np.float64)
"""(2,) 1, of how many directions `Estimate.scatter` is"""
_TURN_FLOOR = TURN_FLOOR**2 * _EYE  # rad^2


class RayError(NamedTuple):
    """Systematic error of percepts along the viewing ray: a Gaussian."""

    mean: float
    """m"""
    std: float
    """m, standard deviation"""

    @property
    def is_known(self) -> bool:
        """Whether it is known so well that it makes no other place of where something is seen."""
        return SURE_SIGMAS * self.std <= SAME_PLACE


class Estimate(Covariances):
    """Average of the percepts of an object at rest."""

    def __init__(self, percept: WeighedPercept, config: BeliefConfig) -> None:
        self.position = percept.position
        self.rotation = percept.rotation
        self.covariances = _known_by(percept)
        """(2, 3, 3) of the remaining noise: of the position, m^2, and of the rotation, rad^2"""
        self.faded = self.covariances
        """(2, 3, 3) the same, as if percepts were the noisier, the older they are: new ones are weighed against that"""
        self.ray = percept.ray
        self.stamp = percept.stamp
        self.scatter = _DIRECTIONS
        """(2,) 1, of place across the viewing ray, and of rotation: mean squares of how far recent percepts were off

        In standard deviations, from the estimate before. They are first what is expected, one for each direction. That
        counts as one percept.
        """
        self.count = 1
        self.config = config

    def loosen(self, recent: Sequence[Compared]) -> None:
        """Doubt the estimate in the direction in which some percepts agree that it is off, as surely as they tell."""
        shifts = np.mean([innovation for _, innovation in recent], axis=0)
        noise = np.sum([_told_by(percept) for percept, _ in recent], axis=0) / len(recent) ** 2
        doubt = shifts[:, :, None] * shifts[:, None, :] + noise
        self.covariances, self.faded = self.covariances + doubt, self.faded + doubt

    def inherit(self, old: Estimate) -> None:
        """Keep position and rotation of an older estimate, each if it has not changed beyond noise.

        What has moved may be turned. So its rotation is known no better than the new percepts tell it.
        """
        shifts = np.array([old.position - self.position, _turn(self.rotation, old.rotation)])
        same = _distances2(shifts, self.covariances + old.covariances) <= self.config.gate**2
        kept = np.array((same[0], same[1] and (same[0] or tells_rotation(self.rotation_covariance))))
        self.covariances = np.where(kept[:, None, None], old.covariances, self.covariances)
        self.faded = np.where(kept[:, None, None], old.faded, self.faded)
        if same[0]:
            self.position, self.count = old.position, old.count
        if same[1]:
            self.rotation = old.rotation

    def take_over(self, before: Estimate, anew: Estimate) -> bool:
        """Take position and rotation from percepts that came after a gap, each if these tell another one than before.

        Args:
            before: the estimate as it was before the gap.
            anew: the average of all percepts since then. This estimate has both.

        Returns:
            Whether anything was taken.
        """
        shifts = np.array([anew.position - before.position, _turn(before.rotation, anew.rotation)])
        apart = _distances2(shifts, anew.covariances + before.covariances) > self.config.regained_gate**2
        self.covariances = np.where(apart[:, None, None], anew.covariances, self.covariances)
        self.faded = np.where(apart[:, None, None], anew.faded, self.faded)
        self.scatter = np.where(apart, anew.scatter, self.scatter)
        if apart[0]:
            self.position, self.count = anew.position, anew.count
        if apart[1]:
            self.rotation = anew.rotation
        return bool(apart.any())

    def corrected(self, error: float) -> Array:
        """(3,) m, the position without a systematic error of `error` m along the viewing ray."""
        corrected: Array = self.position - error * self.ray
        return corrected

    def error_given(self, height: float) -> RayError | None:
        """Systematic error along the viewing ray, if the object is really at `height` (m); None if more must be wrong.

        The error is Gaussian around 0, and heights are known but for `PLACE_FLOOR`. So the flatter the ray, the less a
        height tells (Bayes' theorem for Gaussians).
        """
        prior, slope, off = self.config.depth_bias**2, float(self.ray[2]), float(self.position[2] - height)
        surprise = slope**2 * prior + PLACE_FLOOR**2
        if not abs(off) <= LIKELY_SIGMAS * math.sqrt(surprise):
            return None
        return RayError(slope * prior * off / surprise, PLACE_FLOOR * math.sqrt(prior / surprise))

    def total_covariance(self, error_std: float) -> Array:
        """Covariance (3, 3) of the position, m^2: remaining noise, and systematic error along the viewing ray (m)."""
        total: Array = self.position_covariance + error_std**2 * (self.ray[:, None] * self.ray)
        return total

    def total_turning(self) -> Array:
        """Covariance (3, 3) of the rotation, rad^2: remaining noise, and what is no noise of percepts."""
        total: Array = self.rotation_covariance + _TURN_FLOOR
        return total

    @property
    def noise_shares(self) -> tuple[float, float]:
        """1: which share of the stated covariances is noise, of place across the viewing ray and of rotation.

        Recent percepts tell that by their scatter. It is that of one of three directions at least: what scatters less
        has constant errors. Noise along the ray does not count: it may be stated for what is constant, and whatever
        tells a height takes it away.
        """
        across, turn = (self.scatter / _DIRECTIONS).tolist()
        least = 1.0 / len(self.position)
        return max(across, least), max(turn, least)

    def standard_deviations(self) -> tuple[float, float]:
        """The remaining noise sideways (m, of one axis) and in yaw (rad)."""
        position, rotation = self.position_covariance, self.rotation_covariance
        return math.sqrt(0.5 * (position[0, 0] + position[1, 1])), math.sqrt(rotation[2, 2])


def innovations(estimates: Sequence[Estimate], percepts: Sequence[WeighedPercept]) -> Array:
    """(n, 2, 3) the innovations of percepts, each of the estimate in its place."""
    found = np.empty((len(estimates), 2, 3))
    found[:, 0] = _stacked([percept.position for percept in percepts])
    found[:, 0] -= _stacked([estimate.position for estimate in estimates])
    found[:, 1] = [_turn(one.rotation, percept.rotation) for one, percept in zip(estimates, percepts, strict=True)]
    partly, nothing = _untold(percepts)
    if partly:
        found[partly, 1] = _axes(percepts, partly).shown(found[partly, 1])
    if nothing:
        found[nothing, 1] = 0.0
    return found


def accepted(estimates: Sequence[Estimate], percepts: Sequence[WeighedPercept], shifts: Array) -> NDArray[np.bool_]:
    """(n,) whether percepts with those innovations (n, 2, 3) may be of objects that have not moved.

    They are within the gate in place and rotation.
    """
    noise = _covariances(estimates) + _covariances(percepts)
    return np.asarray((_distances2(shifts, noise) <= estimates[0].config.gate**2).all(axis=1))


def farthest(estimates: Sequence[Estimate], recents: Sequence[Sequence[Compared]]) -> list[int]:
    """Of how many of the last percepts of each the mean is farthest beyond the gate; 0 if none is.

    The mean counts from `confirm_frames` percepts on. All have as many percepts.
    """
    config = estimates[0].config
    count, fewest = len(recents[0]), config.confirm_frames
    if count < fewest:
        return [0] * len(recents)
    newest = [compared for recent in recents for compared in reversed(recent)]
    shifts = _stacked([innovation for _, innovation in newest]).reshape(-1, count, 2, 3)
    noises = _covariances([percept for percept, _ in newest]).reshape(-1, count, 2, 3, 3)
    counts = np.arange(fewest, count + 1)[:, None, None]
    means = np.cumsum(shifts, axis=1)[:, fewest - 1 :] / counts
    noise = np.cumsum(noises, axis=1)[:, fewest - 1 :] / (counts**2)[..., None]
    distances2 = _distances2(means, _covariances(estimates)[:, None] + noise).max(axis=2)
    distances2 = np.where(np.isnan(distances2), -np.inf, distances2)
    most = distances2.argmax(axis=1)
    is_beyond = np.take_along_axis(distances2, most[:, None], axis=1)[:, 0] > config.recent_gate**2
    found: list[int] = np.where(is_beyond, fewest + most, 0).tolist()
    return found


def fuse(estimates: Sequence[Estimate], percepts: Sequence[WeighedPercept], shifts: Array) -> None:
    """Take in percepts with those innovations (n, 2, 3), each in the estimate in its place.

    Of more percepts than the window's, the older ones count less and less. No estimate may be there twice. How much
    turns scatter, only percepts that tell all of a turn can tell.
    """
    for estimate in estimates:
        estimate.count += 1
    found = _updates(estimates, percepts, shifts)
    scatter = np.array([estimate.scatter for estimate in estimates])
    counts = np.array([[min(estimate.count, RECENT_PERCEPTS)] for estimate in estimates])
    scatter += np.where(np.isfinite(found.squares), found.squares - scatter, 0.0) / counts
    for place in np.flatnonzero(found.are_finite).tolist():
        estimate, percept = estimates[place], percepts[place]
        estimate.covariances, estimate.faded = found.noise[place].copy(), found.faded[place].copy()
        estimate.scatter = scatter[place]
        estimate.position = estimate.position + found.steps[place, 0]
        x, y, z = found.steps[place, 1].tolist()
        step = quaternions.from_rotvec((x, y, z))
        estimate.rotation = quaternions.normalised(quaternions.product(step, estimate.rotation))
        estimate.ray, estimate.stamp = percept.ray, percept.stamp


class _Updates(NamedTuple):
    """What percepts change in n estimates."""

    faded: Array
    noise: Array
    """(n, 2, 3, 3) as `Estimate.faded` and `Estimate.covariances`"""
    steps: Array
    """(n, 2, 3) of position, m, and rotation, rad"""
    squares: Array
    """(n, 2) 1, of the percepts, as `Estimate.scatter`; nan of turns that are not all told"""

    @property
    def are_finite(self) -> NDArray[np.bool_]:
        """(n,) whether all numbers could be worked out."""
        numbers = np.concatenate([one.reshape(len(self.steps), -1) for one in self[:3]], axis=1)
        return np.asarray(np.isfinite(numbers).all(axis=1))


def _updates(estimates: Sequence[Estimate], percepts: Sequence[WeighedPercept], shifts: Array) -> _Updates:
    """What percepts with those innovations change (Kalman update).

    By its gain, the noise follows of the average that has been worked out so (Joseph's form).
    """
    window = estimates[0].config.window
    keep = np.array([1.0 if estimate.count <= window else 1.0 - 1.0 / window for estimate in estimates])
    before, noise = _stacked([estimate.faded for estimate in estimates]), _covariances(estimates)
    prior, stated = before / keep[:, None, None, None], _covariances(percepts)
    expected = prior + stated
    inverse = matrix_inverses(expected.reshape(-1, 3, 3)).reshape(prior.shape)
    gain = prior @ inverse
    rest = _EYE - gain
    faded, left = rest @ prior, rest @ noise @ rest.mT + gain @ stated @ gain.mT
    faded, left = 0.5 * (faded + faded.mT), 0.5 * (left + left.mT)
    steps = (gain @ shifts[..., None])[..., 0]
    squares = _squares(percepts, shifts, expected[:, 0], inverse)
    partly, nothing = _untold(percepts)
    if partly:
        told_of = before[partly, 1], noise[partly, 1], keep[partly], shifts[partly, 1]
        faded[partly, 1], left[partly, 1], steps[partly, 1] = updated(_axes(percepts, partly), *told_of)
    if nothing:
        faded[nothing, 1], left[nothing, 1], steps[nothing, 1] = before[nothing, 1], noise[nothing, 1], 0.0
    squares[partly + nothing, 1] = np.nan
    return _Updates(faded, left, steps, squares)


def _squares(percepts: Sequence[WeighedPercept], shifts: Array, expected: Array, inverse: Array) -> Array:
    """(n, 2) as `Estimate.scatter`, of innovations (n, 2, 3) with the inverses (n, 2, 3, 3) of their covariances.

    The covariances of the places are `expected` (n, 3, 3) m^2. What is across the ray is what the ray leaves (a square
    with one degree of freedom less).
    """
    place, turn = np.einsum("nki,nkij,nkj->kn", shifts, inverse, shifts)
    rays = _stacked([percept.ray for percept in percepts])
    along = np.einsum("ni,ni->n", rays, shifts[:, 0]) ** 2 / np.einsum("ni,nij,nj->n", rays, expected, rays)
    return np.stack((np.maximum(place - along, 0.0), turn), axis=1)


def fused(percepts: Sequence[WeighedPercept], config: BeliefConfig) -> Estimate | None:
    """Their average, or None if they are not all of one pose."""
    estimate = Estimate(percepts[0], config)
    for percept in percepts[1:]:
        shifts = innovations([estimate], [percept])
        if not accepted([estimate], [percept], shifts)[0]:
            return None
        fuse([estimate], [percept], shifts)
    return estimate


def _untold(percepts: Sequence[WeighedPercept]) -> tuple[list[int], list[int]]:
    """The places of those that tell a part of how an object is turned, and of those that tell nothing of it."""
    turns = _stacked([percept.rotation_covariance for percept in percepts])
    all_told, none_told = are_told(turns), tell_none(turns)
    return np.flatnonzero(~(all_told | none_told)).tolist(), np.flatnonzero(none_told).tolist()


def _axes(percepts: Sequence[WeighedPercept], places: Sequence[int]) -> ToldAxes:
    """About which axes the percepts at those places tell a turn."""
    return told_axes(_stacked([percepts[place].rotation_covariance for place in places]))


def _known_by(percept: WeighedPercept) -> Array:
    """(2, 3, 3) what is known by one percept alone: of any turn, no less is known than that it is one."""
    if tells_rotation(percept.rotation_covariance):
        return percept.covariances
    return np.stack([percept.position_covariance, _axes([percept], [0]).known[0]])


def _told_by(percept: WeighedPercept) -> Array:
    """(2, 3, 3) the noise of what one percept tells: none about the axes about which it tells no turn."""
    if tells_rotation(percept.rotation_covariance):
        return percept.covariances
    return np.stack([percept.position_covariance, _axes([percept], [0]).noise[0]])


def _turn(before: Quaternion, after: Quaternion) -> Vector3:
    """(3,) rotation vector in the world frame from one rotation to another, rad."""
    return quaternions.to_rotvec(quaternions.product(after, quaternions.conjugate(before)))


def _stacked(arrays: Sequence[Array]) -> Array:
    """Arrays of one shape as one (n, ...), at a fifth of the cost of `numpy.stack`."""
    return np.concatenate(arrays).reshape(len(arrays), *arrays[0].shape)


def _covariances(told: Sequence[Estimate] | Sequence[WeighedPercept]) -> Array:
    """(n, 2, 3, 3)"""
    return _stacked([one.covariances for one in told])


def _distances2(differences: Array, covariances: Array) -> Array:
    """(...) squared Mahalanobis distances of differences (..., 3) with covariances (..., 3, 3).

    By cofactors, for of many small matrices those cost a tenth of a solver that is called for each. NaN for covariances
    that cannot be inverted: by rounding they may seem to give a negative square.
    """
    x, y, z = np.moveaxis(differences, -1, 0)
    (a, b, c), (_, d, e), (_, _, f) = np.moveaxis(covariances, (-2, -1), (0, 1))
    by_x, by_y, by_z = d * f - e * e, c * e - b * f, b * e - c * d
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        squares = by_x * x * x + (a * f - c * c) * y * y + (a * d - b * b) * z * z
        mixed = by_y * x * y + by_z * x * z + (b * c - a * e) * y * z
        distances2 = (squares + 2.0 * mixed) / (a * by_x + b * by_y + c * by_z)
        return np.where(distances2 >= 0.0, distances2, np.nan)
