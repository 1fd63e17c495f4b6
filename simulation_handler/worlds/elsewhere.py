"""Where a thing lies that something unknown moved: at places about where it was, each of which is missed by itself."""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dsr.believing.absence import Absence, missed_after
from dsr.math3d.quaternions import Vector3
from simulation_handler.scales import ROUNDING
from simulation_handler.shapes.geometry import Solid

Array = NDArray[np.float64]

LOOKED_AT = 4
"""Places that cameras are asked about in each direction of the level; so many of them at once, in turn"""
_FINER = 3  # 1, places in each direction that each of these stands for, odd: it is the middle one
_COUNT = LOOKED_AT * _FINER
_QUANTILES = np.array([NormalDist().inv_cdf((k + 0.5) / _COUNT) for k in range(_COUNT)])
_OFFSETS = np.array([(x, y) for x in _QUANTILES for y in _QUANTILES])  # 1, standard deviations; each as probable
_WITHIN = 1.0 - float(np.mean(_QUANTILES**2))  # 1, variance within the part of the distribution of one quantile
_ROWS = np.arange(_COUNT) // _FINER
_GROUP = (_ROWS[:, None] * LOOKED_AT + _ROWS).ravel()  # (n,) number of the place that stands for each
_MIDDLE = np.arange(_COUNT)[_FINER // 2 :: _FINER]
_STANDS = (_MIDDLE[:, None] * _COUNT + _MIDDLE).ravel()  # (LOOKED_AT^2,) numbers of those places


class Area(NamedTuple):
    """The places on one level where a thing may lie."""

    share: float
    """1, probability that it is there"""
    position: Vector3
    """m, world: mean"""
    sideways: Array
    """(2, 2) m^2, world: covariance on the level"""


class Elsewhere:
    """The places of one thing, as probable as somebody may have moved it there and cameras do not show it there.

    Args:
        since: s, from when on it may be there.
    """

    def __init__(self, since: float) -> None:
        self._shares = np.full(len(_STANDS), 1.0 / len(_STANDS))
        self._missed = np.zeros(len(_STANDS))
        self._looked = np.full(len(_STANDS), since)
        self._turn = 0
        self.reach = 0.0
        """m, standard deviation in each direction by which the places are broader than learned"""

    @property
    def hidden(self) -> float:
        """1, how probable it is that cameras do not show the thing for as long as they have looked, if it came here."""
        return float(np.exp(-self._missed).mean())

    def join(self, ratio: float, *, before: bool = False) -> None:
        """Let the thing come to these places anew, with a `ratio` (1) of the probability that it is here then.

        What comes has not been missed here yet. If it came `before` cameras looked, it was missed as all of it was.
        """
        new = np.exp(-self._missed) if before else np.ones(len(_STANDS))
        new *= ratio / new.sum()
        shares = (1.0 - ratio) * self._shares + new
        if not before:
            self._missed = np.log(((1.0 - ratio) * self._shares * np.exp(self._missed) + new) / shares)
        self._shares = shares

    def asked(self) -> NDArray[np.intp]:
        """(LOOKED_AT,) numbers of the places, of `places_about`, that cameras are asked about next."""
        return np.asarray(_STANDS[self._next()])

    def _next(self) -> NDArray[np.intp]:
        return (self._turn + np.arange(LOOKED_AT)) % len(_STANDS)

    def miss(self, shares: Sequence[float], now: float, absence: Absence) -> float:
        """Take in at `now` (s) that the thing is not seen.

        Args:
            shares: (LOOKED_AT,) of the places `asked` about, how much cameras should see there (1).
            now: s
            absence: what that tells.

        Returns:
            The probability that it is not seen.
        """
        for number, share in zip(self._next().tolist(), shares, strict=True):
            missed = missed_after(float(self._missed[number]), share, now - float(self._looked[number]), absence)
            self._shares[number] *= math.exp(self._missed[number] - missed)
            self._missed[number], self._looked[number] = missed, now
        self._turn = (self._turn + LOOKED_AT) % len(_STANDS)
        unseen = float(self._shares.sum())
        self._shares /= unseen
        return unseen

    def areas(self, places: Array, deviation: float) -> list[Area]:
        """The places (n, 3) m as of `places_about`, level by level, most probable first.

        `deviation` (m) is theirs in each direction.
        """
        levels = np.unique(places[:, 2])
        found = [self._area(places, places[:, 2] == level, deviation) for level in levels.tolist()]
        return sorted((area for area in found if area.share > ROUNDING), key=lambda area: -area.share)

    def _area(self, places: Array, on_level: NDArray[np.bool_], deviation: float) -> Area:
        weights = self._shares[_GROUP[on_level]] / _FINER**2
        share = float(weights.sum())
        weights /= max(share, ROUNDING)
        x, y, z = (weights @ places[on_level]).tolist()
        offsets = places[on_level, :2] - (x, y)
        sideways = (weights[:, None] * offsets).T @ offsets + _WITHIN * deviation**2 * np.eye(2)
        return Area(share, (x, y, z), sideways)


def places_about(solid: Solid, deviation: float, beneath: Sequence[Solid]) -> Array:
    """Where a solid may lie that somebody moved, no one knows where to: on what is highest there.

    Args:
        solid: at the mean of its places, where it lay or was held. Where nothing is beneath, it is as high as there.
        deviation: m, standard deviation of its place in each direction of the level.
        beneath: all that it may lie on. On a fixture that is higher than it was, it does not.

    Returns:
        (n, 3) m, world: positions of its centre.
    """
    flat, _ = solid.face_down()
    x, y, z = flat.position
    places = np.column_stack((np.array((x, y)) + deviation * _OFFSETS, np.full(len(_OFFSETS), z)))
    reach = deviation * float(np.linalg.norm(_OFFSETS, axis=1).max())
    carriers = [
        one for one in beneath
        if (one.top < z or not one.fixed) and (one.fixed or math.dist(one.position[:2], (x, y)) < reach + one.radius)
    ]  # fmt: skip
    for one in sorted(carriers, key=lambda one: one.top):
        places[_is_over(one, places[:, :2]), 2] = one.top + flat.half_height
    return places


def _is_over(carrier: Solid, places: Array) -> NDArray[np.bool_]:
    """(n,) whether places (n, 2) m are over a solid: to the left of all edges of its outline."""
    ends = np.array(carrier.footprint)
    starts = np.roll(ends, 1, axis=0)
    (along_x, along_y), away = (ends - starts).T, places[:, None, :] - starts
    return np.asarray((along_x * away[..., 1] - along_y * away[..., 0] >= 0.0).all(axis=1))
