"""Learns how much of their stated covariances percepts by colour have wrong alike, by recordings of images."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from benchmarks.learning.recorded import Recorded
from simulation_handler.worlds.circumstances import RESTS
from simulation_handler.worlds.parameters import ConstantErrors, WorldParameters
from simulation_handler.worlds.spread import position_covariance, squared_distance
from simulation_handler.worlds.weighted import WeightedWorlds

CONSTANT = "constant"
"""Name of these shares in the file, and for `fit --only`"""
_FREEDOM = 4.0  # 1, degrees of freedom of Student's t distribution of errors: some are of something else
_RESAMPLINGS = 50  # of episodes, by which standard errors are found

Array = NDArray[np.float64]


class _Errors(NamedTuple):
    """Errors of objects without a tag at rest in view, of one episode."""

    places: Array
    """(n, 3) m, world, from the truth"""
    noise: Array
    """(n, 3, 3) m^2, what is told without constant errors"""
    constant: Array
    """(n, 3, 3) m^2, constant errors by the shares of the recording"""


def learn_constant(
    episodes: Sequence[tuple[Sequence[Recorded], WeightedWorlds]], known: WorldParameters
) -> tuple[ConstantErrors, dict[str, float]]:
    """The likeliest share, and the standard error of its logarithm, by drawing episodes anew.

    Each episode comes with worlds that have seen nothing yet. Where percepts scatter, they tell nothing.
    """
    found = [errors for moments, worlds in episodes if (errors := _errors_of(moments, worlds, known)) is not None]
    if not found:
        return known.constant, {}
    draws = np.random.default_rng(0).integers(len(found), size=(_RESAMPLINGS, len(found))).tolist()
    drawn = [_factor([found[index] for index in draw]) for draw in draws]
    color = known.constant.color * _factor(found)
    return msgspec.structs.replace(known.constant, color=color), {"color": float(np.std(np.log(drawn), ddof=1))}


def _factor(episodes: Sequence[_Errors]) -> float:
    """By how much constant errors are larger than those of the recordings; each episode counts as much."""

    def cost(logarithm: float) -> float:
        return sum(_cost(one, float(np.exp(logarithm))) for one in episodes)

    return float(np.exp(minimize_scalar(cost, bounds=(-5.0, 5.0), method="bounded").x))


def _cost(errors: _Errors, factor: float) -> float:
    """Nats of one error, on average, up to a constant."""
    covariances = errors.noise + factor * errors.constant
    tails = (_FREEDOM + 3.0) * np.log1p(squared_distance(errors.places, covariances) / _FREEDOM)
    return 0.5 * float(np.mean(tails + np.linalg.slogdet(covariances)[1]))


def _errors_of(moments: Sequence[Recorded], worlds: WeightedWorlds, known: WorldParameters) -> _Errors | None:
    rows: list[tuple[Array, Array, Array]] = []
    for moment in moments:
        worlds.update(moment.evidence)
        rows += _at_rest(moment, worlds, known)
    return _Errors(*map(np.array, zip(*rows, strict=True))) if rows else None


def _at_rest(
    moment: Recorded, worlds: WeightedWorlds, known: WorldParameters
) -> Iterator[tuple[Array, Array, Array]]:
    noise, nothing = known.noise[RESTS], np.zeros(())
    for name in sorted(moment.truth.keys() & moment.evidence.objects.keys() & moment.in_view):
        followed = worlds.followed(name)
        if followed is None or followed.circumstance != RESTS or followed.pose.cov is None or followed.constant is None:
            continue
        own = followed.pose.parent_covariances()[0]
        told = position_covariance(noise, own, nothing, nothing, np.zeros(3))
        yield np.subtract(followed.pose.t, moment.truth[name].t), told, followed.constant
