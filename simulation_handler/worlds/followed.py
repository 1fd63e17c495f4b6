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
    all_scaled,
    all_with_world_covariances,
    levels_of_wrong,
    odds_of_percepts,
    percept_covariance,
    squared_distance,
    with_world_covariances,
    world_covariances,
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
WeightedPose = tuple[float, Pose, str]
"""Weight and reason of a world of one object, and world_from_object in it"""


def reached(followed: Followed, thing: ObjectEvidence) -> Followed:
    """The same, no more unsure than the newest percept of the thing is off."""
    return followed if thing.percept is None else followed._replace(reach=thing.percept.distance(followed.pose)[0])


def otherwise(followed: Followed, thing: ObjectEvidence) -> Followed:
    """The same of a thing that is seen displaced, if it stays and that is less probable, or the reverse."""
    if followed.circumstance == RESTLESS:
        return followed._replace(circumstance=DOUBTED, reach=math.inf)
    return reached(followed._replace(circumstance=RESTLESS), thing)


def places_of(followed: Sequence[Followed], noise: PlaceNoise, placed: Sequence[Pose]) -> list[list[WeightedPose]]:
    """Places in one circumstance: a thing is where the simulation has it, more or less, or where percepts have it.

    Args:
        followed: how the place of each thing is known.
        noise: of the circumstance.
        placed: world_from_object of each, with the covariance of the circumstance.

    Returns:
        The places of each thing, with a sum of their weights of 1.
    """
    perceived = _perceived(followed, noise, placed)
    shares, factors = levels_of_wrong(noise)
    levels = list(zip(shares, all_scaled(placed, factors), strict=True))
    found: list[list[WeightedPose]] = []
    for number, one in enumerate(followed):
        seen = perceived.get(number)
        rest = 1.0 if seen is None else 1.0 - seen[0]
        found.append([
            (rest * share, poses[number], WRONG if level else one.circumstance)
            for level, (share, poses) in enumerate(levels)
        ])  # fmt: skip
        if seen is not None:
            found[-1].append((*seen, PERCEIVED))
    return found


def with_places(state: ObjectState, places: Sequence[WeightedPose]) -> list[WeightedState]:
    """The state of a thing at each of its places."""
    _, velocity, hand, containers, supports, camera = state
    return [
        (weight, ObjectState(pose, velocity, hand, containers, supports, camera), reason)
        for weight, pose, reason in places
    ]


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


def _perceived(
    followed: Sequence[Followed], noise: PlaceNoise, placed: Sequence[Pose]
) -> dict[int, tuple[float, Pose]]:  # fmt: skip
    """How probable it is that things are where percepts have them, and where that is, by number; arguments as above.

    Things that percepts have nowhere are left out.
    """
    numbers = [number for number, one in enumerate(followed) if one.seen is not None]
    if not numbers:
        return {}
    seen = [pose for one in followed if (pose := one.seen) is not None]
    places, turns = world_covariances(seen)
    places = percept_covariance(noise, places, np.array([followed[number].velocity for number in numbers]))
    there = [placed[number] for number in numbers]
    offsets = np.array([pose.t for pose in seen]) - [pose.t for pose in there]
    odds = odds_of_percepts(noise, squared_distance(offsets, places + world_covariances(there)[0]))
    poses = all_with_world_covariances(seen, places, turns)
    return dict(zip(numbers, zip((odds / (1.0 + odds)).tolist(), poses, strict=True), strict=True))


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
    shares, factors = levels_of_wrong(noise)
    return [
        *(((1.0 - chance) * share, one, reason) for share, one, reason in parts),
        *(
            (chance * share, state._replace(pose=wider), ASLANT)
            for share, (wider,) in zip(shares, all_scaled([there], factors), strict=True)
        ),
    ]
