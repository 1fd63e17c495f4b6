"""The situation: beliefs and percepts of one moment, from which an explanation is drawn."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from dsr.math3d import quaternions
from dsr.math3d.quaternions import Quaternion, Vector3
from dsr.math3d.shapes import Shape
from dsr.math3d.transforms import Pose
from simulation_handler.config import BeliefConfig
from simulation_handler.contact.placement import Pairs
from simulation_handler.explaining.glimpses import Glimpse
from simulation_handler.explaining.hypotheses import FALLS
from simulation_handler.perception.percepts import Array
from simulation_handler.perception.visibility import ExpectedVisibility
from simulation_handler.scales import PLACE_FLOOR
from simulation_handler.shapes.geometry import Solid
from simulation_handler.state.objects import BelievedObject

VisibilityQuery = Callable[[Sequence[Solid], Sequence[Solid]], Sequence[Mapping[str, ExpectedVisibility]]]
"""Predicts what each camera, by its name, should see of each of some solids, among all that are there.

What is there under the name of a solid hides nothing of it: so one question may be about several places of a solid."""


@dataclass(frozen=True)
class Seen:
    """The present percept of an object."""

    percept: Solid
    """Without the systematic error that is known, and without the tilt that noise alone may have given it."""
    covariance: Array
    """(3, 3) m^2 of its position"""
    turning: Array
    """(3, 3) rad^2, covariance of the rotation in the percept"""
    count: int
    """Percepts that agree on it."""
    moving: bool
    """The newest percepts contradict each other: it is on its way."""
    age: float = 0.0
    """s for which cameras could have told of it and have not"""
    unflattened: Solid | None = None
    """The percept with its tilt, where that was taken out."""
    shows_stance: bool = True
    """Whether percepts tell which of its sides is down."""

    @property
    def shown(self) -> Solid:
        """The percept with its tilt."""
        return self.percept if self.unflattened is None else self.unflattened

    def misfit(self, solid: Solid) -> float:
        """How badly a pose fits the percept: half the squared Mahalanobis distance, in nats."""
        shift = np.array(self.percept.position) - np.array(solid.position)
        between = quaternions.product(self.percept.rotation, quaternions.conjugate(solid.rotation))
        turn = np.array(quaternions.to_rotvec(between))
        return 0.5 * (_squared(shift, self.covariance) + _squared(turn, self.turning))


def shown_now(item: BelievedObject, config: BeliefConfig) -> tuple[Solid, Solid]:
    """The object at its perceived pose, twice: with the noise of its tilt taken out, and as it is."""
    percept = item.percept()
    return level(percept, item.stance, config), percept


def level(percept: Solid, stance: Quaternion | None, config: BeliefConfig) -> Solid:
    """A percept without the tilt that noise alone may have given it; one that leans as is believed keeps its tilt."""
    flat, tilt = percept.face_down()
    if tilt > config.tilt_tolerance:
        return percept
    return percept if stance is not None and _alike(percept, stance) > _alike(flat, stance) else flat


def _alike(solid: Solid, rotation: Quaternion) -> float:
    """Cosine of half the angle between two rotations."""
    return abs(sum(a * b for a, b in zip(solid.rotation, rotation, strict=True)))


def seen_now(item: BelievedObject, config: BeliefConfig, now: float) -> Seen:
    """Summarise the percepts of an object that is seen at `now` (s)."""
    estimate = item.track.estimate
    assert estimate is not None
    flat, percept = shown_now(item, config)
    return Seen(
        percept=flat,
        covariance=item.percept_covariance(config) + PLACE_FLOOR**2 * np.eye(3),
        turning=item.turning(),
        count=estimate.count,
        moving=item.track.moving,
        age=item.track.age(now),
        unflattened=percept,
        shows_stance=item.shows_stance,
    )


@dataclass(frozen=True)
class Properties:
    """Physical properties of a body."""

    mass: float
    """Mass of the body, kg."""
    friction: float
    """Coulomb coefficient."""
    shape: Shape = ()
    """Pieces of the body's shape; none for a solid box."""
    rolling_friction: float | None = None
    """m, lever arm of the resistance to rolling; None if that is not known"""


@dataclass(frozen=True)
class Situation:
    """One moment in the life of the belief; a value, which nobody changes."""

    now: float
    """Time of the situation, s."""
    config: BeliefConfig
    fixtures: Mapping[str, Solid]
    believed: Mapping[str, Solid]
    """Solids of all objects with a place, at their believed poses."""
    properties: Mapping[str, Properties]
    """Properties of all objects and fixtures, by name."""
    seen: Mapping[str, Seen]
    """The objects that perception shows now and that nothing holds."""
    surprising: tuple[str, ...]
    """Objects to explain, sorted."""
    glanced: frozenset[str] = frozenset()
    """Objects that perception shows, too shortly yet to tell where they are: nobody has moved them unseen."""
    beneath: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Objects on which each one rests, by the relations `on`."""
    inside: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Containers in which each object is."""
    former: Mapping[str, Mapping[str, Pose]] = field(default_factory=dict)
    """upper_from_lower for the objects that were beneath each object until lately, by the names of both."""
    companions: Mapping[str, frozenset[str]] = field(default_factory=dict)
    """Names of the objects that have just moved together with each object."""
    unplaced: Mapping[str, Vector3] = field(default_factory=dict)
    """Edge lengths (m) of the objects that exist without a place."""
    held: frozenset[str] = frozenset()
    """Objects in a gripper: they are where it is."""
    planned: frozenset[tuple[str, str]] = frozenset()
    """(object, support): where a plan has just put something."""
    confirmed: Mapping[str, Solid] = field(default_factory=dict)
    """Solids where perception last agreed with the belief, without objects that have moved with something since."""
    glimpsed: Mapping[str, Glimpse] = field(default_factory=dict)
    """Unseen objects that were on their way when they were last seen, and how."""
    missing_for: Mapping[str, float] = field(default_factory=dict)
    """s for which each object has not been seen although it should have been."""
    evidence: float = 0.0
    """Time (s) for which cameras have shown the scene as it is now."""
    visibility: VisibilityQuery | None = None
    """Predicts the objects that cameras should see; None without a camera whose pose is known."""
    sure: frozenset[str] = frozenset()
    """Seen by a camera that is known not to have moved."""
    pairs: Pairs = field(default_factory=Pairs, compare=False)
    """What was worked out of pairs of solids: most of them are in the same places in each hypothesis."""

    def chain_beneath(self, name: str) -> tuple[str, ...]:
        """Names of the unseen objects that carry an object, directly and indirectly; the nearest first."""
        chain: list[str] = []
        level = [name]
        while level := [below for upper in level for below in self.beneath.get(upper, ())]:
            level = [below for below in level if self._is_hidden(below) and below not in chain]
            chain += level
        return tuple(chain)

    def known_beneath(self, name: str) -> set[str]:
        """Names of all that is, or was until lately, beneath an object, directly and indirectly."""
        found: set[str] = set()
        level = {name}
        while (
            level := {n for upper in level for n in (*self.beneath.get(upper, ()), *self.former.get(upper, ()))} - found
        ):
            found |= level
        return found

    def chain_above(self, name: str) -> tuple[str, ...]:
        """Names of the unseen objects on or in an object, directly and indirectly."""
        return self._upon(name, [*self.beneath.items(), *self.inside.items()])

    def contents(self, name: str) -> set[str]:
        """Names of the unseen objects that lie in an object, directly and indirectly; objects that it only covers do
        not count.
        """
        upon = self._upon(name, list(self.beneath.items()))
        return {other for other in upon if name in self.inside.get(other, ())}

    def _upon(self, name: str, pairs: Collection[tuple[str, tuple[str, ...]]]) -> tuple[str, ...]:
        above: list[str] = []
        level = {name}
        while level := {upper for upper, lower in pairs if level & set(lower)} - {name, *above}:
            above += sorted(filter(self._is_hidden, level))
        return tuple(above)

    def _is_hidden(self, name: str) -> bool:
        return name in self.believed and self.is_unseen(name)

    def is_unseen(self, name: str) -> bool:
        """Whether nobody sees or holds an object: then it may be elsewhere."""
        return name not in self.seen and name not in self.glanced and name not in self.held

    def fall_seen(self, name: str) -> int | None:
        """Into which of the directions `FALLS` an object was on its way when it was last seen; None if it was not."""
        if name not in self.glimpsed or name not in self.believed:
            return None
        believed = self.believed[name]
        x, y, z = (a - b for a, b in zip(self.glimpsed[name].solid.position, believed.position, strict=True))
        dx, dy, _ = quaternions.rotate(quaternions.conjugate(believed.rotation), (x, y, z))
        return max(range(len(FALLS)), key=lambda k: dx * FALLS[k][0] + dy * FALLS[k][1])

    def still_beneath(self, name: str, top: Solid) -> Solid | None:
        """Where perception last had an object, if that is beneath `top`: only the simulation may have moved it."""
        solid = self.confirmed.get(name)
        if solid is None or solid.top > top.position[2]:
            return None
        return solid if math.dist(solid.position[:2], top.position[:2]) < 0.5 * min(solid.size[:2]) else None

    def size(self, name: str) -> Vector3:
        """Edge lengths of an object, m."""
        return self.believed[name].size if name in self.believed else self.unplaced[name]

    def solid(self, name: str, position: Vector3, rotation: Quaternion) -> Solid:
        """An object there."""
        return Solid(name, self.size(name), position, rotation, shape=self.properties[name].shape)

    def carried(self, name: str, other: str) -> Solid:
        """The solid of an object that has moved rigidly with a seen one."""
        offset = self.former.get(name, {}).get(other)
        if offset is None:
            offset = self.believed[name].pose.inverse() @ self.believed[other].pose
        pose = self.seen[name].percept.pose @ offset
        return self.solid(other, pose.t, pose.q)


def _squared(difference: Array, covariance: Array) -> float:
    return float(difference @ np.linalg.solve(covariance, difference))
