"""How a thing nobody knew of can have come to where it is first seen: histories that nothing contradicts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.adept.unseen.ghosts import States
from benchmarks.adept.unseen.motions import HORIZONTAL, TOUCH, Components
from benchmarks.adept.unseen.rates import EventRates
from benchmarks.adept.unseen.sight import CameraSight, matrices
from dsr.math3d.quaternions import Quaternion, Vector3

Array = NDArray[np.float64]

_DRAWN = 64  # histories with each number of events
_LEAST_CHANCE = 1e-9  # probability of a history, below which it does not count


class Trail(NamedTuple):
    """The best guess of where a known thing was, at the times of the remembered views."""

    size: Vector3
    places: Sequence[Array | None]
    """Of each view (3,) m; None while it was not there"""


class LookedAt(NamedTuple):
    """What was looked at before now, oldest first."""

    times: Sequence[float]
    """s"""
    sights: Sequence[CameraSight]


def stranger(
    size: Vector3,
    place: Array,
    rotation: Quaternion,
    now: float,
    memory: LookedAt,
    trails: Sequence[Trail],
    prior: EventRates,
    columns: int,
    seed: int,
) -> tuple[Components, float]:
    """The components of a thing that is recognised for the first time.

    Returns:
        The components, and the logarithm (nats) of the probability that such a thing comes to be seen there now.
    """
    random = np.random.default_rng(seed)
    velocities, owners, paths, chances = _histories(place, now, memory, prior, random)
    masses = np.bincount(
        owners, prior.strangers * chances * _possible(size, rotation, paths, memory, trails, prior), len(velocities)
    )
    seconds = now - memory.times[0] if memory.times else 0.0
    weights = masses + prior.wonder_rate * max(seconds, 1.0) / len(masses)
    kept = weights > _LEAST_CHANCE * weights.sum()
    mass = np.log(weights[kept])
    total = float(np.logaddexp.reduce(mass))
    return _components(place, rotation, velocities[kept], mass, total, prior, columns), total


def _components(
    place: Array, rotation: Quaternion, velocities: Array, mass: Array, total: float, prior: EventRates, columns: int
) -> Components:
    count = len(mass)
    noise = prior.resolution**2
    spread = np.tile([noise, 0.0, (0.3 * prior.push_speed) ** 2], (count, 1))
    spread[(velocities == 0.0).all(axis=1), 2] = 0.0
    masses = np.tile(mass[:, None], (1, columns))
    masses[:, 0] -= total
    states = States(np.tile(place, (count, 1)), np.tile(rotation, (count, 1)), velocities, np.zeros((count, 3)))
    return Components(states, spread, np.zeros(count), masses, np.full(columns, -1e3))


def _histories(
    place: Array, now: float, memory: LookedAt, prior: EventRates, random: np.random.Generator
) -> tuple[Array, NDArray[np.int64], Array, Array]:
    """Ways in which a thing may have come to a place (3,).

    Returns:
        Velocities (v, 3) that it may have now; of each history (n,) the index of its velocity, where it was at the
        times of the views (n, times, 3), and how probable that is before anything is seen. Half of the strangers rest.
    """
    ago = now - np.array(memory.times, dtype=np.float64)
    seconds = float(ago.max(initial=0.0))
    expected = prior.push_rate * seconds
    speeds = random.normal(0.0, prior.push_speed, (_DRAWN, len(HORIZONTAL))) * HORIZONTAL
    pushed = random.random((_DRAWN, 1)) * seconds
    left, stopped = np.sort(random.random((2, _DRAWN, 1)) * seconds, axis=0)[::-1]
    each, nobody = np.arange(_DRAWN), math.exp(-expected)
    kinds = (
        (np.zeros(1, np.int64), np.zeros((1, len(ago))), np.zeros((1, 3)), 1.0),  # rested all along
        (each + 1, np.tile(ago, (_DRAWN, 1)), speeds, 1.0),  # moved all along
        (each + 1, np.minimum(ago, pushed), speeds, expected),  # rested, and was pushed
        (0 * each, np.clip(ago - stopped, 0.0, left - stopped), speeds, 0.5 * expected**2 * prior.stops),  # and stopped
    )
    paths = [place - moving[..., None] * speed[:, None] for _, moving, speed, _ in kinds]
    chances = [np.full(len(owner), 0.5 * nobody * chance) for owner, _, _, chance in kinds]
    chances[-1] /= _DRAWN
    velocities = np.concatenate([np.zeros((1, 3)), speeds])
    return velocities, np.concatenate([kind[0] for kind in kinds]), np.concatenate(paths), np.concatenate(chances)


def _possible(
    size: Vector3, rotation: Quaternion, paths: Array, memory: LookedAt, trails: Sequence[Trail], prior: EventRates
) -> Array:
    """(n,) probability that nothing of paths (n, times, 3) was seen, and that nothing else was in the same place."""
    turned = np.tile(matrices([rotation]), (len(paths), 1, 1))
    most = np.zeros(len(paths))
    log = np.zeros(len(paths))
    for index, sight in enumerate(memory.sights):
        share = sight.shares("", size, paths[:, index], turned)
        log += ((share >= prior.seen_at) & (most >= prior.seen_at)) * math.log(prior.missed)
        most = np.maximum(most, share)
        for trail in trails:
            if (other := trail.places[index]) is not None:
                room = TOUCH * 0.5 * (np.array(size) + np.array(trail.size))
                log += (np.abs(paths[:, index] - other) < room).all(axis=1) * math.log(prior.wonder_rate)
    known = np.clip((most - prior.seen_from) / (prior.seen_at - prior.seen_from), 0.0, 1.0)
    return np.asarray(np.exp(log) * np.maximum(1.0 - known, prior.missed))
