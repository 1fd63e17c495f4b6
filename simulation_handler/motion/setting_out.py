"""How fast an object was that is seen no more: what its last percepts tell if nobody knows when it set out."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from itertools import pairwise
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from dsr.perception.scales import HAND_SPEED
from simulation_handler.perception.percepts import Array, WeighedPercept

LAST = 4
"""Percepts, the last ones, that tell a velocity: over more of them, what rolls gets slower"""
_MOMENTS = 8  # of each period between two percepts at which it may have set out


class SettingOut(NamedTuple):
    """How an object may have moved when it was seen last."""

    position: Array
    """(3,) m, world, then"""
    velocity: Array
    """(3,) m/s"""


class _ByMoment(NamedTuple):
    """What percepts tell if the object set out at one moment."""

    evidence: float
    """Log likelihood of the percepts, nats, up to a constant"""
    mean: Array
    """(6,) position (m) and velocity (m/s) at the last percept"""
    covariance: Array
    """(6, 6) of these"""


def starts_of(trail: Sequence[WeighedPercept], count: int) -> list[SettingOut]:
    """So many ways in which an object may have moved at its last percept, each as probable; a typical one comes first.

    It rested until some moment, and moved steadily from then on. Each moment is as probable, from one period before the
    percepts that count. At the first moved percept, its velocity is so known by displacement and an unknown age.
    The typical velocity is the one from which all others are the least apart. Their mean would be too fast: a short age
    means a high speed.

    Args:
        trail: its newest percepts, without a gap, the last one at the end; one at least.
        count: how many.
    """
    last = list(trail)[-LAST:]
    found = [_given(last, moment) for moment in _moments(last)]
    weights = np.exp(np.array([one.evidence for one in found]) - max(one.evidence for one in found))
    weights /= weights.sum()
    drawn = np.searchsorted(np.cumsum(weights), (np.arange(count) + 0.5) / count)
    states = []
    for index, normal in zip(drawn.tolist(), _normal(count), strict=True):
        chosen = found[min(index, len(found) - 1)]
        states.append(SettingOut(*np.split(chosen.mean + np.linalg.cholesky(chosen.covariance) @ normal, 2)))
    velocities = np.array([state.velocity for state in states])
    apart = np.linalg.norm(velocities[:, None] - velocities, axis=2).sum(axis=1)
    states.insert(0, states.pop(int(apart.argmin())))
    return states


def _moments(percepts: Sequence[WeighedPercept]) -> list[float]:
    """When (s) it may have set out: evenly over the periods between percepts, and one more before.

    One percept tells no period, and nothing of the velocity.
    """
    stamps = [percept.stamp for percept in percepts]
    if len(stamps) == 1:
        return stamps
    stamps = [2.0 * stamps[0] - stamps[1], *stamps]
    shares = (np.arange(_MOMENTS) + 0.5) / _MOMENTS
    return [a + share * (b - a) for a, b in pairwise(stamps) for share in shares.tolist()]


def _given(percepts: Sequence[WeighedPercept], moment: float) -> _ByMoment:
    """Percepts as a linear function of position and velocity at the last one, with a Gaussian prior of the velocity."""
    end = percepts[-1]
    precision, shift = np.zeros((6, 6)), np.zeros(6)
    precision[3:, 3:] = np.eye(3) / HAND_SPEED**2
    evidence, moved = 0.0, max(end.stamp - moment, 0.0)
    for percept in percepts:
        rows = np.hstack([np.eye(3), (max(percept.stamp - moment, 0.0) - moved) * np.eye(3)])
        weighed = np.linalg.inv(percept.position_covariance)
        offset = percept.position - end.position
        precision += rows.T @ weighed @ rows
        shift += rows.T @ weighed @ offset
        evidence -= 0.5 * float(offset @ weighed @ offset)
    covariance = np.linalg.inv(precision)
    mean = covariance @ shift
    evidence += 0.5 * float(shift @ mean) + 0.5 * float(np.linalg.slogdet(covariance)[1])
    mean[:3] += end.position
    return _ByMoment(evidence, mean, 0.5 * (covariance + covariance.T))


@cache
def _normal(count: int) -> Array:
    """(count, 6) standard normal draws, in an order that has nothing to do with the moments; the same in each run."""
    quantile = NormalDist().inv_cdf
    evenly = np.array([quantile((k + 0.5) / count) for k in range(count)])
    rng = np.random.default_rng(0)
    return np.array([rng.permutation(evenly) for _ in range(6)]).T
