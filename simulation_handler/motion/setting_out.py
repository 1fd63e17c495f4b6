"""How fast an object was that is seen no more: what its last percepts tell if nobody knows when it set out."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from itertools import pairwise
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from dsr.perception.scales import HAND_SPEED, STEADY
from simulation_handler.perception.percepts import Array, WeighedPercept

_MOMENTS = 8  # of each period between two percepts at which it may have set out
_CHANGE = HAND_SPEED / STEADY  # m/s^2, standard deviation of each part of the acceleration of what goes on by itself


class SettingOut(NamedTuple):
    """How an object may have moved when it was seen last."""

    position: Array
    """(3,) m, world, then"""
    velocity: Array
    """(3,) m/s"""


def starts_of(trail: Sequence[WeighedPercept], count: int) -> list[SettingOut]:
    """So many ways in which an object may have moved at its last percept, each as probable; a typical one comes first.

    It rested until some moment, and has gone on smoothly since, with a constant acceleration: what rolls gets slower.
    Each moment is as probable, from one period before the percepts that count. At the first moved percept, its velocity
    is so known by displacement and an unknown age. It may also have gone another way until some moment, if at least
    two displacements since tell how it goes on: it has bounced.
    The typical velocity is the one from which all others are the least apart. Their mean would be too fast: a short age
    means a high speed.

    Args:
        trail: its newest percepts, without a gap, the last one at the end; one at least.
        count: how many.
    """
    moments, told = _moments(trail), [percept.stamp for percept in trail[:-2]]
    rested = _given(trail, moments, turned=False)
    turns = (moments > trail[0].stamp) & (moments < max(told, default=-np.inf))
    turned = _given(trail, moments[turns], turned=True)
    evidence, means, covariances = (np.concatenate(both) for both in zip(rested, turned, strict=True))
    weights = np.exp(evidence - evidence.max())
    weights /= weights.sum()
    drawn = np.searchsorted(np.cumsum(weights), (np.arange(count) + 0.5) / count).clip(max=len(weights) - 1)
    roots = np.linalg.cholesky(covariances[drawn])
    states = means[drawn] + (roots @ _normal(count)[:, :, None])[:, :, 0]
    velocities = states[:, 3:]
    apart = np.linalg.norm(velocities[:, None] - velocities, axis=2).sum(axis=1)
    typical = int(apart.argmin())
    order = [typical, *(number for number in range(count) if number != typical)]
    return [SettingOut(states[number, :3], states[number, 3:]) for number in order]


def _moments(percepts: Sequence[WeighedPercept]) -> Array:
    """(m,) s: when it may have set out: evenly over the periods between percepts, and one more before.

    One percept tells no period, and nothing of the velocity.
    """
    stamps = [percept.stamp for percept in percepts]
    if len(stamps) == 1:
        return np.array(stamps)
    stamps = [2.0 * stamps[0] - stamps[1], *stamps]
    shares = (np.arange(_MOMENTS) + 0.5) / _MOMENTS
    return np.concatenate([a + shares * (b - a) for a, b in pairwise(stamps)])


def _given(percepts: Sequence[WeighedPercept], moments: Array, *, turned: bool) -> tuple[Array, Array, Array]:
    """What percepts tell if the object set out at each of m moments, after it had rested, or `turned` from another way.

    Percepts are linear in position, velocity and acceleration at the last one, and in the velocity before the moment.
    Velocities and acceleration have Gaussian priors.

    Returns:
        (m,) nats, log likelihood of the percepts, up to a constant; (m, 6) mean of position (m) and velocity (m/s) at
        the last percept; (m, 6, 6) covariance of these.
    """
    end, stamps = percepts[-1], np.array([percept.stamp for percept in percepts])
    since = np.maximum(stamps, moments[:, None]) - end.stamp
    before = np.minimum(stamps - moments[:, None], 0.0)
    ways = [np.ones_like(since), since, 0.5 * since**2, *([before] if turned else [])]
    rows = np.stack(ways, axis=-1)  # (m, n, 3 or 4): by position, velocity, acceleration and velocity before
    weighed = np.linalg.inv(np.array([percept.position_covariance for percept in percepts]))
    offsets = np.array([percept.position - end.position for percept in percepts])
    size = len(end.position) * rows.shape[2]
    prior = np.repeat([0.0, HAND_SPEED**-2, _CHANGE**-2, HAND_SPEED**-2][: rows.shape[2]], 3)
    told = np.einsum("mni,mnj,nkl->mikjl", rows, rows, weighed).reshape(-1, size, size)
    shifts = np.einsum("mni,nkl,nl->mik", rows, weighed, offsets).reshape(-1, size)
    covariances = np.linalg.inv(told + np.diag(prior))
    means = (covariances @ shifts[..., None])[..., 0]
    evidence = 0.5 * (np.einsum("mi,mi->m", shifts, means) + np.linalg.slogdet(covariances)[1])
    evidence += 0.5 * float(np.log(prior[3:]).sum())
    means[:, :3] += end.position
    return evidence, means[:, :6], 0.5 * (covariances + covariances.mT)[:, :6, :6]


@cache
def _normal(count: int) -> Array:
    """(count, 6) standard normal draws, in an order that has nothing to do with the moments; the same in each run."""
    quantile = NormalDist().inv_cdf
    evenly = np.array([quantile((k + 0.5) / count) for k in range(count)])
    rng = np.random.default_rng(0)
    return np.array([rng.permutation(evenly) for _ in range(6)]).T
