"""Tells where a thing lies that nothing holds: on what is beneath it, and nowhere in the air."""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose
from simulation_handler.contact.placement import find_support
from simulation_handler.contact.relations import SupportedPose
from simulation_handler.explaining.glimpses import DRAW_COUNT
from simulation_handler.shapes.geometry import Solid
from simulation_handler.state.bodies import FLOOR

Array = NDArray[np.float64]

_QUANTILES = np.array([NormalDist().inv_cdf((k + 0.5) / DRAW_COUNT) for k in range(DRAW_COUNT)])
_OFFSETS = np.array([(x, y) for x in _QUANTILES for y in _QUANTILES])  # 1, standard deviations; each as probable
_WITHIN = 1.0 - float(np.mean(_QUANTILES**2))  # 1, variance within the part of the distribution of one quantile


class Area(NamedTuple):
    """The places on one level where a thing may lie."""

    share: float
    """1, probability that it is there"""
    position: Vector3
    """m, world: mean"""
    sideways: Array
    """(2, 2) m^2, world: covariance on the level"""


def let_go(solid: Solid, others: Sequence[Solid]) -> SupportedPose | None:
    """Where a solid lies once nothing holds it any more: on the highest thing beneath; None if there is none."""
    flat, _ = solid.face_down()
    beneath = [other for other in others if other.top < flat.position[2]]
    supports, level = find_support(flat, flat.bottom, beneath, math.inf)
    if level is None:
        return None
    x, y, _ = flat.position
    place = Pose.unchecked((x, y, level + flat.half_height), flat.rotation)
    return SupportedPose(place, tuple(name for name in supports if name != FLOOR))


def moved_about(solid: Solid, height: float, deviation: float, fixtures: Sequence[Solid]) -> list[Area]:
    """Where a solid lies that somebody moved, no one knows where to: beyond the edge of a table, on what is lower.

    Args:
        solid: at the mean of its places, where it lay or was held: it lies on nothing that is higher.
        height: m, world z of its centre as it lies at the mean.
        deviation: m, standard deviation of its place in each direction of the level.
        fixtures: tables and the floor.
    """
    beneath = sorted((one for one in fixtures if one.top < solid.position[2]), key=lambda one: one.top)
    places = np.vstack((solid.position[:2], solid.position[:2] + deviation * _OFFSETS))
    carried = np.full(len(places), -1)  # by the highest one: its number; -1 for none
    for number, one in enumerate(beneath):
        carried[_is_over(one, places)] = number
    own, half_height = carried[0], solid.face_down()[0].half_height
    carried = np.where(carried < 0, own, carried)[1:]
    return [
        _area(places[1:][carried == number], there, deviation)
        for number in np.unique(carried).tolist()
        for there in [height if number == own else beneath[number].top + half_height]
    ]


def _area(places: Array, height: float, deviation: float) -> Area:
    x, y = places.mean(axis=0).tolist()
    offsets = places - (x, y)
    sideways = offsets.T @ offsets / len(places) + _WITHIN * deviation**2 * np.eye(2)
    return Area(len(places) / len(_OFFSETS), (x, y, height), sideways)


def _is_over(fixture: Solid, places: Array) -> NDArray[np.bool_]:
    """(n,) whether places (n, 2) m are over a fixture: to the left of all edges of its outline."""
    ends = np.array(fixture.footprint)
    starts = np.roll(ends, 1, axis=0)
    (along_x, along_y), away = (ends - starts).T, places[:, None, :] - starts
    return np.asarray((along_x * away[..., 1] - along_y * away[..., 0] >= 0.0).all(axis=1))
