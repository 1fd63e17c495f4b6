"""Algorithms 1 and 2 of Sallami et al.: percepts are overridden by a simulation, unless that diverges from them."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from benchmarks.baselines.physics_reasoner.boxes import BoxRelations, WorldBox, world_box
from benchmarks.baselines.physics_reasoner.parameters import PublishedConfig
from dsr.config.toml import convert
from dsr.errors import suggest
from dsr.math3d.quaternions import Vector3
from dsr.math3d.shapes import Shape
from dsr.math3d.transforms import Pose
from dsr.vocabulary.explained import ExplainedChange
from dsr.vocabulary.observed_actions import Deed
from simulation_handler.config import BeliefConfig
from simulation_handler.contact.relations import BOUNDS, Relation
from simulation_handler.explaining import Explanation, VisibilityQuery
from simulation_handler.hands.letting_go import LetGo
from simulation_handler.hands.state import HandGrasp, HandPercept
from simulation_handler.motion.holding import GripperGrasp
from simulation_handler.perception.percepts import SeenObject
from simulation_handler.physics.rollouts.scene import RolloutBody, RolloutScene
from simulation_handler.physics.simulator import SimulationError, Simulator
from simulation_handler.shapes.geometry import Solid
from simulation_handler.worlds.model import Island, probability
from simulation_handler.worlds.one_world import one_world_islands

_FLOOR = "_floor"
_FLOOR_SIZE = (20.0, 20.0, 0.2)


@dataclass
class _Object:
    """What is known of one object."""

    name: str
    size: Vector3
    shape: Shape
    mass: float
    friction: float
    rolling_friction: float | None
    """m, lever arm of the resistance to rolling; None if that is not known"""
    seen: Pose | None = None
    """world_from_object of the newest percept."""
    stamp: float = -math.inf
    """s, of that percept"""
    moved: Vector3 | None = None
    """m, from the percept before to the newest, d_perc/prev; None if there was none since the last update"""
    is_perceived: bool = False
    calm: int = 0
    """Updates in a row in which the simulation did not diverge from the percept."""
    is_plausible: bool = True
    believed: Pose | None = None
    """world_from_object in the output scene."""


class PublishedReasoner:
    """The published physics reasoner behind the interface of the agent's belief.

    Percepts are taken as they are: their covariances, surprises, explanations, grasps and what cameras should see are
    not used.

    Args:
        config: its field `parameters` are those of `PublishedConfig`, by name.
    """

    def __init__(self, config: BeliefConfig | None = None) -> None:
        self.config = config or BeliefConfig()
        self._parameters = convert(self.config.parameters, PublishedConfig, "parameters")
        self._sim = Simulator()
        self._objects: dict[str, _Object] = {}
        self._fixtures: dict[str, RolloutBody] = {}
        self._relations = BoxRelations(self._parameters.epsilon)
        self._now = 0.0
        self._lay_floor()

    def close(self) -> None:
        """Free the simulation."""
        self._sim.close()

    def __contains__(self, name: str) -> bool:
        return name in self._objects

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all objects, also of those never seen."""
        return tuple(self._objects)

    def set_fixture(
        self, name: str, size: Vector3, pose: Pose, shape: Shape = (), friction: float | None = None
    ) -> None:
        """Add a body that never moves, or put it elsewhere (world_from_centre)."""
        if name in self._objects:
            raise SimulationError(f"{name!r} is an object of the belief and cannot be a fixture")
        friction = self.config.default_friction if friction is None else friction
        self._fix(RolloutBody(name, size, pose.t, pose.q, friction=friction, fixed=True, shape=shape))
        self._lay_floor()

    def add_object(
        self,
        name: str,
        size: Vector3,
        *,
        mass: float | None = None,
        friction: float | None = None,
        rolling_friction: float | None = None,
        shape: Shape = (),
        tagged: bool = True,
    ) -> None:
        """Let an object exist; it takes part in the simulation once it was seen."""
        if name in self._objects or name in self._fixtures:
            raise SimulationError(f"{name!r} is already part of the belief")
        mass = self.config.default_mass if mass is None else mass
        friction = self.config.default_friction if friction is None else friction
        self._objects[name] = _Object(name, size, shape, mass, friction, rolling_friction)

    def remove(self, name: str) -> None:
        """Forget an object or a fixture. Harmless if there is none."""
        if name in self._sim:
            self._sim.remove(name)
        self._objects.pop(name, None)
        self._fixtures.pop(name, None)
        self._relations.forget(name)

    def recall(self, name: str, world_pose: Pose, *, held: bool = False) -> None:
        """Believe again that an object is at `world_pose`."""
        item = self._object(name)
        self._put(item, world_pose)
        item.believed = world_pose

    def recall_gone(self, name: str) -> None:
        """It takes nothing out of the scene."""

    def recall_seen(self, name: str, world_pose: Pose, stamp: float, camera: str) -> None:
        """It asks only whether an object is seen now, which the next percept tells."""

    def recall_explanation(self, changes: tuple[ExplainedChange, ...], time: float, now: float) -> None:
        """It explains nothing."""

    def recall_support(self, relation: Relation, since: float, now: float, source: str) -> None:
        """Believe again that an object has been standing on another one since `since` (s)."""
        self._relations.recall(relation, since)

    def recall_contents(self, relation: Relation, since: float, now: float) -> None:
        """Believe again that an object has been in another one since `since` (s)."""
        self._relations.recall_contents(relation, since)

    def observe(self, sights: Sequence[SeenObject]) -> dict[str, str]:
        """Take in percepts; what is not newer than the last of its object is ignored."""
        problems = {s.name: f"no object {s.name!r}" for s in sights if s.name not in self._objects}
        for sight in sights:
            item = self._objects.get(sight.name)
            if item is None or sight.stamp <= item.stamp:
                continue
            if item.seen is not None:
                item.moved = _sum(item.moved or (0.0, 0.0, 0.0), _difference(sight.pose.t, item.seen.t))
            item.seen, item.stamp = sight.pose, sight.stamp
        return problems

    def touch(self, hands: Mapping[str, HandPercept]) -> None:
        """It knows nothing of hands."""

    def recall_grasp(self, relation: Relation, grasp: HandGrasp, now: float) -> None:
        """It knows nothing of hands."""

    def grasps(self) -> Mapping[Relation, HandGrasp]:
        """None: it knows nothing of hands."""
        return {}

    def let_go(self) -> Mapping[Relation, LetGo]:
        """None: it knows nothing of hands."""
        return {}

    def deeds(self, name: str) -> tuple[Deed, ...]:
        """None: it knows nothing of hands."""
        return ()

    def recall_deeds(self, name: str, deeds: Sequence[Deed]) -> None:
        """It knows nothing of hands."""

    def step(self, now: float) -> None:
        """One update of the output scene: Algorithm 2."""
        self._now = now
        for item in self._objects.values():
            item.is_perceived = now - item.stamp < self._parameters.perceived_max_age
            if item.is_perceived:
                self._place_where_perceived(item)
            item.moved = None
        self._judge_plausibility()
        for item in self._objects.values():
            if item.is_perceived and not item.is_plausible:
                item.believed = item.seen
            elif item.name in self._sim:
                item.believed = Pose.unchecked(*self._sim.pose(item.name))
        self._relations.update(
            {item.name: world_box(item.size, item.believed) for item in self._objects.values() if item.believed},
            {name: _box(body) for name, body in self._fixtures.items() if name != _FLOOR},
            now,
        )

    def pose(self, name: str) -> Pose | None:
        """world_from_object in the output scene, without covariance; None before the first percept."""
        believed = self._object(name).believed
        return None if believed is None else Pose.unchecked(believed.t, believed.q).with_stamp(self._now)

    def islands(self) -> list[Island]:
        """All objects that have a place, each group with one certain world."""
        return one_world_islands(self)

    def probability(self, kind: str, relation: Relation) -> float:
        """1 for a relation that holds, else 0."""
        return probability(self.islands(), kind, relation)

    def solids(self) -> list[Solid]:
        """All objects that have a place, there."""
        return [
            Solid(item.name, item.size, item.believed.t, item.believed.q, shape=item.shape)
            for item in self._objects.values()
            if item.believed is not None
        ]

    def scene(self) -> RolloutScene:
        """All that has a place, fixtures and floor too, as it is simulated."""
        bodies = (
            RolloutBody(
                item.name,
                item.size,
                *self._sim.pose(item.name),
                item.mass,
                item.friction,
                shape=item.shape,
                rolling_friction=item.rolling_friction,
            )
            for item in self._objects.values()
            if item.name in self._sim
        )
        return RolloutScene((*self._fixtures.values(), *bodies))

    def supports(self) -> dict[Relation, float]:
        """isOnTop: (object, what it stands on) and since when (s); nothing is said of the floor."""
        return self._relations.on_top

    def contents(self) -> dict[Relation, float]:
        """isIn: (object, container) and since when (s)."""
        return self._relations.inside

    def source(self, relation: Relation) -> str:
        """What says that a relation holds: bounding boxes."""
        return BOUNDS

    def perceived(self, name: str, now: float) -> bool:
        """IsPerceived at time `now` (s)."""
        return now - self._object(name).stamp < self._parameters.perceived_max_age

    def plausible(self, name: str) -> bool:
        """IsPhysicallyPlausible."""
        return self._object(name).is_plausible

    def is_gone(self, name: str) -> bool:
        """Never: what is not seen goes on being simulated."""
        return False

    def explanations(self) -> list[tuple[float, Explanation]]:
        """None: inconsistencies are not explained."""
        return []

    def set_visibility(self, visibility: VisibilityQuery | None) -> None:
        """Not used: what cannot be seen is not told from what should be."""

    def doubt_cameras(self, in_doubt: Collection[str], *, standing: Collection[str]) -> None:
        """Not used: cameras do not move."""

    def flag(self, names: Collection[str]) -> None:
        """Not used."""

    def plan(self, relations: Collection[Relation]) -> None:
        """Not used."""

    def hold(self, grasps: Mapping[str, GripperGrasp]) -> None:
        """Not used: nobody holds anything (Sec. VI c)."""

    def _place_where_perceived(self, item: _Object) -> None:
        """First half of Algorithm 2: what was seen to jump is placed there, and what is in it shifted likewise."""
        assert item.seen is not None
        if item.name not in self._sim:
            self._put(item, item.seen)
        elif item.moved is not None and math.hypot(*item.moved) > self._parameters.perception_tolerance:
            self._put(item, item.seen)
            self._shift_contents(item, item.moved)

    def _judge_plausibility(self) -> None:
        """Algorithm 1: simulate the horizon; what diverges from its percept goes back to that."""
        diverged: set[str] = set()
        present = [item for item in self._objects.values() if item.name in self._sim]
        for _ in range(self._parameters.steps):
            self._sim.step()
            for item in present:
                if item.is_perceived and item.seen is not None:
                    offset = _difference(item.seen.t, self._sim.position(item.name))
                    if math.hypot(*offset) > self._parameters.simulation_tolerance:
                        diverged.add(item.name)
                    if item.name in diverged:
                        self._put(item, item.seen)
                        self._shift_contents(item, offset)
        for item in present:
            item.calm = 0 if item.name in diverged else item.calm + 1
            item.is_plausible = not item.is_perceived or item.calm >= self._parameters.calm_updates or (
                item.is_plausible and item.name not in diverged
            )  # fmt: skip

    def _shift_contents(self, container: _Object, offset: Vector3) -> None:
        """Move what is in a container as it moves: translated only, and not what is in the contents in turn."""
        for name in self._relations.contents(container.name):
            content = self._objects[name]
            if not content.is_perceived and name in self._sim:
                position, rotation = self._sim.pose(name)
                self._put(content, Pose.unchecked(_sum(position, offset), rotation))

    def _put(self, item: _Object, pose: Pose) -> None:
        """Put a body somewhere at rest: percepts here tell no velocity."""
        if item.name in self._sim:
            self._sim.place(item.name, pose.t, pose.q)
        else:
            self._sim.add_body(
                item.name, item.size, item.shape, pose.t, pose.q,
                mass=item.mass, friction=item.friction, rolling_friction=item.rolling_friction,
            )  # fmt: skip

    def _object(self, name: str) -> _Object:
        try:
            return self._objects[name]
        except KeyError:
            raise SimulationError(f"no object {name!r} in the belief; {suggest(name, self._objects)}") from None

    def _lay_floor(self) -> None:
        """Put the floor below the lowest table."""
        tops = [_box(body).high[2] for name, body in self._fixtures.items() if name != _FLOOR]
        height = min(tops, default=0.0) - self.config.floor_below_table
        middle, friction = (0.0, 0.0, height - 0.5 * _FLOOR_SIZE[2]), self.config.default_friction
        self._fix(RolloutBody(_FLOOR, _FLOOR_SIZE, middle, friction=friction, fixed=True))

    def _fix(self, body: RolloutBody) -> None:
        if self._fixtures.get(body.name) == body:
            return
        if body.name in self._sim:
            self._sim.remove(body.name)
        self._sim.add_body(body.name, body.size, body.shape, body.position, body.rotation, friction=body.friction)
        self._fixtures[body.name] = body


def _box(body: RolloutBody) -> WorldBox:
    return world_box(body.size, Pose.unchecked(body.position, body.rotation))


def _difference(a: Vector3, b: Vector3) -> Vector3:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def _sum(a: Vector3, b: Vector3) -> Vector3:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]
