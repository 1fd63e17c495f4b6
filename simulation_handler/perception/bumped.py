"""How probable it is that a camera moved, and that each thing is where it was, by how all that it shows is displaced.

A camera that moved displaces all that it shows by one motion. A thing that somebody moved is displaced by itself. Each
thing may have moved or not, and so may the camera. What is displaced alike is likelier to be the camera's doing, the
more things and the more numbers of each agree beyond what one motion of the camera takes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dsr.math3d.quaternions import Vector3
from dsr.perception.scales import BUMP
from dsr.vocabulary import nats
from simulation_handler.scales import TURN_FLOOR

Array = NDArray[np.float64]


class Displacement(NamedTuple):
    """How far a thing is seen from where it is believed to be."""

    shift: Array
    """(3,) m, world"""
    place: Array
    """(3, 3) m^2, covariance of that if nothing moved: of what is seen and of what is believed"""
    turn: Array | None
    """(3,) rad, world, rotation vector; None if what is seen does not tell it"""
    turning: Array
    """(3, 3) rad^2, covariance of that"""
    from_camera: Vector3
    """(3,) m, world, from the camera to where the thing is believed to be"""


class MovedThing(NamedTuple):
    """How far a thing gets that somebody moves."""

    sideways: float
    """m, standard deviation in each horizontal direction"""
    height: float
    """m, standard deviation in height of what rests on the same again"""


class WhoMoved(NamedTuple):
    """What displacements tell."""

    camera_moved: float
    """1, probability that the camera moved"""
    stays: Array
    """(n,) 1, probability of each thing that it is where it is believed to be"""
    shown_elsewhere: Array
    """(n,) 1, probability of each thing that this is so, and that the camera moved"""


def judge(things: Sequence[Displacement], loads: Sequence[Displacement], moved: MovedThing) -> WhoMoved:
    """What the displacements of things tell of the camera, and of each of them and of their loads, in this order.

    What goes along with another thing tells nothing by itself: `loads` are asked about, and do not count.

    Args:
        things: those that move by themselves; at least one.
        loads: others.
        moved: how far things get.
    """
    told = _Told.of([*things, *loads], moved)
    count = len(things)
    own = told.first(count)
    standing = np.logaddexp(own.if_moved, own.if_still)
    stands = math.log1p(-math.exp(-nats.CAMERA_MOVED)) + float(standing.sum())
    sets, scores = _likeliest_sets(own)
    every = float(np.logaddexp.reduce(scores))
    camera = float(_probability(every - nats.CAMERA_MOVED - stands))
    shares = np.exp(scores - every)
    own_with_camera = np.minimum(shares @ sets, 1.0)  # rounding makes more of it
    with_camera = np.concatenate([own_with_camera, told.stays_with_camera(sets[int(np.argmax(scores))], count)])
    without = _probability(told.if_still - told.if_moved)
    shown_elsewhere = camera * with_camera
    return WhoMoved(camera, shown_elsewhere + (1.0 - camera) * without, shown_elsewhere)


class _Told(NamedTuple):
    """What n things tell, in nats and as information about the motion of the camera: a shift and a turn about it."""

    if_moved: Array
    """(n,) nats, log density of the displacement if somebody moved the thing"""
    if_still: Array
    """(n,) nats, of a thing that is where it was, seen by a camera that stands"""
    information: Array
    """(n, 6, 6)"""
    weighed: Array
    """(n, 6): the information times the motion that would explain the displacement"""

    @staticmethod
    def of(things: Sequence[Displacement], moved: MovedThing) -> _Told:
        """What displacements tell, worked out of all at once."""
        shifts, places = np.array([one.shift for one in things]), np.array([one.place for one in things])
        tells = np.array([one.turn is not None for one in things])
        turns = np.array([_NO_TURN if one.turn is None else one.turn for one in things])
        turnings = np.where(tells[:, None, None], [one.turning for one in things], np.eye(3))
        sideways, height = moved.sideways**2, moved.height**2
        still, on_level, anyhow = (
            _log_densities(shifts, places + by_shift) + tells * _log_densities(turns, turnings + by_turn)
            for by_shift, by_turn in (
                (0.0, 0.0), (np.diag((sideways, sideways, height)), _UPRIGHT), (sideways * np.eye(3), np.eye(3)),
            )
        )  # fmt: skip
        motions = _shifts_by_motion(np.array([one.from_camera for one in things]))
        weighing = np.linalg.solve(places, motions)
        information, weighed = motions.mT @ weighing, (weighing.mT @ shifts[..., None])[..., 0]
        known = tells[:, None, None] * np.linalg.inv(turnings)
        information[:, 3:, 3:] += known
        weighed[:, 3:] += (known @ turns[..., None])[..., 0]
        some = np.logaddexp(_SELDOM + anyhow, math.log1p(-math.exp(_SELDOM)) + on_level)
        return _Told(some - nats.MOVED, still + math.log1p(-math.exp(-nats.MOVED)), information, weighed)

    def first(self, count: int) -> _Told:
        """That of so many things."""
        return _Told(*(column[:count] for column in self))

    def scores(self, sets: Array) -> Array:
        """(k,) nats of sets (k, n) of things, 1 for those that are where they were while the camera moved."""
        information, weighed = self._of(sets)
        _, scale = np.linalg.slogdet(information)
        fit = (weighed * np.linalg.solve(information, weighed[..., None])[..., 0]).sum(axis=-1)
        explained = 0.5 * (fit - scale - 2.0 * len(_PRIOR) * math.log(BUMP))
        return np.asarray(sets @ self.if_still + (1.0 - sets) @ self.if_moved + explained)

    def _of(self, sets: Array) -> tuple[Array, Array]:
        """Information (k, 6, 6) about the motion of the camera by sets (k, n) of things, and (k, 6) that times it."""
        told = sets @ self.information.reshape(len(self.information), -1)
        return _PRIOR + told.reshape(-1, *_PRIOR.shape), sets @ self.weighed

    def stays_with_camera(self, chosen: Array, count: int) -> Array:
        """(m,) probabilities that things after the first `count` are where they were, if these and the camera moved.

        `chosen` (count,) has 1 for those of the first that are where they were.
        """
        others = len(self.if_moved) - count
        sets = np.hstack([np.tile(chosen, (others, 1)), np.eye(others)])
        before = np.hstack([np.tile(chosen, (others, 1)), np.zeros((others, others))])
        return _probability(self.scores(sets) - self.scores(before))


def _shifts_by_motion(from_camera: Array) -> Array:
    """(n, 3, 6) how things at (n, 3) m from the camera are shifted by its shift, and by its turn."""
    (right, back, up), zero = from_camera.T, np.zeros(len(from_camera))
    levers = np.moveaxis(np.array([[zero, up, -back], [-up, zero, right], [back, -right, zero]]), 2, 0)
    return np.concatenate([np.broadcast_to(np.eye(3), levers.shape), levers], axis=2)


def _likeliest_sets(told: _Told) -> tuple[Array, Array]:
    """(k, n) the likeliest sets of things that are where they were while the camera moved, and all next; (k,) scores.

    Found from all things, and from those that are seen displaced, by changing one thing at a time, or by adding at once
    all that each alone make a set likelier: of many things, one at a time would take as many looks.
    """
    count = len(told.if_moved)
    found: dict[bytes, tuple[Array, float]] = {}
    for start in (np.ones(count), (told.if_moved > told.if_still).astype(float)):
        chosen, best = start, float(told.scores(start[None])[0])
        found[start.tobytes()] = start, best
        while True:
            near = np.abs(chosen - np.eye(count))
            scores = told.scores(near)
            found |= {one.tobytes(): (one, score) for one, score in zip(near, scores.tolist(), strict=True)}
            if scores.max() <= best:
                break
            ways = np.array([near[int(np.argmax(scores))], np.maximum(chosen, scores > best)])
            reached = told.scores(ways)
            chosen, best = ways[int(np.argmax(reached))], float(reached.max())
            found[chosen.tobytes()] = chosen, best
    found.pop(np.zeros(count).tobytes(), None)
    sets, every = zip(*found.values(), strict=True)
    return np.array(sets), np.array(every)


def _probability(odds: Array | float) -> Array:
    """Probabilities by the logarithms of their odds."""
    return np.asarray(0.5 + 0.5 * np.tanh(0.5 * np.asarray(odds)))


def _log_densities(offsets: Array, covariances: Array) -> Array:
    """(n,) nats, of Gaussians around 0 at offsets (n, 3)."""
    _, scales = np.linalg.slogdet(2.0 * math.pi * covariances)
    solved = np.linalg.solve(covariances, offsets[..., None])[..., 0]
    return np.asarray(-0.5 * ((offsets * solved).sum(axis=1) + scales))


_NO_TURN = np.zeros(3)
_PRIOR = np.eye(6) / BUMP**2
_UPRIGHT = np.diag((TURN_FLOOR**2, TURN_FLOOR**2, 1.0))
"""rad^2, of a thing that stands again, turned about the vertical anyhow"""
_SELDOM = -nats.RARE
"""nats, log probability that what somebody moves gets on something else, or falls"""
