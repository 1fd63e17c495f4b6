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
    is_disturbed: bool = False
    """Whether a hand is within reach of it, or what stood beside it is missing

    A hand often moves a thing, and lifts it as often as not. So does a thing fall that has lost what it leaned on.
    """
    by_way: float = 0.0
    """nats by which it rather is seen to have got there bit by bit than at once"""


class MovedThing(NamedTuple):
    """How far a thing gets that somebody moves. As probable as that it is turned on the way is that it is not."""

    sideways: float
    """m, standard deviation in each horizontal direction"""
    height: float
    """m, standard deviation in height of what rests on the same again"""

    @property
    def on_level(self) -> Array:
        """(3, 3) m^2, covariance of the shift of what rests on the same again"""
        return np.diag((self.sideways**2, self.sideways**2, self.height**2))


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
    alone = np.logaddexp(own.if_moved, own.if_still)
    apart, displaced = float(alone.sum()), (own.if_moved > own.if_still).astype(float)
    sets, camera_scores = _likeliest_sets(own.by_camera(), displaced, 1)
    alike, alike_scores = _likeliest_sets(own.moved_alike(alone, moved), displaced, 2)
    alike_scores -= nats.MOVED - nats.MOVED_ALONG  # of one of them: the others go along with it
    every, together = (float(np.logaddexp.reduce(scores, initial=-np.inf)) for scores in (camera_scores, alike_scores))
    stands = math.log1p(-math.exp(-nats.CAMERA_MOVED)) + float(np.logaddexp(apart, together))
    camera = float(_probability(every - nats.CAMERA_MOVED - stands))
    own_with_camera = np.minimum(np.exp(camera_scores - every) @ sets, 1.0)  # rounding makes more of it
    likeliest = sets[int(np.argmax(camera_scores))]
    with_camera = np.concatenate([own_with_camera, told.stays_with_camera(likeliest, count)])
    without = _probability(told.if_still - told.if_moved)
    if len(alike):
        shared = np.minimum(np.exp(alike_scores - together) @ alike, 1.0)
        without[:count] *= 1.0 - _probability(together - apart) * shared
    shown_elsewhere = camera * with_camera
    return WhoMoved(camera, shown_elsewhere + (1.0 - camera) * without, shown_elsewhere)


class _Told(NamedTuple):
    """What n things tell, in nats and as information about one motion of all: a shift and a turn."""

    if_moved: Array
    """(n,) nats, log density of the displacement if somebody moved the thing by itself"""
    if_still: Array
    """(n,) nats, of a thing that is where it was, seen by a camera that stands"""
    from_camera: Array
    """(n, 3) m, of the things"""
    shifts: Array
    """(n, 3) m"""
    places: Array
    """(n, 3, 3) m^2, covariances of these"""
    known: Array
    """(n, 3, 3) 1/rad^2, information about turns; 0 where nothing tells them"""
    turns: Array
    """(n, 3) rad"""
    if_alike: Array
    """(n,) nats, of a thing that moved together with others, if they had not moved"""
    if_shown: Array
    """(n,) nats, of a thing that is where it was, if the camera has not moved: one that moves bit by bit is rare"""

    @staticmethod
    def of(things: Sequence[Displacement], moved: MovedThing) -> _Told:
        """What displacements tell, worked out of all at once."""
        shifts, places = np.array([one.shift for one in things]), np.array([one.place for one in things])
        tells = np.array([one.turn is not None for one in things])
        turns = np.array([_NO_TURN if one.turn is None else one.turn for one in things])
        turnings = np.where(tells[:, None, None], [one.turning for one in things], np.eye(3))
        kept = _log_densities(turns, turnings + TURN_FLOOR**2 * np.eye(3))
        on_turning = (_log_densities(turns, turnings + by_turn) for by_turn in (_UPRIGHT, np.eye(3)))
        turned = (np.logaddexp(kept, one) - math.log(2.0) for one in on_turning)
        still, on_level, anyhow = (
            _log_densities(shifts, places + by_shift) + tells * by_turn
            for by_shift, by_turn in zip(
                (np.zeros((3, 3)), moved.on_level, moved.sideways**2 * np.eye(3)),
                (_log_densities(turns, turnings), *turned),
                strict=True,
            )
        )
        often = np.array([one.is_disturbed for one in things])
        lifted, led = np.where(often, -nats.EXPECTED, _SELDOM), np.where(often, -nats.EXPECTED, -nats.MOVED)
        stays = np.log1p(-np.exp(led))
        some = np.logaddexp(lifted + anyhow, np.log1p(-np.exp(lifted)) + on_level)
        ways = np.array([one.by_way for one in things])
        on_way = np.logaddexp(0.0, ways) - math.log(2.0)
        known = tells[:, None, None] * np.linalg.inv(turnings)
        from_camera = np.array([one.from_camera for one in things])
        return _Told(
            some + led + on_way, still + stays, from_camera, shifts, places, known, turns,
            still + on_way - nats.MOVED_ALONG, still + stays + np.logaddexp(0.0, ways - nats.RARE),
        )  # fmt: skip

    def first(self, count: int) -> _Told:
        """That of so many things."""
        return _Told(*(column[:count] for column in self))

    def by_camera(self) -> _OneMotion:
        """The camera moved, and some things are where they were."""
        return self._moved_by(np.eye(6) * BUMP**2, self.from_camera, self.if_shown, self.if_moved)

    def moved_alike(self, alone: Array, moved: MovedThing) -> _OneMotion:
        """Somebody moved some things by one motion on the level, about their middle; the others are (n,) `alone`."""
        prior = np.zeros((6, 6))
        prior[:3, :3], prior[3:, 3:] = moved.on_level, _UPRIGHT
        return self._moved_by(prior, self.from_camera - self.from_camera.mean(axis=0), self.if_alike, alone)

    def _moved_by(self, prior: Array, levers: Array, within: Array, alone: Array) -> _OneMotion:
        """All by a motion of covariance `prior` (6, 6), at `levers` (n, 3) m from where that turns about."""
        motions = _shifts_by_motion(levers)
        weighing = np.linalg.solve(self.places, motions)
        information, weighed = motions.mT @ weighing, (weighing.mT @ self.shifts[..., None])[..., 0]
        information[:, 3:, 3:] += self.known
        weighed[:, 3:] += (self.known @ self.turns[..., None])[..., 0]
        return _OneMotion(within, alone, information, weighed, np.asarray(np.linalg.inv(prior)))

    def stays_with_camera(self, chosen: Array, count: int) -> Array:
        """(m,) probabilities that things after the first `count` are where they were, if these and the camera moved.

        `chosen` (count,) has 1 for those of the first that are where they were.
        """
        others, by_camera = len(self.if_moved) - count, self.by_camera()
        sets = np.hstack([np.tile(chosen, (others, 1)), np.eye(others)])
        before = np.hstack([np.tile(chosen, (others, 1)), np.zeros((others, others))])
        return _probability(by_camera.scores(sets) - by_camera.scores(before))


class _OneMotion(NamedTuple):
    """How well one motion, of the camera or of things, explains the displacements of some things."""

    within: Array
    """(n,) nats, of a thing that goes by this motion, if it were none"""
    alone: Array
    """(n,) nats, of a thing that does not"""
    information: Array
    """(n, 6, 6) about the motion"""
    weighed: Array
    """(n, 6): the information times the motion that would explain the displacement"""
    prior: Array
    """(6, 6) information about the motion beforehand"""

    def scores(self, sets: Array) -> Array:
        """(k,) nats of sets (k, n) of things, 1 for those that go by this motion."""
        told = sets @ self.information.reshape(len(self.information), -1)
        information, weighed = self.prior + told.reshape(-1, *self.prior.shape), sets @ self.weighed
        _, scale = np.linalg.slogdet(information)
        fit = (weighed * np.linalg.solve(information, weighed[..., None])[..., 0]).sum(axis=-1)
        explained = 0.5 * (fit - scale + np.linalg.slogdet(self.prior)[1])
        return np.asarray(sets @ self.within + (1.0 - sets) @ self.alone + explained)


def _shifts_by_motion(from_camera: Array) -> Array:
    """(n, 3, 6) how things at (n, 3) m from the camera are shifted by its shift, and by its turn."""
    (right, back, up), zero = from_camera.T, np.zeros(len(from_camera))
    levers = np.moveaxis(np.array([[zero, up, -back], [-up, zero, right], [back, -right, zero]]), 2, 0)
    return np.concatenate([np.broadcast_to(np.eye(3), levers.shape), levers], axis=2)


def _likeliest_sets(motion: _OneMotion, displaced: Array, fewest: int) -> tuple[Array, Array]:
    """(k, n) the likeliest sets of `fewest` things that go by one motion, or more, and all next; (k,) their scores.

    Found from all things, and from those that are seen `displaced` (n,), by changing one thing at a time, or by adding
    or leaving out at once all that each alone make a set likelier: one at a time would take as many looks as things.
    """
    count = len(displaced)
    found: dict[bytes, tuple[Array, float]] = {}
    for start in (np.ones(count), displaced):
        chosen, best = start, float(motion.scores(start[None])[0])
        found[start.tobytes()] = start, best
        while True:
            near = np.abs(chosen - np.eye(count))
            scores = motion.scores(near)
            found |= {one.tobytes(): (one, score) for one, score in zip(near, scores.tolist(), strict=True)}
            if scores.max() <= best:
                break
            helps = (scores > best).astype(float)
            ways = np.array([near[int(np.argmax(scores))], np.maximum(chosen, helps), np.minimum(chosen, 1.0 - helps)])
            reached = motion.scores(ways)
            chosen, best = ways[int(np.argmax(reached))], float(reached.max())
            found[chosen.tobytes()] = chosen, best
    enough = [one for one in found.values() if one[0].sum() >= fewest]
    return np.array([one for one, _ in enough]).reshape(-1, count), np.array([score for _, score in enough])


def _probability(odds: Array | float) -> Array:
    """Probabilities by the logarithms of their odds."""
    return np.asarray(0.5 + 0.5 * np.tanh(0.5 * np.asarray(odds)))


def _log_densities(offsets: Array, covariances: Array) -> Array:
    """(n,) nats, of Gaussians around 0 at offsets (n, 3)."""
    _, scales = np.linalg.slogdet(2.0 * math.pi * covariances)
    solved = np.linalg.solve(covariances, offsets[..., None])[..., 0]
    return np.asarray(-0.5 * ((offsets * solved).sum(axis=1) + scales))


_NO_TURN = np.zeros(3)
_UPRIGHT = np.diag((TURN_FLOOR**2, TURN_FLOOR**2, 1.0))
"""rad^2, of a thing that stands again, turned about the vertical anyhow"""
_SELDOM = -nats.RARE
"""nats, log probability that what somebody moves gets on something else, or falls"""
