"""Merges worlds of one object that are nearly equal: each place is within the spread of the other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dsr.math3d.transforms import Pose
from simulation_handler.worlds.spread import squared_distance, with_world_covariances


class WeightedPlace(NamedTuple):
    """Where an object may be, with covariance, and how probable that is."""

    weight: float
    pose: Pose


def merged(places: Sequence[WeightedPlace]) -> list[WeightedPlace]:
    """Fewer places with the same mean and covariance of positions, all together; the most probable first.

    Two are nearly equal if they are within a standard deviation of each other: their sum has one peak then.
    """
    groups: list[list[WeightedPlace]] = []
    for place in sorted(places, key=lambda one: -one.weight):
        near = (group for group in groups if all(_are_near(place.pose, other.pose) for other in group))
        group = next(near, None)
        if group is None:
            groups.append([place])
        else:
            group.append(place)
    return sorted(map(_as_one, groups), key=lambda one: -one.weight)


def _are_near(one: Pose, other: Pose) -> bool:
    offset, covariance = np.subtract(one.t, other.t), one.parent_covariances()[0] + other.parent_covariances()[0]
    return float(squared_distance(offset, covariance)) <= 1.0


def _as_one(group: Sequence[WeightedPlace]) -> WeightedPlace:
    """A Gaussian with the moments of their sum; turned as the most probable one."""
    if len(group) == 1:
        return group[0]
    total = sum(place.weight for place in group)
    shares = np.array([place.weight / total for place in group])
    offsets = np.array([place.pose.t for place in group])
    mean = shares @ offsets
    offsets = offsets - mean
    own = [place.pose.parent_covariances() for place in group]
    spread = np.einsum("n,nij->ij", shares, np.array([covariance for covariance, _ in own]))
    spread += np.einsum("n,ni,nj->ij", shares, offsets, offsets)
    first = group[0].pose
    x, y, z = mean.tolist()
    return WeightedPlace(
        total, with_world_covariances(Pose.unchecked((x, y, z), first.q, first.stamp), spread, own[0][1])
    )
