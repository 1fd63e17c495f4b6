"""Worlds of one object about where the simulation has it: there more or less, as perceived, turned or leaning."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dsr.math3d import quaternions
from dsr.math3d.transforms import Pose
from simulation_handler.scales import ROUNDING
from simulation_handler.worlds.circumstances import DOUBTED, RESTLESS
from simulation_handler.worlds.displaced import Staying
from simulation_handler.worlds.evidence import ObjectEvidence
from simulation_handler.worlds.model import ObjectState
from simulation_handler.worlds.parameters import PlaceNoise
from simulation_handler.worlds.spread import (
    levels_of_wrong,
    odds_of_percepts,
    percept_covariance,
    scaled,
    squared_distance,
    with_world_covariances,
)

WRONG = "something unknown is wrong"
"""Reason of a world in which an object is further from its believed place than its circumstance tells"""
PERCEIVED = "as perceived"
"""Reason of a world in which an object is where percepts have it, and not where the simulation has it"""
OTHER_SIDE = "on another side"
"""Reason of a world in which another side of an object is down, for percepts do not tell how it is turned"""
ASLANT = "leans on something"
"""Reason of a world in which an object leans, and is where it is perceived by the errors of other objects"""


class Followed(NamedTuple):
    """How the place of an object in the simulation is known."""

    circumstance: str
    pose: Pose
    """world_from_object, with the covariance that perception tells, if any"""
    velocity: NDArray[np.float64]
    """(3,) m/s"""
    age: float = 0.0
    """s since it was recognised; 0 while it is"""
    moved: float = 0.0
    """m, how far the simulation has moved it since"""
    seen: Pose | None = None
    """world_from_object as perception alone has it, with covariance; None while it is not recognised"""
    reach: float = math.inf
    """m, how far percepts that contradict the pose are away from it; infinite if none do"""
    stays: Staying | None = None
    """Whether it is where the simulation has it though it is seen displaced; None while it is not"""

    @property
    def probability(self) -> float:
        """1, that this is the circumstance, and not that of `otherwise`."""
        if self.stays is None:
            return 1.0
        return self.stays.probability if self.circumstance == DOUBTED else 1.0 - self.stays.probability


WeightedState = tuple[float, ObjectState, str]
"""Weight, state and reason of a world of one object"""


def reached(followed: Followed, thing: ObjectEvidence) -> Followed:
    """The same, no more unsure than the newest percept of the thing is off."""
    return followed if thing.percept is None else followed._replace(reach=thing.percept.distance(followed.pose)[0])


def otherwise(followed: Followed, thing: ObjectEvidence) -> Followed:
    """The same of a thing that is seen displaced, if it stays and that is less probable, or the reverse."""
    if followed.circumstance == RESTLESS:
        return followed._replace(circumstance=DOUBTED, reach=math.inf)
    return reached(followed._replace(circumstance=RESTLESS), thing)


def worlds_of(followed: Followed, noise: PlaceNoise, state: ObjectState) -> list[WeightedState]:
    """Worlds in one circumstance: a thing is where the simulation has it, more or less, or where percepts have it.

    `state` has the covariance of the circumstance, and `noise` is of that.
    """
    assert state.pose is not None
    perceived = _perceived(followed, noise, state.pose)
    rest = 1.0 if perceived is None else 1.0 - perceived[0]
    parts = [
        (rest * share, state._replace(pose=scaled(state.pose, factor)), WRONG if level else followed.circumstance)
        for level, (share, factor) in enumerate(zip(*levels_of_wrong(noise), strict=True))
    ]
    if perceived is not None:
        parts.append((perceived[0], state._replace(pose=perceived[1]), PERCEIVED))
    return parts


def staying_or_not(
    stays: Staying, if_so: Sequence[WeightedState], if_not: Sequence[WeightedState]
) -> list[WeightedState]:
    """Worlds in which a thing stays, because its camera moved or for another reason, and those in which it does not."""
    chances = ((stays.by_camera, stays.camera), (stays.probability - stays.by_camera, ""))
    return [
        *(
            (chance * share, one._replace(moved_camera=camera), reason)
            for chance, camera in chances
            if chance > ROUNDING
            for share, one, reason in if_so
        ),
        *(((1.0 - stays.probability) * share, one, reason) for share, one, reason in if_not),
    ]


def _perceived(followed: Followed, noise: PlaceNoise, placed: Pose) -> tuple[float, Pose] | None:
    """How probable it is that an object is where percepts have it, and where that is; None if they have it nowhere.

    `placed` is where the simulation has it, with the covariance of the circumstance.
    """
    seen = followed.seen
    if seen is None:
        return None
    place, turn = seen.parent_covariances()
    place = percept_covariance(noise, place, followed.velocity)
    apart = squared_distance(np.subtract(seen.t, placed.t), place + placed.parent_covariances()[0])
    odds = float(odds_of_percepts(noise, apart))
    return odds / (1.0 + odds), with_world_covariances(seen, place, turn)


def turned(world: WeightedState, thing: ObjectEvidence) -> Iterator[WeightedState]:
    """A world, and those that are like it but for the side of the object that is down, which percepts do not tell."""
    weight, state, reason = world
    pose = state.pose
    if pose is None:
        yield world
        return
    yield weight * (1.0 - sum(other.probability for other in thing.otherwise)), state, reason
    for chance, turn, shift in thing.otherwise:
        if weight * chance > ROUNDING:
            (x, y, z), (right, back, up) = pose.t, shift
            there = Pose.unchecked((x + right, y + back, z + up), quaternions.product(pose.q, turn), pose.stamp)
            there = with_world_covariances(there, *pose.parent_covariances())
            yield weight * chance, state._replace(pose=there), OTHER_SIDE


def or_aslant(
    parts: Sequence[WeightedState], state: ObjectState, chance: float, there: Pose, noise: PlaceNoise
) -> list[WeightedState]:
    """Worlds, and those in which the object leans, with the probability `chance`."""
    return [
        *(((1.0 - chance) * share, one, reason) for share, one, reason in parts),
        *(
            (chance * share, state._replace(pose=scaled(there, factor)), ASLANT)
            for share, factor in zip(*levels_of_wrong(noise), strict=True)
        ),
    ]
