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
    sets = _likeliest_sets(own)
    scores = own.scores(sets)
    best = float(np.logaddexp.reduce(scores))
    camera = float(_probability(best - nats.CAMERA_MOVED - stands))
    shares = np.exp(scores - best)
    with_camera = np.concatenate([shares @ sets, told.stays_with_camera(sets[int(np.argmax(scores))], count)])
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
        """What displacements tell."""
        rows = [_told_by(thing, moved) for thing in things]
        return _Told(*(np.array(column) for column in zip(*rows, strict=True)))

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
        return _PRIOR + np.einsum("kn,nij->kij", sets, self.information), sets @ self.weighed

    def stays_with_camera(self, chosen: Array, count: int) -> Array:
        """(m,) probabilities that things after the first `count` are where they were, if these and the camera moved.

        `chosen` (count,) has 1 for those of the first that are where they were.
        """
        others = len(self.if_moved) - count
        sets = np.hstack([np.tile(chosen, (others, 1)), np.eye(others)])
        before = np.hstack([np.tile(chosen, (others, 1)), np.zeros((others, others))])
        return _probability(self.scores(sets) - self.scores(before))


def _told_by(thing: Displacement, moved: MovedThing) -> tuple[float, float, Array, Array]:
    """The row of a thing in `_Told`."""
    right, back, up = thing.from_camera
    lever = np.array([[0.0, up, -back], [-up, 0.0, right], [back, -right, 0.0]])
    motion = np.hstack([np.eye(3), lever])
    sideways, height = moved.sideways**2, moved.height**2
    still = _log_density(thing.shift, thing.place)
    on_level = _log_density(thing.shift, thing.place + np.diag((sideways, sideways, height)))
    anyhow = _log_density(thing.shift, thing.place + sideways * np.eye(3))
    weighing = np.linalg.solve(thing.place, motion)
    information, weighed = motion.T @ weighing, weighing.T @ thing.shift
    if thing.turn is not None:
        still += _log_density(thing.turn, thing.turning)
        on_level += _log_density(thing.turn, thing.turning + _UPRIGHT)
        anyhow += _log_density(thing.turn, thing.turning + np.eye(3))
        known = np.linalg.inv(thing.turning)
        information[3:, 3:] += known
        weighed[3:] += known @ thing.turn
    some = np.logaddexp(_SELDOM + anyhow, math.log1p(-math.exp(_SELDOM)) + on_level)
    return float(some) - nats.MOVED, still + math.log1p(-math.exp(-nats.MOVED)), information, weighed


def _likeliest_sets(told: _Told) -> Array:
    """(k, n) the likeliest sets of things that are where they were while the camera moved, and all next to them.

    Found by changing one thing at a time, from all things, and from those that are seen displaced.
    """
    count = len(told.if_moved)
    found: dict[bytes, Array] = {}
    for start in (np.ones(count), (told.if_moved > told.if_still).astype(float)):
        chosen, best = start, float(told.scores(start[None])[0])
        while True:
            near = np.abs(chosen - np.eye(count))
            found |= {one.tobytes(): one for one in (chosen, *near)}
            scores = told.scores(near)
            if scores.max() <= best:
                break
            chosen, best = near[int(np.argmax(scores))], float(scores.max())
    found.pop(np.zeros(count).tobytes(), None)
    return np.array(list(found.values()))


def _probability(odds: Array | float) -> Array:
    """Probabilities by the logarithms of their odds."""
    return np.asarray(0.5 + 0.5 * np.tanh(0.5 * np.asarray(odds)))


def _log_density(offset: Array, covariance: Array) -> float:
    """nats, of a Gaussian around 0 at an offset (3,)."""
    _, scale = np.linalg.slogdet(2.0 * math.pi * covariance)
    return -0.5 * float(offset @ np.linalg.solve(covariance, offset) + scale)


_PRIOR = np.eye(6) / BUMP**2
_UPRIGHT = np.diag((TURN_FLOOR**2, TURN_FLOOR**2, 1.0))
"""rad^2, of a thing that stands again, turned about the vertical anyhow"""
_SELDOM = -nats.RARE
"""nats, log probability that what somebody moves gets on something else, or falls"""
