"""Where things may be besides where they are believed to be: some places of each alternative, with probabilities."""

from __future__ import annotations

from typing import NamedTuple

import msgspec

from dsr.believing.distribution import Alternative, Whereabouts
from dsr.math3d.transforms import Pose, position_deviation
from dsr.perception.consensus import tells_rotation
from dsr.vocabulary.what_if import USUAL_WORLDS

APART = 0.05
"""m between places that show different things: about the size of what is looked for"""


class LikelyPlace(NamedTuple):
    """A place where a thing may be."""

    probability: float
    pose: Pose | None
    """world_from_thing; None if the thing is gone"""
    alternative: Alternative
    """The alternative of which this is a place"""


def likely_places(where: Whereabouts, *, by_turn: bool = False) -> list[LikelyPlace]:
    """Places where a thing may be, with their probabilities; some of each alternative that is spread out.

    No more alternatives count, and no more places of one, than worlds in which plans are tried.

    Args:
        where: the thing's distribution.
        by_turn: whether who sees the thing sees how it is turned. Then what is turned otherwise is another place.
    """
    likely = sorted(where.alternatives, key=lambda one: -one.weight)[:USUAL_WORLDS]  # others may order otherwise
    total = sum(one.weight for one in likely)
    found = []
    for one in likely:
        poses: list[Pose | None] = [one.pose]
        if one.pose is not None and (position_deviation(one.pose) >= APART / 2.0 or (by_turn and _any_turn(one.pose))):
            alone = msgspec.structs.replace(one, weight=1.0)
            poses = Whereabouts(where.name, (alone,)).samples(USUAL_WORLDS, seed=0)
        found += [LikelyPlace(one.weight / (total * len(poses)), pose, one) for pose in poses]
    return found


def _any_turn(pose: Pose) -> bool:
    """Whether nobody knows how a thing is turned."""
    return pose.covariance is not None and not tells_rotation(pose.covariance[3:, 3:])
