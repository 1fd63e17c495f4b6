"""The belief as weighted worlds: where each object of an island may be, with whom, and how probable that is."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose
from simulation_handler.contact.relations import Relation
from simulation_handler.scales import ROUNDING

GRASPING, INSIDE, ON = "grasping", "in", "on"
"""Kinds of relations: hand or gripper and object; object and container; object and support."""


class ObjectState(NamedTuple):
    """The state of one object in one world."""

    pose: Pose | None
    """world_from_object with covariance (6, 6) in its frame (m, rad); None: the object is gone"""
    velocity: Vector3 | None = None
    """(3,) m/s in the world frame, of the object's centre; None: at rest, or unknown"""
    hand: str = ""
    """Name of the hand or gripper that holds the object; empty for none"""
    containers: tuple[str, ...] = ()
    """Names of the containers and covers that the object is in, innermost first"""
    supports: tuple[str, ...] = ()
    """Names of what the object rests on, but for the floor"""
    moved_camera: str = ""
    """Name of the camera that moved, and so shows the object elsewhere; empty for none"""

    @property
    def container(self) -> str:
        """Name of the innermost container or cover that the object is in; empty for none."""
        return self.containers[0] if self.containers else ""

    @property
    def support(self) -> str:
        """Name of the first thing that the object rests on; empty for none, and for the floor."""
        return self.supports[0] if self.supports else ""

    @property
    def holder(self) -> str:
        """Name of what the object goes along with: hand before container before support; empty for none."""
        return self.hand or self.container or self.support

    @property
    def is_gone(self) -> bool:
        """Whether the object is not in the scene."""
        return self.pose is None


class WeightedWorld(NamedTuple):
    """One way in which the objects of an island may be."""

    weight: float
    """1, probability of this world among those of its island"""
    objects: Mapping[str, ObjectState]
    """The state of each object of the island, by name"""
    reason: str = ""
    """Name of the event or circumstance of which this world is the outcome, such as "in hand"."""

    @property
    def moved_cameras(self) -> frozenset[str]:
        """Names of the cameras that moved in this world: they do not show things where these are."""
        return frozenset(state.moved_camera for state in self.objects.values() if state.moved_camera)


@dataclass(frozen=True)
class Island:
    """Objects that must be judged together; other islands are independent of it.

    Raises:
        ValueError: without a world, for weights that do not sum to 1, or that are not in order.
    """

    names: tuple[str, ...]
    """Names of the objects, sorted"""
    worlds: tuple[WeightedWorld, ...] = field(default=())
    """Most probable first; weights sum to 1"""

    def __post_init__(self) -> None:
        weights = [world.weight for world in self.worlds]
        if not weights or abs(sum(weights) - 1.0) > ROUNDING:
            raise ValueError(f"weights {weights} of island {self.names}: expected some that sum to 1")
        if sorted(weights, reverse=True) != weights:
            raise ValueError(f"weights {weights} of island {self.names}: expected the greatest first")

    @property
    def best(self) -> WeightedWorld:
        """The most probable world."""
        return self.worlds[0]

    def probability(self, kind: str, relation: Relation) -> float:
        """Probability of a relation (from, to) of a kind of `GRASPING`, `INSIDE`, `ON`."""
        return sum(world.weight for world in self.worlds if holds(world, kind, relation))


def holds(world: WeightedWorld, kind: str, relation: Relation) -> bool:
    """Whether a relation (from, to) holds in a world. `INSIDE` is transitive. Raises ValueError for another kind."""
    source, target = relation
    if kind == GRASPING:
        return target in world.objects and world.objects[target].hand == source
    state = world.objects.get(source)
    if kind == ON:
        return state is not None and target in state.supports
    if kind != INSIDE:
        raise ValueError(f"kind {kind!r}: expected {GRASPING!r}, {INSIDE!r} or {ON!r}")
    todo, passed = [source], set()
    while todo:
        passed.add(name := todo.pop())
        containers = world.objects[name].containers if name in world.objects else ()
        if target in containers:
            return True
        todo += [container for container in containers if container not in passed]
    return False


def probability(islands: Collection[Island], kind: str, relation: Relation) -> float:
    """Probability of a relation (from, to): of the island of the object that is held, inside or on something."""
    name = relation[1] if kind == GRASPING else relation[0]
    return next((island.probability(kind, relation) for island in islands if name in island.names), 0.0)


def joined(pairs: Collection[Relation], names: Sequence[str]) -> list[tuple[str, ...]]:
    """Group names that are connected by pairs, directly or not; each group and all groups sorted."""
    group = {name: {name} for name in names}
    for one, other in pairs:
        if one in group and other in group and group[one] is not group[other]:
            both = group[one] | group[other]
            group |= dict.fromkeys(both, both)
    return sorted({tuple(sorted(members)) for members in group.values()})


def innermost_first(name: str, contents: Collection[Relation]) -> tuple[str, ...]:
    """Names of the containers of an object by pairs (object, container), innermost first."""
    inner = sorted(container for thing, container in contents if thing == name)
    return tuple(sorted(inner, key=lambda container: sum((other, container) in contents for other in inner)))
