"""The fit: robust least squares over mount, target, lens and the hand's errors, with a covariance that is honest.

Levenberg and Marquardt's method on SE(3). Each view's slip is eliminated (Schur complement), so the cost grows with the
number of views only linearly. The standard deviations are found from the residuals (MacKay 1992, "Bayesian
interpolation": squares are divided by the numbers that no parameter follows). All pixels of a view share the error of
the hand, and points beside each other share those of lens and print. Otherwise hundreds of points would make the result
look certain. Views and points weigh by Student's t distribution, so that wrong ones hardly count.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from agents.calibrator.hand_eye.equations import Normal, Strata, inverse, smooth_patterns
from agents.calibrator.hand_eye.model import Parameters, ViewModel
from agents.calibrator.hand_eye.observations import HandNoise
from agents.calibrator.hand_eye.priors import Prior
from dsr.math3d.batches import inverse_left_jacobians, logs
from dsr.math3d.transforms import Array

_FREEDOM = 4.0
"""Of Student's t distribution: about a tenth of the residuals may be anything"""
_EFFICIENCY = (_FREEDOM + 6.0 + 2.0) / (_FREEDOM + 6.0)
"""Variance of a mean with these weights, over what the weights say (Lange, Little and Taylor 1989)"""
_ROUNDS = 40
"""Of weights and standard deviations"""
_SETTLED = 0.01
"""Relative change of all standard deviations in the last round"""
_PIXEL, _LEAST_PIXEL = 0.2, 0.01
"""px, usual standard deviation of a point, and the least"""
_LEAST_HAND = 1e-6
"""m, rad: no hand is known better, and a robot of few joints cannot err in all directions"""
_BELIEVED, _BELIEVED_HAND = 2.0, 20.0
"""Residuals that a usual standard deviation counts as, where nobody states one. The hand's counts as three views have:
errors of lens and print look like errors of the hand"""
_MEDIAN = 5.35
"""Of squared Mahalanobis distances, 6 degrees of freedom"""
_STEPS = 30
_FIRST_DAMPING, _MOST_DAMPING = 1e-4, 1e8
_DONE = 1e-4
"""Decrease of the cost (in squared standard deviations) by the last step"""
_FOCAL = 1.0
"""px, no focal length is shorter"""


class Noise(NamedTuple):
    """Standard deviations."""

    pixel: float
    """px, of each coordinate of each point by itself"""
    smooth: float
    """px, of what neighbouring points have in common: a lens that is modelled roughly, a print that is bent"""
    hand: tuple[float, ...]
    """m or rad, of each `HandNoise`"""


class Weights(NamedTuple):
    """How much counts; about 1."""

    points: Array
    """(v, n); 0 of points that were not found"""
    views: Array
    """(v,)"""


class Fitted(NamedTuple):
    """The result."""

    parameters: Parameters
    noise: Noise
    weights: Weights
    covariance: Array
    """(c, c) of the common parameters"""
    distances: Array
    """(v,) squared Mahalanobis distance of each view's pose from what the others predict, 6 degrees of freedom"""


class Fitter:
    """Fits one model under one prior."""

    def __init__(self, model: ViewModel, prior: Prior) -> None:
        self.model, self.prior = model, prior
        self._noises = model.observations.noises
        self._patterns = smooth_patterns(model.observations.points)

    def fit(self, start: Parameters) -> Fitted:
        """The most likely parameters near a start, under which all points are before the camera."""
        weights = Weights(self.model.seen.astype(np.float64), np.ones(len(self.model.seen)))
        noise = Noise(_PIXEL, _PIXEL, tuple(one.std for one in self._noises))
        now = self._coarse(start, weights, noise)
        for _ in range(_ROUNDS):
            now, before = self.settled(now, weights, noise), noise
            weights = self._weights(now, weights, noise)
            noise = self._noise(now, weights, noise)
            if _is_settled(before, noise):
                break
        now = self.settled(now, weights, noise)
        normal = self.normal(now, weights, noise)
        distances = self._distances(now, normal, weights, noise)
        scatter = max(1.0, float(np.median(distances)) / _MEDIAN)
        return Fitted(now, noise, weights, scatter * _EFFICIENCY * inverse(normal.reduced()[0]), distances)

    def _coarse(self, start: Parameters, weights: Weights, noise: Noise) -> Parameters:
        """Nearer to the answer: with pixels as bad as the start shows them, and then better and better ones."""
        off = self.model.residuals(start)[self.model.seen]
        shown = float(np.sqrt(np.median((off**2).sum(axis=1)))) if np.isfinite(off).all() else _PIXEL
        now, pixel = start, max(shown, _PIXEL)
        while pixel > 2.0 * _PIXEL:
            stated = noise._replace(pixel=pixel)
            now = self.settled(now, weights, stated)
            weights = self._weights(now, weights, stated)
            pixel /= 4.0
        return now

    def settled(self, now: Parameters, weights: Weights, noise: Noise) -> Parameters:
        """The parameters of least cost near some, for given weights and standard deviations."""
        cost, damping = self.cost(now, weights, noise), _FIRST_DAMPING
        for _ in range(_STEPS):
            normal = self.normal(now, weights, noise)
            while damping < _MOST_DAMPING:
                tried = self.model.moved(now, *normal.step(damping))
                reached = self.cost(tried, weights, noise)
                if reached <= cost:
                    break
                damping *= 10.0
            else:
                break
            gained, now, cost, damping = cost - reached, tried, reached, 0.1 * damping
            if gained < _DONE:
                break
        return now

    def cost(self, now: Parameters, weights: Weights, noise: Noise) -> float:
        """Squared standard deviations, weighted; infinite where a point cannot be seen."""
        if not min(now.intrinsics.fx, now.intrinsics.fy) > _FOCAL:
            return math.inf
        off = self.model.residuals(now)
        if not np.isfinite(off).all():
            return math.inf
        white = self._strata(weights, noise).white(off[..., None])
        slips, information = self._slips(now), self._information(weights, noise)
        common = self.prior.off(now, self.model)
        held = np.einsum("vi,vij,vj->", slips, information, slips)
        return float((white**2).sum() + held + common @ self.prior.information @ common)

    def normal(self, now: Parameters, weights: Weights, noise: Noise) -> Normal:
        """The normal equations, the prior included; gradients point to where the cost falls."""
        by_common, by_slip, off = self._whitened(now, weights, noise)
        information = self._information(weights, noise)
        slips, by_own, by_offsets = self._slips(now), self._by_slip(now), self._by_offsets(by_common.shape[-1])
        held = np.swapaxes(by_own, 1, 2) @ information
        seen = by_common.reshape(-1, by_common.shape[-1])
        return Normal(
            common=seen.T @ seen
            + np.einsum("vki,vkl,vlj->ij", by_offsets, information, by_offsets, optimize=True)
            + self.prior.information,
            between=np.swapaxes(by_common, 1, 2) @ by_slip + np.swapaxes(held @ by_offsets, 1, 2),
            slips=np.swapaxes(by_slip, 1, 2) @ by_slip + held @ by_own,
            common_gradient=seen.T @ off.ravel()
            - np.einsum("vki,vkl,vl->i", by_offsets, information, slips)
            - self.prior.information @ self.prior.off(now, self.model),
            slip_gradient=np.einsum("vki,vk->vi", by_slip, off) - np.einsum("vij,vj->vi", held, slips),
        )

    def _strata(self, weights: Weights, noise: Noise) -> Strata:
        return Strata.of(weights.points, self._patterns, noise.pixel, noise.smooth)

    def _whitened(self, now: Parameters, weights: Weights, noise: Noise) -> tuple[Array, Array, Array]:
        """Derivatives (v, m, c), (v, m, 6) and residuals (v, m) in weighted standard deviations."""
        linear, strata = self.model.linearised(now), self._strata(weights, noise)
        off = strata.white(linear.residuals[..., None])[..., 0]
        return strata.white(linear.by_common), strata.white(linear.by_slip), off

    def _distances(self, now: Parameters, normal: Normal, weights: Weights, noise: Noise) -> Array:
        """(v,) `Fitted.distances`, by the linear equations."""
        by_common, by_slip, off = self._whitened(now, weights, noise)
        whole, covariances = normal.reduced()[0], hand_covariances(self._noises, noise)
        slips, offsets = self._slips(now), self._by_offsets(by_common.shape[-1])
        result = np.empty(len(off))
        for row in range(len(off)):
            own = inverse(by_slip[row].T @ by_slip[row])
            seen = own @ (by_slip[row].T @ off[row]) + slips[row]  # the slip that the view alone shows
            through = own @ by_slip[row].T @ by_common[row] - offsets[row]
            pulled = through.T @ inverse(covariances[row] / weights.views[row] + own)
            others = inverse(whole - pulled @ through)
            away = seen + through @ (others @ (pulled @ seen))
            spread = covariances[row] + own + through @ others @ through.T
            result[row] = away @ inverse(spread) @ away
        return result

    def _slips(self, now: Parameters) -> Array:
        """(v, 6) twists of the slips less what the joint offsets explain."""
        slips = logs(now.slips)
        effects = self.model.observations.joint_effects
        return slips - effects @ now.offsets if self.model.fits_offsets and effects is not None else slips

    def _by_slip(self, now: Parameters) -> Array:
        """(v, 6, 6) derivatives of `_slips` by a right perturbation of each slip."""
        return inverse_left_jacobians(-logs(now.slips))

    def _by_offsets(self, count: int) -> Array:
        """(v, 6, c) derivatives of `_slips` by the common parameters."""
        effects = self.model.observations.joint_effects
        result = np.zeros((len(self.model.seen), 6, count))
        if self.model.fits_offsets and effects is not None:
            result[:, :, count - effects.shape[2] :] = -effects
        return result

    def _information(self, weights: Weights, noise: Noise) -> Array:
        """(v, 6, 6) weighted, of the hand's errors."""
        return weights.views[:, None, None] * np.linalg.inv(hand_covariances(self._noises, noise))

    def _weights(self, now: Parameters, weights: Weights, noise: Noise) -> Weights:
        """Weights by Student's t distribution, from present ones on; what is not known of a slip counts as a slip."""
        off = (self.model.residuals(now) ** 2).sum(axis=2) / (noise.pixel**2 + noise.smooth**2)
        slips, information = self._slips(now), np.linalg.inv(hand_covariances(self._noises, noise))
        away = np.einsum("vi,vij,vj->v", slips, information, slips)
        away += np.einsum("vij,vji->v", information, self._slip_covariances(now, *self._known(now, weights, noise)))
        points = self.model.seen * (_FREEDOM + 2.0) / (_FREEDOM + off)
        return Weights(points, (_FREEDOM + 6.0) / (_FREEDOM + away))

    def _noise(self, now: Parameters, weights: Weights, noise: Noise) -> Noise:
        """The standard deviations that the residuals show."""
        known = self._known(now, weights, noise)
        pixel, smooth = self._of_pixels(now, weights, noise, known)
        return Noise(pixel, smooth, self._of_hand(now, weights, noise, known))

    def _known(self, now: Parameters, weights: Weights, noise: Noise) -> tuple[Array, Array, Array]:
        """Covariance (c, c) of the common parameters, (v, 6, 6) of slips beside them, (v, c, 6) how these follow."""
        normal = self.normal(now, weights, noise)
        whole, follows = normal.reduced()
        return inverse(whole), np.asarray(np.linalg.inv(normal.slips), np.float64), follows

    def _slip_covariances(self, now: Parameters, covariance: Array, inverses: Array, follows: Array) -> Array:
        """(v, 6, 6) of `_slips` after all has been seen."""
        own, offsets = self._by_slip(now), self._by_offsets(len(covariance))
        mixed = offsets - own @ np.swapaxes(follows, 1, 2)
        return np.asarray(own @ inverses @ np.swapaxes(own, 1, 2) + mixed @ covariance @ np.swapaxes(mixed, 1, 2))

    def _of_hand(
        self, now: Parameters, weights: Weights, noise: Noise, known: tuple[Array, Array, Array]
    ) -> tuple[float, ...]:
        """Those of the hand's poses, given what is `_known`."""
        posterior = self._slip_covariances(now, *known)
        information, slips = self._information(weights, noise), self._slips(now)
        learned = information - information @ posterior @ information
        stds = []
        for one, std in zip(self._noises, noise.hand, strict=True):
            weighted = std**2 / weights.views
            numbers = np.einsum("vki,vkl,vl->vi", one.effects, information, slips) * weighted[:, None]
            squares = float((weights.views * (numbers**2).sum(axis=1)).sum())
            determined = float((np.einsum("vki,vkl,vli->v", one.effects, learned, one.effects) * weighted).sum())
            believed = 0.0 if one.is_stated else _BELIEVED_HAND
            found = (squares + believed * one.std**2) / max(determined + believed, _LEAST_HAND)
            stds.append(max(math.sqrt(found), one.std if one.is_stated else _LEAST_HAND))
        return tuple(stds)

    def _of_pixels(
        self, now: Parameters, weights: Weights, noise: Noise, known: tuple[Array, Array, Array]
    ) -> tuple[float, float]:
        """Those of points by themselves and of what they have in common, as `_of_hand`."""
        covariance, inverses, follows = known
        linear, strata = self.model.linearised(now), self._strata(weights, noise)
        parts = [strata.parts(values) for values in (linear.by_common, linear.by_slip, linear.residuals[..., None])]
        squares, left = [], []
        for part in (0, 1):
            by_common, by_slip, off = (values[part] for values in parts)
            mixed = by_common - by_slip @ np.swapaxes(follows, 1, 2)
            learned = ((mixed @ covariance) * mixed).sum(axis=(1, 2)) + ((by_slip @ inverses) * by_slip).sum(
                axis=(1, 2)
            )
            squares.append((off**2).sum(axis=(1, 2)))
            left.append(strata.counts[part] - learned)
        rest = noise.pixel**2 * float(squares[1].sum())
        pixel = math.sqrt((rest + _BELIEVED * _PIXEL**2) / (max(float(left[1].sum()), 0.0) + _BELIEVED))
        pixel = max(pixel, _LEAST_PIXEL)
        points = weights.points.sum(axis=1)
        shared = float((strata.smooth**2 * squares[0] - pixel**2 * left[0]).sum())
        smooth = (max(shared, 0.0) + _BELIEVED * _PIXEL**2) / (max(float((left[0] * points).sum()), 0.0) + _BELIEVED)
        return pixel, max(math.sqrt(smooth), _LEAST_PIXEL)


def hand_covariances(noises: Sequence[HandNoise], noise: Noise) -> Array:
    """(v, 6, 6) of the hand's errors, m and rad in its own frame."""
    result: Array = np.array(_LEAST_HAND**2 * np.eye(6))[None]
    for one, std in zip(noises, noise.hand, strict=True):
        result = result + std**2 * one.effects @ np.swapaxes(one.effects, 1, 2)
    return result


def _is_settled(before: Noise, after: Noise) -> bool:
    old, new = (np.array([noise.pixel, noise.smooth, *noise.hand]) for noise in (before, after))
    return bool((np.abs(new - old) <= _SETTLED * new).all())
