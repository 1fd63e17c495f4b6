"""The belief: a physics simulation that perception keeps in step with the world.

Each step, what was perceived is fused over time (tracking), made physically plausible (placement) and put into
the simulation where it differs from what is there (correction), or explained where it differs too much for that
(explainer); then time passes. What is not seen obeys physics alone, and what a gripper holds goes where that goes
(holding).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Mapping, Sequence

from dsr.math3d.quaternions import Vector3
from dsr.math3d.shapes import Shape
from dsr.math3d.tolerance import PoseTolerance
from dsr.math3d.transforms import Pose
from dsr.perception.consensus import tells_rotation
from dsr.vocabulary.explained import ExplainedChange
from dsr.vocabulary.observed_actions import Deed
from simulation_handler.config import BeliefConfig
from simulation_handler.contact.containment import Containment
from simulation_handler.contact.relations import ContactRelations, Relation, resting
from simulation_handler.explaining import ExplainingPolicy, Explanation, VisibilityQuery, make_policy
from simulation_handler.explaining.explainer import Explainer
from simulation_handler.hands.deeds import Deeds
from simulation_handler.hands.fingers import Fingers
from simulation_handler.hands.letting_go import LetGo
from simulation_handler.hands.state import HandGrasp, HandPercept
from simulation_handler.hands.touching import Touching
from simulation_handler.motion.correction import Correction
from simulation_handler.motion.courses import Courses
from simulation_handler.motion.driving import Driving
from simulation_handler.motion.holding import GripperGrasp, HeldObjects
from simulation_handler.motion.spilling import Spilling
from simulation_handler.perception.lateness import Lateness
from simulation_handler.perception.percepts import SeenObject, WeighedPercept, flaws, weighed
from simulation_handler.perception.tracking import Given, PerceptTrack
from simulation_handler.physics.rollouts.scene import Placing, RolloutScene
from simulation_handler.physics.simulator import MOST_STEPS, TIME_STEP
from simulation_handler.shapes.geometry import Solid
from simulation_handler.state.bodies import FLOOR, Bodies
from simulation_handler.state.objects import BelievedObject
from simulation_handler.worlds.evidence import Evidence, EvidenceReader
from simulation_handler.worlds.following import WeightFollowing
from simulation_handler.worlds.model import Island, probability
from simulation_handler.worlds.parameters import learned_parameters
from simulation_handler.worlds.weighted import WeightedWorlds


class Belief:
    """The believed poses and supports of objects, by perception and physics.

    Args:
        config: tolerances.
        policy: explains what is surprising; default: the one that `config` names, in this process.
    """

    def __init__(self, config: BeliefConfig | None = None, policy: ExplainingPolicy | None = None) -> None:
        self.config = config or BeliefConfig()
        self._bodies = Bodies(self.config)
        self._correction = Correction(self._bodies, self.config)
        self._relations = ContactRelations(self.config.relation_delay)
        self._containment = Containment(self.config.relation_delay)
        self._touching = Touching(self._bodies, self._containment)
        self._driving = Driving(self._bodies, self._relations, self._containment, self._touching.hands, self.config)
        self._fingers = Fingers(self._bodies, self._touching, self._containment)
        self._deeds = Deeds(self._bodies, self._touching, self._relations, self._containment)
        self._holding = HeldObjects(self._bodies)
        self._spilling = Spilling(self._bodies)
        self._courses = Courses(self._bodies, self.config)
        policy = policy or make_policy(self.config)
        self._explainer = Explainer(self._bodies, self._relations, policy, self.config, self._containment)
        self._explainer.take = self._touching.take
        self._evidence = EvidenceReader(
            self._bodies, self._relations, self._containment, self._touching, self._driving.lead,
            self._explainer.in_doubt, self.config, self._courses.of, lambda: self._explainer.waiting,
            self._explainer.sure, self._driving.set_out_from, self._explainer.missing,
        )  # fmt: skip
        self._worlds = WeightedWorlds(learned_parameters())
        self._following = WeightFollowing(self._bodies, self._relations, self._worlds)
        self._places: dict[str, tuple[Placing, Pose]] = {}
        """Where the body of each object was at the last step, and world_from_object then"""
        self._lateness = Lateness()
        self._now: float | None = None

    def close(self) -> None:
        """Free the simulation."""
        self._explainer.close()
        self._spilling.close()
        self._courses.close()
        self._correction.close()
        self._bodies.sim.close()

    def __contains__(self, name: str) -> bool:
        return name in self._bodies.objects

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all objects, also of those whose place is unknown yet."""
        return tuple(self._bodies.objects)

    def set_fixture(
        self, name: str, size: Vector3, pose: Pose, shape: Shape = (), friction: float | None = None
    ) -> None:
        """Add a body that never moves, such as a table, or put it elsewhere.

        Args:
            name: not that of an object.
            size: (3,) edge lengths, m.
            pose: world_from_centre.
            shape: its pieces; none for a solid box.
            friction: Coulomb coefficient; None for the default one.
        """
        self._bodies.set_fixture(name, size, pose, shape, friction)

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
        """Let an object exist; it takes part in the simulation once it has a place.

        Args:
            name: not in use yet.
            size: (3,) edge lengths of its bounding box, m.
            shape: its pieces; none for a solid box.
            mass: kg.
            friction: Coulomb coefficient.
            rolling_friction: m, lever arm of the resistance to rolling.
            tagged: whether it is recognised by a tag.

        Raises:
            SimulationError: for a name in use.
        """
        self._bodies.add_object(name, size, mass, friction, shape, rolling_friction=rolling_friction, tagged=tagged)

    def recall(self, name: str, world_pose: Pose, *, held: bool = False) -> None:
        """Believe again that an object is at `world_pose`, and `held` there by something unknown or not."""
        item = self._bodies.object(name)
        self._bodies.put(item, world_pose.t, world_pose.q)
        self._bodies.set_static(item, held)
        item.track.forget()

    def recall_gone(self, name: str) -> None:
        """Believe again that an object was taken out of the scene: only new percepts bring it back."""
        item = self._bodies.object(name)
        item.track.forget()
        item.gone = True

    def recall_seen(self, name: str, world_pose: Pose, stamp: float, camera: str) -> None:
        """Know that a camera last saw an object there at a time (s), of which the belief that was recalled was made."""
        self._bodies.object(name).recall_seen(world_pose, stamp, camera)

    def recall_explanation(self, changes: tuple[ExplainedChange, ...], time: float, now: float) -> None:
        """Take over at time `now` (s) an explanation that an earlier run made at another `time` (s)."""
        self._explainer.recall(changes, time, now)

    def recall_support(self, relation: Relation, since: float, now: float, source: str) -> None:
        """Believe again that an object has been resting on another one `since` (s), as `source` said."""
        self._relations.recall(relation, since, now, source)

    def recall_contents(self, relation: Relation, since: float, now: float) -> None:
        """Believe again that an object has been in a container `since` (s)."""
        self._containment.recall(relation, since, now)

    def remove(self, name: str) -> None:
        """Forget an object or a fixture; what rested on it falls. Harmless if there is none."""
        self._holding.forget(name)
        self._touching.forget(name)
        self._deeds.forget(name)
        self._bodies.remove(name)
        self._relations.forget(name)
        self._containment.forget(name)

    def observe(self, sights: Sequence[SeenObject]) -> dict[str, str]:
        """Take in what cameras see; return why something cannot be used, by the name of the object.

        What is not newer than the last of its object is ignored. What a camera in doubt says of an object that another
        one sees does not count.
        """
        problems, turns = dict[str, str](), list[list[SeenObject]]()
        counts: Counter[str] = Counter()
        for sight, flaw in zip(sights, flaws(sights), strict=True):
            if flaw or sight.name not in self._bodies.objects:
                problems[sight.name] = flaw or f"no object {sight.name!r} in the belief"
                continue
            self._lateness.hear(sight.camera, sight.stamp)
            if counts[sight.name] == len(turns):
                turns.append([])
            turns[counts[sight.name]].append(sight)
            counts[sight.name] += 1
        for turn in turns:
            self._observe(turn)
        return problems

    def _observe(self, sights: Sequence[SeenObject]) -> None:
        """Take in what cameras see of objects, of each at most once."""
        doubted = self._explainer.cameras_in_doubt
        seen = [(sight, self._bodies.objects[sight.name]) for sight in sights]
        seen = [one for one in seen if one[0].camera not in doubted or one[1].cameras_at(one[0].stamp) <= doubted]
        percepts = weighed([sight for sight, _ in seen], self.config)
        told = [(item, percept, sight) for (sight, item), percept in zip(seen, percepts, strict=True)]
        PerceptTrack.add(
            [
                Given(item.track, percept, item.track.estimate is None and self._is_expected(item, percept))
                for item, percept, _ in told
            ]
        )
        for item, percept, sight in told:
            item.note(percept, sight.camera, sight.seen_from)

    def _is_expected(self, item: BelievedObject, percept: WeighedPercept) -> bool:
        """Whether a percept shows an object where its body is, and as that is turned, if it tells that."""
        if item.is_led or item.name not in self._bodies.sim:
            return False
        x, y, z = percept.position.tolist()
        body, seen = self._bodies.pose(item.name), Pose.unchecked((x, y, z), percept.rotation, percept.stamp)
        turn = self.config.divergence_angle if tells_rotation(percept.rotation_covariance) else math.pi
        return PoseTolerance(self.config.hover_tolerance, turn).covers(body, seen)

    def set_visibility(self, visibility: VisibilityQuery | None) -> None:
        """Use `visibility` from now on for the objects that cameras should see; None without a camera."""
        self._explainer.visibility = self._touching.visibility = visibility

    def doubt_cameras(self, in_doubt: Collection[str], *, standing: Collection[str]) -> None:
        """Know of which cameras somebody finds out if they have moved, or has found out that they have not.

        Meanwhile nothing is explained that only the former tell of; what the latter see elsewhere has moved.
        """
        self._explainer.cameras_in_doubt, self._explainer.cameras_standing = frozenset(in_doubt), frozenset(standing)

    def flag(self, names: Collection[str]) -> None:
        """Take in the names of the objects that are surprising from now on; the others are not.

        Their displacements are explained soon.
        """
        self._explainer.flagged = frozenset(names)

    def plan(self, relations: Collection[Relation]) -> None:
        """Take in the relations (object, support) that a plan is establishing now."""
        self._explainer.planned = frozenset(relations)

    def hold(self, grasps: Mapping[str, GripperGrasp]) -> None:
        """Take in the objects, by name, that are in a gripper from now on; others are not."""
        self._holding.update(grasps)

    def touch(self, hands: Mapping[str, HandPercept]) -> None:
        """Take in the percepts of human hands, by name; other hands are not known any more."""
        self._touching.observe(hands)

    def recall_grasp(self, relation: Relation, grasp: HandGrasp, now: float) -> None:
        """Restore a grasp (hand, object) that an earlier run believed."""
        self._touching.recall(relation, grasp, now)

    def grasps(self) -> Mapping[Relation, HandGrasp]:
        """Objects that human hands may hold, by (hand, object)."""
        return self._touching.holds

    def let_go(self) -> Mapping[Relation, LetGo]:
        """How the last hold of each object ended that no human hand holds now, by (hand, object)."""
        return self._touching.let_go

    def deeds(self, name: str) -> tuple[Deed, ...]:
        """What hands and grippers did with an object last, oldest first."""
        return self._deeds.of(name)

    def recall_deeds(self, name: str, deeds: Sequence[Deed]) -> None:
        """Take over what an earlier run believed that was done with an object."""
        self._deeds.recall(name, deeds)

    def explanations(self) -> list[tuple[float, Explanation]]:
        """Explanations since the last call, with the time (s) of each."""
        return self._explainer.take_news()

    def is_gone(self, name: str) -> bool:
        """Whether the object is believed to have been taken out of the scene."""
        return self._bodies.object(name).gone

    def step(self, now: float) -> None:
        """Bring the belief to time `now` (s)."""
        late = self._lateness.update(now)
        for item in self._bodies.objects.values():
            item.note_lateness(late)
        self._touching.update(now)
        self._correction.leave_to_physics(now, self._let_go(now))
        staying = self._worlds.staying() - self._explainer.sure(now)
        self._driving.update(now, staying, self._explainer.in_doubt(now), self._explainer.missed(now))
        self._explainer.notice(now)
        self._correction.follow_perception(now, self._explainer.waiting)
        self._explainer.drag(now)
        self._explainer.explain(now)
        if self._now is not None and now > self._now:
            count = min(round((now - self._now) / TIME_STEP), MOST_STEPS)
            self._fingers.update(now, count, self._explainer.waiting)
            self._driving.step(count)
            self._fingers.note_pushes()
        self._now = now
        self._bodies.note_stances()
        self._explainer.settle_relations(now)
        unmoving = self._driving.supports | self._correction.supports
        self._relations.update(resting(self._bodies.sim.contacts()) | unmoving, now)
        self._containment.update(self.solids(), now)
        self._spilling.update(self._containment.current(), self._containment.left, now)
        self._courses.update(now)
        self._worlds.update(self.evidence())
        self._following.update(self._explainer.expected)
        known = self._worlds.poses()
        bodies = {name: self._bodies.sim.pose(name) for name in self._bodies.objects if name in self._bodies.sim}
        self._places = {name: (body, self._located(name, body, known.get(name))) for name, body in bodies.items()}
        places = {name: self._places[name][1] if name in self._places else None for name in self._bodies.objects}
        self._deeds.update(places, self._explainer.in_doubt(now), self._worlds.worlds, now)

    def _let_go(self, now: float) -> set[str]:
        """What nobody can hold where it is: what should be seen there, and what is in a container without a hand."""
        return {*self._explainer.missing(now), *(name for name, _ in self._containment.current())}

    def pose(self, name: str) -> Pose | None:
        """world_from_object at the last step, with covariance; None while its place is unknown.

        Of what is on its way, that is where it is by now: its body follows a little late.
        """
        if self._bodies.object(name).name not in self._bodies.sim:
            return None
        body, known = self._bodies.sim.pose(name), self._places.get(name)
        if known is not None and known[0] == body:
            return known[1]
        return self._located(name, body, self._worlds.pose(name))  # it was put there since

    def _located(self, name: str, body: Placing, known: Pose | None) -> Pose:
        """world_from_object by the place of its body, with the covariance of what is `known` of the object."""
        position, rotation = body
        lead = self._driving.lead(name)
        position = position[0] + lead[0], position[1] + lead[1], position[2] + lead[2]
        return Pose.unchecked(position, rotation, self._now or 0.0, None if known is None else known.cov)

    def evidence(self) -> Evidence:
        """All by which worlds are proposed and weighed, at the last step."""
        return self._evidence.read(self._now or 0.0)

    def islands(self) -> Sequence[Island]:
        """All objects that were ever seen, as weighted worlds. The simulated world is one of them, mostly the best."""
        return self._worlds.islands()

    def probability(self, kind: str, relation: Relation) -> float:
        """Probability of a relation `on`, `in` (object, other) or `grasping` (hand, object), by the weighted worlds."""
        return probability(self.islands(), kind, relation)

    def solids(self) -> list[Solid]:
        """Solids of all objects that have a place, at their believed poses."""
        return [self._bodies.solid(name) for name in self._bodies.objects if name in self._bodies.sim]

    def scene(self) -> RolloutScene:
        """All that has a place, fixtures and floor too, as it is now: to be simulated without disturbing the belief."""
        return self._bodies.frozen()

    def supports(self) -> dict[Relation, float]:
        """Pairs (object, support) that hold, with the time (s) since when; pairs with the floor are left out."""
        return {relation: since for relation, since in self._relations.current().items() if FLOOR not in relation}

    def contents(self) -> dict[Relation, float]:
        """(object, container that it is in) and since when (s)."""
        return self._containment.current()

    def source(self, relation: Relation) -> str:
        """The source of a relation: "contact" or "explanation"."""
        return self._relations.source(relation)

    def perceived(self, name: str, now: float) -> bool:
        """Whether the object was seen lately, at time `now` (s)."""
        return self._bodies.object(name).estimate_at(now) is not None

    def plausible(self, name: str) -> bool:
        """Whether the present percept of an object, if any, fits a physically possible pose, up to its noise."""
        item = self._bodies.object(name)
        if item.holder:
            return True
        if item.driven:
            return self._driving.rests(name)
        if item.static:
            return False
        estimate = item.estimate_at(self._now) if self._now is not None else item.track.estimate
        if estimate is None or name not in self._bodies.sim:
            return True
        apart = math.dist(estimate.position, self._bodies.sim.position(name))
        return apart <= self.config.hover_tolerance
