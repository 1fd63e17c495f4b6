"""Where a thing lies that something unknown moved: at places about where it was, each of which is missed by itself."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dsr.believing.absence import Absence, missed_after
from dsr.math3d.quaternions import Vector3
from simulation_handler.explaining.glimpses import DRAW_COUNT
from simulation_handler.scales import PLACE_FLOOR, ROUNDING
from simulation_handler.shapes.geometry import Solid
from simulation_handler.state.bodies import FLOOR
from simulation_handler.worlds.carriers import Carriers

Array = NDArray[np.float64]

LOOKED_AT = 4
"""Places that cameras are asked about in each direction of the level; so many of them at once, in turn"""
_FINER = DRAW_COUNT // LOOKED_AT  # places in each direction that each of these stands for, odd: it is the middle one
_COUNT = LOOKED_AT * _FINER
_QUANTILES = np.array([NormalDist().inv_cdf((k + 0.5) / _COUNT) for k in range(_COUNT)])
_OFFSETS = np.array([(x, y) for x in _QUANTILES for y in _QUANTILES])  # 1, standard deviations; each as probable
_WITHIN = 1.0 - float(np.mean(_QUANTILES**2))  # 1, variance within the part of the distribution of one quantile
_ROWS = np.arange(_COUNT) // _FINER
_GROUP = (_ROWS[:, None] * LOOKED_AT + _ROWS).ravel()  # (n,) number of the place that stands for each
_MIDDLE = np.arange(_COUNT)[_FINER // 2 :: _FINER]
_STANDS = (_MIDDLE[:, None] * _COUNT + _MIDDLE).ravel()  # (LOOKED_AT^2,) numbers of those places


class PossiblePlaces(NamedTuple):
    """Where a thing may lie that somebody moved, one place for each of the offsets."""

    positions: Array
    """(n, 3) m, world: of its centre"""
    supports: Sequence[str]
    """(n,) names of what carries it there"""


class Area(NamedTuple):
    """The places on one level where a thing may lie."""

    share: float
    """1, probability that it is there"""
    position: Vector3
    """m, world: mean"""
    sideways: Array
    """(2, 2) m^2, world: covariance on the level"""
    support: str
    """Name of what carries it there; empty if that is the floor, not known, or one of several things"""


class HiddenPlaces:
    """Places about where a thing was, each with the probability that the thing is there.

    They begin as probable as the way to them. Where cameras should see the thing and do not, they get less probable.

    Args:
        since: s, from when on the thing may be there.
    """

    def __init__(self, since: float) -> None:
        self._shares = np.full(len(_STANDS), 1.0 / len(_STANDS))
        self._missed = np.zeros(len(_STANDS))
        self._empty = np.zeros(len(_STANDS))  # as `_missed`, if the thing was here from the beginning
        self._looked = np.full(len(_STANDS), since)
        self._turn = 0
        self._joining = 0.0  # 1, share of what has come since cameras looked last
        self.reach = 0.0
        """m, standard deviation in each direction by which the places are broader than learned"""

    @property
    def hidden(self) -> float:
        """1, how probable it is that cameras, which have looked so far, do not show the thing if it always was here."""
        return float(np.exp(-self._empty).mean())

    def join(self, ratio: float) -> None:
        """Let the thing come to these places just now, with a `ratio` (1) of the probability that it is here then.

        What comes has not been missed here yet.
        """
        self._joining += (1.0 - self._joining) * ratio

    def join_before(self, ratio: float) -> None:
        """As `join`, of what came before cameras began to look: it was missed ever since."""
        self._settle()
        new = np.exp(-self._empty)
        self._mix(ratio, new / new.sum(), self._empty)

    def _settle(self) -> None:
        """Take in what has come since cameras looked last: together, that is the same as bit by bit."""
        if self._joining > 0.0:
            self._mix(self._joining, np.full(len(_STANDS), 1.0 / len(_STANDS)), np.zeros(len(_STANDS)))
            self._joining = 0.0

    def _mix(self, ratio: float, shares: Array, missed: Array) -> None:
        old, new = (1.0 - ratio) * self._shares, ratio * shares
        self._shares = old + new
        self._missed = np.log((old * np.exp(self._missed) + new * np.exp(missed)) / self._shares)

    def asked(self) -> NDArray[np.intp]:
        """(LOOKED_AT,) numbers of the places, of `places_about`, that cameras are asked about next."""
        return np.asarray(_STANDS[self._next()])

    def _next(self) -> NDArray[np.intp]:
        return (self._turn + np.arange(LOOKED_AT)) % len(_STANDS)

    def pass_over(self, step: float) -> None:
        """Let `step` s not count, in which cameras did not look."""
        self._looked += step

    def miss(self, shares: Sequence[float], now: float, absence: Absence) -> float:
        """Take in at `now` (s) that the thing is not seen.

        Args:
            shares: (LOOKED_AT,) of the places `asked` about, how much cameras should see there (1).
            now: s
            absence: what that tells.

        Returns:
            The probability that it is not seen.
        """
        self._settle()
        for number, share in zip(self._next().tolist(), shares, strict=True):
            step = max(now - float(self._looked[number]), 0.0)
            missed = missed_after(float(self._missed[number]), share, step, absence)
            self._shares[number] *= math.exp(self._missed[number] - missed)
            self._empty[number] = missed_after(float(self._empty[number]), share, step, absence)
            self._missed[number], self._looked[number] = missed, now
        self._turn = (self._turn + LOOKED_AT) % len(_STANDS)
        unseen = float(self._shares.sum())
        self._shares /= unseen
        return unseen

    def areas(self, places: PossiblePlaces, deviation: float) -> list[Area]:
        """The places level by level, the most probable first.

        Args:
            places: all of `places_about`.
            deviation: m, theirs in each direction.
        """
        self._settle()
        shares = self._shares[_GROUP] / _FINER**2
        levels, of = np.unique(np.rint(places.positions[:, 2] / PLACE_FLOOR), return_inverse=True)
        found = []
        for level in range(len(levels)):
            on_level = of == level
            supports = {places.supports[number] for number in np.flatnonzero(on_level).tolist()}
            support = supports.pop() if len(supports) == 1 else FLOOR
            found.append(_area(shares[on_level], places.positions[on_level], deviation, support))
        return sorted((area for area in found if area.share > ROUNDING), key=lambda area: -area.share)


def _area(shares: Array, positions: Array, deviation: float, support: str) -> Area:
    share = float(shares.sum())
    weights = shares / max(share, ROUNDING)
    x, y, z = (weights @ positions).tolist()
    offsets = positions[:, :2] - (x, y)
    sideways = (weights[:, None] * offsets).T @ offsets + _WITHIN * deviation**2 * np.eye(2)
    return Area(share, (x, y, z), sideways, "" if support == FLOOR else support)


def places_about(
    solid: Solid, deviation: float, carriers: Carriers, without: Collection[str] = (),
    numbers: NDArray[np.intp] | None = None,
) -> PossiblePlaces:  # fmt: skip
    """Where a solid may lie that somebody moved, no one knows where to.

    Args:
        solid: at the mean of its places, where it lay or was held.
        deviation: m, standard deviation of its place in each direction of the level.
        carriers: all that it may lie on.
        without: names of what does not carry it.
        numbers: (n,) of the places that are asked for; None: all.
    """
    flat, _ = solid.face_down()
    offsets = _OFFSETS if numbers is None else _OFFSETS[numbers]
    places = np.array(flat.position[:2]) + deviation * offsets
    lying = carriers.lying(flat, places, without)
    supports = [carriers.names[number] for number in lying.carriers.tolist()]
    return PossiblePlaces(np.column_stack((places, lying.heights)), supports)
