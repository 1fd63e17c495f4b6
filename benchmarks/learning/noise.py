"""Learns how far objects are from where the simulation has them, by circumstance: maximum likelihood of the truth."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from benchmarks.honesty.statement import DOUBT, VOLUME
from benchmarks.learning.recorded import Recorded
from dsr.math3d import quaternions
from dsr.math3d.transforms import Pose
from simulation_handler.scales import GAP
from simulation_handler.worlds.followed import Followed, otherwise
from simulation_handler.worlds.parameters import PlaceNoise
from simulation_handler.worlds.spread import (
    levels_of_wrong,
    odds_of_percepts,
    percept_covariance,
    position_covariance,
    rotation_covariance,
    squared_distance,
)
from simulation_handler.worlds.weighted import WeightedWorlds

Array = NDArray[np.float64]
_Row = tuple[object, ...]
"""Values of one moment in the order of `Errors`"""

START = PlaceNoise(scale=1.0, level=0.003, height=0.002, growth=0.003, path=0.1, upwards=0.3, lag=0.05, turn=0.03,
              turning=0.3, wide=5.0, wrong=0.05, perceived=0.05, trust=0.5, percept=1.0)  # fmt: skip
"""Where the search begins, and to which little evidence is drawn."""
_SHARES = ("upwards", "wrong", "perceived")
_PRIOR = 2.0  # 1, standard deviation of the logarithm (or logit) of each value around its start
_MOMENTS = 7.0  # moments of an episode that say as much as one: neighbours in time have nearly the same error
_INDEPENDENT = 20.0  # moments of one episode that count as independent, at most
_FEWEST = 8  # moments, below which a circumstance is not learned


@dataclass(frozen=True)
class Errors:
    """How far objects were from their simulated places in one circumstance, n moments."""

    own_places: Array
    """(n, 3, 3) m^2, covariance that perception tells, world frame"""
    own_turns: Array
    """(n, 3, 3) rad^2, likewise"""
    age: Array
    moved: Array
    velocity: Array
    reach: Array
    """(n,) s, (n,) m, (n, 3) m/s and (n,) m, as of `position_covariance`"""
    places: Array
    """(n, 3) m, from the simulated to the true place, world frame"""
    turns: Array
    """(n, 3) rad, likewise of rotation vectors; nan of things without a tag"""
    seen: Array
    """(n, 3) m, from the simulated to the perceived place, world frame; nan of what is not recognised"""
    own_seen: Array
    """(n, 3, 3) m^2, covariance of the perceived place"""
    seen_turns: Array
    """(n, 3) rad, from the perceived to the true rotation, world frame; nan as of `turns` and `seen`"""
    own_seen_turns: Array
    """(n, 3, 3) rad^2, covariance of the perceived rotation"""
    probability: Array
    """(n,) 1, that objects were in this circumstance, before the truth is known"""
    otherwise: Array
    """(n,) nats, log density of the truth if they were not"""
    episode: NDArray[np.int64]
    """(n,) number of the episode"""

    def of(self, chosen: NDArray[np.int64]) -> Errors:
        """Those of these indexes."""
        return Errors(*(getattr(self, name)[chosen] for name in self.__dataclass_fields__))


def errors_of(
    episodes: Iterable[tuple[Sequence[Recorded], WeightedWorlds]], known: Mapping[str, PlaceNoise]
) -> dict[str, Errors]:
    """The errors of recorded moments by circumstance; each episode with worlds that have seen nothing yet.

    By the noise that is `known`, what is seen displaced may be in another circumstance: a camera moved, or the thing.
    """
    found: dict[str, list[_Row]] = defaultdict(list)
    others: dict[tuple[str, str], dict[int, _Row]] = defaultdict(dict)
    for number, (moments, worlds) in enumerate(episodes):
        for moment in moments:
            worlds.update(moment.evidence)
            for name, truth in moment.truth.items():
                thing = moment.evidence.objects.get(name)
                followed = None if thing is None else worlds.followed(name)
                if thing is None or followed is None:
                    continue
                is_tagged, rows = name in moment.tagged, found[followed.circumstance]
                if followed.stays is not None:
                    other = otherwise(followed, thing)
                    pair = followed.circumstance, other.circumstance
                    others[pair][len(rows)] = _row(other, truth, number, is_tagged=is_tagged)
                rows.append(_row(followed, truth, number, is_tagged=is_tagged))
    errors = {key: _errors(rows) for key, rows in found.items()}
    for (circumstance, instead), told in others.items():
        densities = _densities(_errors(list(told.values())), known[instead], _logit(DOUBT))
        errors[circumstance].otherwise[list(told)] = densities
    return errors


def _row(followed: Followed, truth: Pose, episode: int, *, is_tagged: bool) -> _Row:
    """The values of one moment, in the order of `Errors`; that it is otherwise explains nothing."""
    pose = followed.pose
    own = (_NONE, _NONE) if pose.cov is None else pose.parent_covariances()
    return (
        *own, followed.age, followed.moved, followed.velocity, followed.reach, np.subtract(truth.t, pose.t),
        _turn(pose, truth) if is_tagged else _UNKNOWN, *_seen(followed, truth, is_tagged=is_tagged),
        followed.probability, -np.inf, episode,
    )  # fmt: skip


def _errors(rows: Sequence[_Row]) -> Errors:
    return Errors(*map(np.array, zip(*rows, strict=True)))


def _seen(followed: Followed, truth: Pose, *, is_tagged: bool) -> tuple[Array, Array, Array, Array]:
    """Of the perceived place: shift (3,) m and covariance (3, 3), and turn (3,) rad to the truth and covariance."""
    seen = followed.seen
    if seen is None:
        return _UNKNOWN, _NONE, _UNKNOWN, _NONE
    place, turn = seen.parent_covariances()
    return np.subtract(seen.t, followed.pose.t), place, _turn(seen, truth) if is_tagged else _UNKNOWN, turn


def _turn(said: Pose, truth: Pose) -> Array:
    """(3,) rad, rotation vector in the world frame from what is said to the truth."""
    return np.array(quaternions.to_rotvec(quaternions.product(truth.q, quaternions.conjugate(said.q))))


_NONE = np.zeros((3, 3))
_UNKNOWN = np.full(3, np.nan)


def learn_noise(errors: Errors, start: PlaceNoise = START, *, is_in_view: bool = True) -> PlaceNoise:
    """The noise under which the true places and rotations are most probable, drawn to `start` where little is known.

    What is not in view may be elsewhere, which alternatives tell of: how often that is so is learned beside the noise.
    """
    if len(errors.age) < _FEWEST:
        return start
    first = np.append(_to_vector(start), _logit(DOUBT if is_in_view else _ASTRAY))

    weight = min(len(errors.age) / _MOMENTS, _INDEPENDENT * len(set(errors.episode.tolist())))

    def cost(vector: Array) -> float:
        likelihood = weight * float(np.mean(log_densities(errors, _to_noise(vector[:-1]), vector[-1])))
        return 0.5 * float(np.sum(((vector - first) / _PRIOR) ** 2)) - likelihood

    astray = (_logit(DOUBT), _logit(DOUBT) if is_in_view else 0.0)
    bounds = [*(_bounds_of(name) for name in PlaceNoise.__struct_fields__), astray]
    found = minimize(cost, first, method="L-BFGS-B", bounds=bounds, options={"maxiter": 60})
    return _to_noise(found.x[:-1])


def log_densities(errors: Errors, noise: PlaceNoise, astray: float) -> Array:
    """(n,) nats, of true places (per m^3), and of rotations (per rad^3) where these are known.

    `astray` is the logit of the probability of something else than the simulation has: alternatives tell of it.
    """
    with np.errstate(divide="ignore"):  # of what is sure
        so, not_so = np.log(errors.probability), np.log1p(-errors.probability)
    return np.asarray(np.logaddexp(so + _densities(errors, noise, astray), not_so + errors.otherwise))


def _densities(errors: Errors, noise: PlaceNoise, astray: float) -> Array:
    """As `log_densities`, if objects were in this circumstance."""
    known = np.isfinite(errors.turns[:, 0])
    covariance = position_covariance(
        noise, errors.own_places, errors.age, errors.moved, errors.velocity, errors.reach
    )
    turning = rotation_covariance(noise, errors.own_turns, errors.moved)
    distances, scale = _fit(errors.places, covariance, errors.turns, turning)
    levels = [
        np.log(share) - 0.5 * (distances / factor**2 + scale) - np.where(known, 6.0, 3.0) * np.log(factor)
        for share, factor in zip(*levels_of_wrong(noise), strict=True)
    ]
    odds, perceived = _perceived(errors, noise, covariance)
    simulated = np.logaddexp.reduce(levels) - np.log1p(odds)
    indifferent = -np.log(VOLUME) - np.where(known, np.log(8 * np.pi**2), 0.0) + astray
    return np.asarray(np.logaddexp.reduce((simulated, perceived - np.log1p(1.0 / odds), indifferent)))


def _perceived(errors: Errors, noise: PlaceNoise, simulated: Array) -> tuple[Array, Array]:
    """(n,) odds of being where percepts have objects, and (n,) nats of the truth if that is so.

    `simulated` has the covariances (n, 3, 3) m^2 of the simulated places.
    """
    recognised = np.isfinite(errors.seen[:, 0])
    shift = np.nan_to_num(errors.seen)
    own = percept_covariance(noise, errors.own_seen, errors.velocity)
    grain = _GRAIN**2 * np.eye(3)
    odds = np.where(recognised, odds_of_percepts(noise, squared_distance(shift, own + simulated + grain)), _NEVER)
    distances, scale = _fit(errors.places - shift, own, errors.seen_turns, errors.own_seen_turns)
    return odds, -0.5 * (distances + scale)


def _fit(places: Array, covariances: Array, turns: Array, turning: Array) -> tuple[Array, Array]:
    """(n,) squared Mahalanobis distances of errors, and (n,) logarithms of what scales their densities.

    Args:
        places: (n, 3) m.
        covariances: (n, 3, 3) m^2.
        turns: (n, 3) rad; nan where it is not known.
        turning: (n, 3, 3) rad^2.
    """
    known = np.isfinite(turns[:, 0])
    covariances, turning = covariances + _GRAIN**2 * np.eye(3), turning + _GRAIN_TURN**2 * np.eye(3)
    distances = squared_distance(places, covariances)
    distances = distances + np.where(known, squared_distance(np.nan_to_num(turns), turning), 0.0)
    _, scale = np.linalg.slogdet(covariances)
    _, turned_scale = np.linalg.slogdet(turning)
    logarithms = scale + np.where(known, turned_scale, 0.0) + np.where(known, 6.0, 3.0) * np.log(2.0 * np.pi)
    return distances, logarithms


_NEVER = 1e-12  # odds of what is not so, of which a logarithm is taken


_ASTRAY = 0.02  # 1, where the search for the probability of something else begins
_GRAIN, _GRAIN_TURN = 1e-4, 1e-3  # m and rad, grain of the truth (benchmarks.honesty.statement)


def _to_vector(noise: PlaceNoise) -> Array:
    values = msgspec.structs.asdict(noise)
    return np.array([_logit(value) if name in _SHARES else np.log(value) for name, value in values.items()])


def _to_noise(vector: Array) -> PlaceNoise:
    names = PlaceNoise.__struct_fields__
    values = {
        name: float(1.0 / (1.0 + np.exp(-value))) if name in _SHARES else float(np.exp(value))
        for name, value in zip(names, vector, strict=True)
    }
    return PlaceNoise(**values)


_WIDEST = 12.0  # 1, factor of a wide world at most: what is further off is told of by alternatives


def _bounds_of(name: str) -> tuple[float, float]:
    """Of a logarithm or logit. No turn is known better than its grain; a wide world is twice as wide at least.

    Places are known to the gap between bodies at best: beside that, percepts tell their noise themselves.
    """
    least = {"level": GAP, "height": GAP, "turn": 2 * _GRAIN_TURN, "wide": 2.0}.get(name)
    return (-12.0 if least is None else float(np.log(least)), float(np.log(_WIDEST)))


def _logit(share: float) -> float:
    return float(np.log(share / (1.0 - share)))
