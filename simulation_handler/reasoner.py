"""The interface of a belief as the agent uses it: `Belief`, or a method that a package provides."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Protocol

from dsr.math3d.quaternions import Vector3
from dsr.math3d.shapes import Shape
from dsr.math3d.transforms import Pose
from dsr.vocabulary.explained import ExplainedChange
from dsr.vocabulary.observed_actions import Deed
from simulation_handler.config import BeliefConfig
from simulation_handler.contact.relations import Relation
from simulation_handler.explaining import Explanation, VisibilityQuery
from simulation_handler.hands.letting_go import LetGo
from simulation_handler.hands.state import HandGrasp, HandPercept
from simulation_handler.motion.holding import GripperGrasp
from simulation_handler.perception.percepts import SeenObject
from simulation_handler.physics.rollouts.scene import RolloutScene
from simulation_handler.shapes.geometry import Solid
from simulation_handler.worlds.model import Island


class Reasoner(Protocol):
    """A belief about objects, kept in step with perception. See `Belief` for the full meaning of its methods."""

    config: BeliefConfig

    def close(self) -> None:
        """Free the simulation."""

    def __contains__(self, name: str) -> bool: ...

    @property
    def names(self) -> Sequence[str]:
        """Names of all objects, also of those whose place is unknown yet."""

    def set_fixture(
        self, name: str, size: Vector3, pose: Pose, shape: Shape = (), friction: float | None = None
    ) -> None:
        """Add a body that never moves, or put it elsewhere (world_from_centre).

        `friction` is its Coulomb coefficient, None if nobody says it.
        """

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
        """Let an object exist, without a place yet."""

    def recall(self, name: str, world_pose: Pose, *, held: bool = False) -> None:
        """Believe again that an object is somewhere."""

    def recall_gone(self, name: str) -> None:
        """Believe again that an object was taken out of the scene."""

    def recall_seen(self, name: str, world_pose: Pose, stamp: float, camera: str) -> None:
        """Take over where and when an object was last seen by an earlier run."""

    def recall_explanation(self, changes: tuple[ExplainedChange, ...], time: float, now: float) -> None:
        """Take over an explanation of an earlier run."""

    def recall_support(self, relation: Relation, since: float, now: float, source: str) -> None:
        """Believe again that an object has been resting on another one."""

    def recall_contents(self, relation: Relation, since: float, now: float) -> None:
        """Believe again that an object has been in another one."""

    def remove(self, name: str) -> None:
        """Forget an object or a fixture."""

    def observe(self, sights: Sequence[SeenObject]) -> Mapping[str, str]:
        """Take in what cameras see; return why something cannot be used, by the name of the object."""

    def set_visibility(self, visibility: VisibilityQuery | None) -> None:
        """Use `visibility` from now on for the objects that cameras should see."""

    def doubt_cameras(self, in_doubt: Collection[str], *, standing: Collection[str]) -> None:
        """Know of which cameras somebody finds out if they have moved, or has found out that they have not."""

    def flag(self, names: Collection[str]) -> None:
        """Take in the names of the objects that are surprising."""

    def plan(self, relations: Collection[Relation]) -> None:
        """Take in the relations that a plan is establishing now."""

    def hold(self, grasps: Mapping[str, GripperGrasp]) -> None:
        """Take in the objects that grippers hold."""

    def touch(self, hands: Mapping[str, HandPercept]) -> None:
        """Take in the percepts of human hands."""

    def recall_grasp(self, relation: Relation, grasp: HandGrasp, now: float) -> None:
        """Believe again that a hand touches an object."""

    def grasps(self) -> Mapping[Relation, HandGrasp]:
        """Objects that human hands touch, by (hand, object)."""

    def let_go(self) -> Mapping[Relation, LetGo]:
        """How the last hold of each object ended that no human hand holds now, by (hand, object)."""

    def deeds(self, name: str) -> tuple[Deed, ...]:
        """What hands and grippers did with an object last, oldest first."""

    def recall_deeds(self, name: str, deeds: Sequence[Deed]) -> None:
        """Believe again what was done with an object."""

    def step(self, now: float) -> None:
        """Bring the belief to time `now` (s)."""

    def pose(self, name: str) -> Pose | None:
        """world_from_object; None while its place is unknown."""

    def islands(self) -> Sequence[Island]:
        """All objects that were ever seen, as weighted worlds. The simulated world is one of them, mostly the best."""

    def probability(self, kind: str, relation: Relation) -> float:
        """Probability of a relation `on`, `in` (object, other) or `grasping` (hand, object), by the weighted worlds."""

    def solids(self) -> list[Solid]:
        """Solids of all objects that have a place, at their believed poses."""

    def scene(self) -> RolloutScene:
        """The present scene: all bodies that have a place."""

    def supports(self) -> Mapping[Relation, float]:
        """Pairs (object, support) that hold, with the time (s) since when."""

    def contents(self) -> Mapping[Relation, float]:
        """Pairs (object, container) that hold, with the time (s) since when."""

    def source(self, relation: Relation) -> str:
        """The source of a relation that holds."""

    def plausible(self, name: str) -> bool:
        """Whether the percept of an object is physically possible."""

    def is_gone(self, name: str) -> bool:
        """Whether the object is believed to have been taken out of the scene."""

    def explanations(self) -> list[tuple[float, Explanation]]:
        """Explanations since the last call, with the time (s) of each."""
