"""What proposes and weighs worlds: the simulated world, percepts, hands and cameras at one moment."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from statistics import fmean
from typing import NamedTuple

import numpy as np

from dsr.math3d import quaternions
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose
from dsr.perception.scales import PRESENT
from simulation_handler.config import BeliefConfig
from simulation_handler.contact.containment import Containment, is_in
from simulation_handler.contact.relations import ContactRelations, Relation, SupportedPose
from simulation_handler.contact.stances import OtherStance
from simulation_handler.explaining import VisibilityQuery
from simulation_handler.explaining.recognition import recognised_about
from simulation_handler.hands.touching import Touching
from simulation_handler.motion.movers import Movers
from simulation_handler.perception.estimate import Estimate
from simulation_handler.perception.percepts import Array, WeighedPercept
from simulation_handler.perception.ways import by_way
from simulation_handler.shapes.geometry import Solid
from simulation_handler.state.bodies import FLOOR, Bodies
from simulation_handler.state.objects import BelievedObject
from simulation_handler.worlds.carriers import Carriers
from simulation_handler.worlds.model import innermost_first
from simulation_handler.worlds.parameters import learned_parameters
from simulation_handler.worlds.spread import all_with_world_covariances, with_world_covariances


@dataclass(frozen=True)
class HandEvidence:
    """A human hand at one moment."""

    pose: Pose
    """world_from_hand when it was last seen, with that stamp (s)"""
    is_seen: bool
    """Whether it is in sight now."""
    fingertips: tuple[Vector3, ...]
    """(n, 3) m, world, of those that are measured"""


@dataclass(frozen=True)
class ObjectEvidence:
    """What is known of one object at one moment."""

    solid: Solid | None
    """The object as the simulation has it; None while it has no place there"""
    believed: Pose | None
    """world_from_object there, with covariance where perception led to it"""
    velocity: Vector3
    """(3,) m/s of its body in the simulation"""
    percept: Pose | None
    """world_from_object of the newest percept, with stamp (s) and the covariance of its noise; None if there is none"""
    is_recognised: bool
    """Whether that percept is recent."""
    agreeing: int
    """Percepts that are averaged in its estimate, at most those of a window; 0 without one"""
    is_moving: bool
    """Whether the newest percepts contradict each other, or where it is believed to be: that is not explained yet."""
    seen: Pose | None = None
    """world_from_object as perception alone has it, with covariance; None while it is not recognised"""
    seen_by: frozenset[str] = frozenset()
    """Names of the cameras that have seen it lately"""
    seen_from: Vector3 | None = None
    """(3,) m, world: where the camera of the newest percept is believed to be; None if nobody knows"""
    is_doubted: bool = False
    """Whether only cameras that may have moved tell of it."""
    is_sure: bool = False
    """Whether a camera sees it that is known not to have moved."""
    gone: bool = False
    """Whether the simulation has it taken out of the scene."""
    driven: bool = False
    """Whether it is driven along its seen path."""
    set_out_from: Pose | None = None
    """world_from_object where it was before it was driven, with covariance; None if it is not, or a hand moves it"""
    near_hand: bool = False
    """Whether a hand is within reach of where it was seen last."""
    is_missing: bool = False
    """Whether it should be seen where it is believed to be, and is not: that is not explained yet."""
    by_way: float = 0.0
    """nats by which its percepts tell rather that it got on bit by bit than at once"""
    rides: bool = False
    """Whether it is in or on something that is driven."""
    hovers: bool = False
    """Whether it is held in the air, and nothing known holds it."""
    hand: str = ""
    """Name of the human hand that holds it; empty for none"""
    gripper: str = ""
    """Name of the gripper that holds it; empty for none"""
    containers: tuple[str, ...] = ()
    """Names of all that it is in, innermost first"""
    supports: tuple[str, ...] = ()
    """Names of what it rests on, but for the floor"""
    touched_by: tuple[str, ...] = ()
    """Names of the human hands that touch it, sorted"""
    held_by: tuple[str, ...] = ()
    """Names of the human hands that may hold it by what is known of their fingertips, sorted"""
    aloft: bool = False
    """Whether it is seen in the air."""
    opens: bool = False
    """Whether the fingertips of the hand that holds it are seen apart from it just now."""
    let_go_at: float = -np.inf
    """s, when a hand was last known to let go of it"""
    aslant: tuple[float, Pose] | None = None
    """Probability that it leans, and world_from_object as perceived then, with covariance.

    The systematic error of its percepts is that of other objects: its own is learned from how it is taken to rest."""
    otherwise: tuple[OtherStance, ...] = ()
    """How it may rest instead of as `believed`, if its percepts do not tell"""

    late: float = 0.0
    """s by which the camera that saw it last is late"""
    courses: tuple[SupportedPose, ...] = ()
    """Where it is by each course on which it may be, if it vanished on its way; each is as probable"""

    @property
    def seen_at(self) -> float:
        """s, when it was seen last, as far as cameras have told; -inf if it never was."""
        return -np.inf if self.percept is None else self.percept.stamp + self.late

    @property
    def container(self) -> str:
        """Name of the innermost container; empty for none."""
        return self.containers[0] if self.containers else ""


@dataclass(frozen=True)
class Evidence:
    """All that is known at one moment."""

    now: float
    """s"""
    objects: Mapping[str, ObjectEvidence]
    hands: Mapping[str, HandEvidence]
    visibility: VisibilityQuery | None
    """What cameras should see; None without one"""
    contents: frozenset[Relation]
    """Pairs (object, container), as things are at this moment"""
    fixtures: tuple[Solid, ...] = ()
    """Tables and the floor"""

    def shown(self) -> list[float]:
        """s, when each object was seen last, as far as the camera that tells soonest has told."""
        things = [(thing.percept.stamp, thing.late) for thing in self.objects.values() if thing.percept is not None]
        soonest = min((late for _, late in things), default=0.0)
        return [stamp + soonest for stamp, _ in things]

    def has_vanished_alone(self, name: str) -> bool:
        """Whether others were seen later than an object, all of them where they are believed: none is known to hide it.

        What is seen elsewhere than believed, which is not explained yet, may be before it.
        """
        seen = {key: thing.percept for key, thing in self.objects.items() if thing.percept is not None}
        newest = max((percept.stamp for key, percept in seen.items() if key != name), default=-math.inf)
        is_settled = not any(thing.is_moving for key, thing in self.objects.items() if key != name)
        return is_settled and newest - seen[name].stamp > PRESENT

    def hands_free_of_others(self, name: str) -> dict[str, HandEvidence]:
        """The hands that hold nothing but perhaps this object: one that holds something takes nothing else."""
        busy = {other.hand for key, other in self.objects.items() if key != name}
        return {hand: known for hand, known in self.hands.items() if hand not in busy}

    def beneath(self, name: str) -> list[Solid]:
        """All that an object may lie on: what no hand holds, and what is not in the object."""
        without = self.not_beneath(name)
        return [*self.fixtures, *(solid for solid in self._free() if solid.name not in without)]

    def _free(self) -> list[Solid]:
        """The objects that no hand holds."""
        free = (thing.solid for thing in self.objects.values() if not (thing.hand or thing.gripper))
        return [solid for solid in free if solid is not None]

    @cached_property
    def carriers(self) -> Carriers:
        """All that things may lie on: what no hand holds."""
        return Carriers([*self.fixtures, *self._free()])

    def not_beneath(self, name: str) -> frozenset[str]:
        """Names of what an object does not lie on: itself, and what is in it."""
        return frozenset({name, *(key for key, container in self.contents if container == name)})

    def containers_at(self, name: str, place: Vector3) -> tuple[str, ...]:
        """Names of what an object would be in at a place (m), innermost first."""
        thing = self.objects[name].solid
        radius = 0.0 if thing is None else thing.radius
        solids = [other.solid for key, other in self.objects.items() if key != name and other.solid is not None]
        around = [solid for solid in solids if solid.is_hollow and is_in(place, radius, solid)]
        return tuple(solid.name for solid in sorted(around, key=lambda solid: solid.radius))


class _Moment(NamedTuple):
    """What is read of all objects at once."""

    now: float
    """s"""
    contents: frozenset[Relation]
    """Pairs (object, container)"""
    below: Mapping[str, tuple[str, ...]]
    """Names of what each object rests on"""
    touches: Sequence[Relation]
    """Pairs (hand, object), sorted"""
    holds: Sequence[Relation]
    """Those of them that may hold it"""
    displaced: Collection[str]
    """Objects that are seen elsewhere than believed, which is not explained yet"""
    doubted: frozenset[str]
    """Objects of which only cameras tell that may have moved"""
    sure: frozenset[str]
    """Objects that a camera sees that is known not to have moved"""
    missing: Collection[str]
    """Objects that should be seen, and are not"""
    places: Mapping[str, Pose]
    """world_from_object of each body"""
    believed: Mapping[str, Pose]
    """As `ObjectEvidence.believed`"""
    seen: Mapping[str, Pose]
    """As `ObjectEvidence.seen`"""
    percepts: Mapping[str, Pose]
    """As `ObjectEvidence.percept`"""


class EvidenceReader:
    """Takes the evidence from the parts of a belief.

    Args:
        bodies: of the simulation.
        relations: by contact.
        containment: what is in what.
        touching: what hands do.
        lead: gives (3,) m that an object is beyond its body, by name.
        in_doubt: gives the names of objects of which only cameras tell at a time (s) that may have moved.
        config: how far percepts are trusted.
        courses: gives where an object may be by now that vanished on its way, by name.
        displaced: gives the names of the objects that are seen elsewhere than believed.
        sure: gives the names of the objects that a camera sees at a time (s) that is known not to have moved.
        set_out_from: gives where a driven object was before, by name, if no hand moves it.
        missing: gives the names of the objects that should be seen at a time (s), and are not.
    """

    def __init__(
        self,
        bodies: Bodies,
        relations: ContactRelations,
        containment: Containment,
        touching: Touching,
        lead: Callable[[str], Vector3],
        in_doubt: Callable[[float], frozenset[str]],
        config: BeliefConfig,
        courses: Callable[[str], tuple[SupportedPose, ...]] = lambda name: (),
        displaced: Callable[[], Collection[str]] = tuple,
        sure: Callable[[float], frozenset[str]] = lambda now: frozenset(),
        set_out_from: Callable[[str], Pose | None] = lambda name: None,
        missing: Callable[[float], Collection[str]] = lambda now: (),
    ) -> None:
        self._bodies = bodies
        self._courses = courses
        self._displaced = displaced
        self._lead = lead
        self._in_doubt = in_doubt
        self._sure = sure
        self._set_out_from = set_out_from
        self._missing = missing
        self._config = config
        self._relations = relations
        self._containment = containment
        self._touching = touching
        self._movers = Movers(bodies.objects, touching.hands)
        self._reach = learned_parameters().elsewhere.level

    def read(self, now: float) -> Evidence:
        """The evidence of time `now` (s), after a step of the belief."""
        contents = frozenset(self._containment.found)
        below: dict[str, tuple[str, ...]] = {}
        for upper, lower in self._relations.current():
            if lower != FLOOR:
                below[upper] = (*below.get(upper, ()), lower)
        places = {name: self._bodies.pose(name) for name in self._bodies.objects if name in self._bodies.sim}
        moment = _Moment(
            now, contents, below, sorted(self._touching.grasps), sorted(self._touching.holds), self._displaced(),
            self._in_doubt(now), self._sure(now), self._missing(now), places, self._believed(places, now),
            self._seen(now), self._percepts(),
        )  # fmt: skip
        objects = {name: self._read_object(item, moment) for name, item in self._bodies.objects.items()}
        hands = {
            name: HandEvidence(hand.path.last, hand.perceived, tuple(path.last.t for path in tips))
            for name, hand in self._touching.hands.items()
            if hand.path.newest > -np.inf
            for tips in [[path for path in hand.tips.values() if hand.measures(path)]]
        }
        fixtures = tuple(self._bodies.fixtures.values())
        return Evidence(now, objects, hands, self._touching.visibility, contents, fixtures)

    def _read_object(self, item: BelievedObject, moment: _Moment) -> ObjectEvidence:
        name, now, estimate, pose = item.name, moment.now, item.track.estimate, moment.places.get(item.name)
        is_moving = item.track.is_restless or name in moment.displaced
        return ObjectEvidence(
            solid=None if pose is None else self._bodies.solid(name),
            believed=moment.believed.get(name),
            velocity=(0.0, 0.0, 0.0) if pose is None or item.static else self._bodies.sim.velocity(name)[0],
            percept=moment.percepts.get(name),
            is_recognised=item.track.is_fresh(now),
            agreeing=0 if estimate is None else estimate.count,
            is_moving=is_moving,
            seen=moment.seen.get(name),
            seen_by=item.cameras_at(now - item.track.late),
            seen_from=item.seen_from,
            is_doubted=name in moment.doubted,
            is_sure=name in moment.sure,
            gone=item.gone,
            driven=item.driven,
            set_out_from=self._set_out(item),
            near_hand=item.track.newest is not None and self._movers.has_hand_near(item),
            is_missing=name in moment.missing,
            by_way=self._by_way(item, pose) if item.driven or is_moving else 0.0,
            rides=item.rides,
            hovers=item.static and not item.holder,
            hand=item.hand,
            gripper=item.holder,
            containers=innermost_first(name, moment.contents),
            supports=moment.below.get(name, ()),
            touched_by=tuple(hand for hand, thing in moment.touches if thing == name),
            held_by=tuple(hand for hand, thing in moment.holds if thing == name),
            aloft=item.is_in_air,
            opens=bool(item.hand) and self._touching.opens((item.hand, name)),
            let_go_at=item.let_go_at,
            aslant=None if item.is_led or item.hand or item.estimate_at(now) is None else _aslant(item),
            late=item.track.late,
            courses=self._courses(name),
            otherwise=() if pose is None else _otherwise(item, pose, self._config),
        )

    def _by_way(self, item: BelievedObject, pose: Pose | None) -> float:
        """As `ObjectEvidence.by_way`."""
        before = self._set_out_from(item.name) or pose
        if before is None or item.noise == 0.0:
            return 0.0
        offsets = np.array([percept.t for percept in item.path.since(-math.inf)]).reshape(-1, 3) - before.t
        return by_way(offsets, item.noise**2 / len(before.t), self._reach)

    def _set_out(self, item: BelievedObject) -> Pose | None:
        """As `ObjectEvidence.set_out_from`."""
        pose = self._set_out_from(item.name)
        known = None if pose is None else item.covariances()
        return pose if pose is None or known is None else with_world_covariances(pose, *known)

    def _believed(self, places: Mapping[str, Pose], now: float) -> dict[str, Pose]:
        """world_from_object, with the covariance of perception: the pose of its body and how far it is beyond that."""
        believed: dict[str, Pose] = {}
        for name, pose in places.items():
            lead = self._lead(name)
            position = pose.t[0] + lead[0], pose.t[1] + lead[1], pose.t[2] + lead[2]
            believed[name] = Pose.unchecked(position, pose.q, now)
        told = ((name, self._bodies.objects[name].covariances()) for name in places)
        return believed | _with_covariances({name: (believed[name], *both) for name, both in told if both is not None})

    def _percepts(self) -> dict[str, Pose]:
        """world_from_object of the newest percept of each object, with its covariance."""
        found = ((name, item.track.newest) for name, item in self._bodies.objects.items())
        newest = {name: one for name, one in found if one is not None}
        return _with_covariances({
            name: (_pose_of(one, self._bodies.objects[name]), one.position_covariance, one.rotation_covariance)
            for name, one in newest.items()
        })  # fmt: skip

    def _seen(self, now: float) -> dict[str, Pose]:
        """world_from_object by the percepts that agree, or by the newest one if it does not, with its covariance."""
        seen: dict[str, tuple[Pose, Array, Array]] = {}
        for name, item in self._bodies.objects.items():
            if (stray := item.track.stray_at(now)) is not None:
                alone = Estimate(stray, self._config)
                place = alone.total_covariance(item.error_std(self._config))
                seen[name] = _pose_of(stray, item), place, alone.total_turning()
            elif item.estimate_at(now) is not None:
                solid = item.percept()
                pose = Pose.unchecked(solid.position, solid.rotation, item.track.last_stamp)
                seen[name] = pose, item.percept_covariance(self._config), item.turning()
        return _with_covariances(seen)


def _with_covariances(told: Mapping[str, tuple[Pose, Array, Array]]) -> dict[str, Pose]:
    """Poses with covariances (3, 3) of position and rotation in the world frame."""
    if not told:
        return {}
    poses, places, turns = zip(*told.values(), strict=True)
    return dict(zip(told, all_with_world_covariances(poses, np.array(places), np.array(turns)), strict=True))


def _otherwise(item: BelievedObject, pose: Pose, config: BeliefConfig) -> tuple[OtherStance, ...]:
    """How a thing at rest may rest instead; none once it does not stand as percepts had it."""
    if item.stance is None or item.shows_stance or item.is_led or item.hand:
        return ()
    down, before = (quaternions.rotate(quaternions.conjugate(q), (0.0, 0.0, 1.0)) for q in (pose.q, item.stance))
    return item.otherwise if math.dist(down, before) < config.tilt_tolerance else ()


def _aslant(item: BelievedObject) -> tuple[float, Pose] | None:
    """Where a thing is perceived if it leans, and how probable that is."""
    if item.aslant is None:
        return None
    chance, seen = item.aslant
    pose = Pose.unchecked(seen.solid.position, seen.solid.rotation, item.track.last_stamp)
    return chance, with_world_covariances(pose, seen.covariance, seen.turning)


def _pose_of(percept: WeighedPercept, item: BelievedObject) -> Pose:
    """A percept without its known systematic error."""
    x, y, z = item.corrected(percept).tolist()
    return Pose.unchecked((x, y, z), percept.rotation, percept.stamp)


SharesQuery = Callable[[Evidence, Mapping[str, Sequence[Solid]]], dict[str, list[float]]]
"""From evidence, and objects at places where each may be, by its name, to shares (0 to 1) as of `seen_shares`."""


def _hiding(thing: ObjectEvidence, solid: Solid) -> Solid:
    """A thing where it hides others: where it is seen, while that is elsewhere than the simulation has it."""
    seen = thing.seen if thing.is_moving else None
    return solid if seen is None else solid.at(seen.t, seen.q)


def seen_shares(evidence: Evidence, places: Mapping[str, Sequence[Solid]]) -> dict[str, list[float]]:
    """Share (0 to 1) of the frames in which the camera that sees most of an object should recognise it about places.

    Everything else is where it is seen, or else where the simulation has it, and what is in an object is left out.
    """
    visibility = evidence.visibility
    if visibility is None:
        return {name: [0.0] * len(there) for name, there in places.items()}
    holding = {container for _, container in evidence.contents}
    among = {name: _hiding(thing, thing.solid) for name, thing in evidence.objects.items() if thing.solid is not None}
    found: dict[str, list[float]] = {}
    at_once = [name for name in places if name not in holding]
    for asked in (*([at_once] if at_once else []), *([name] for name in places if name in holding)):
        others = [solid for name, solid in among.items() if (name, asked[0]) not in evidence.contents]
        told = iter(recognised_about([solid for name in asked for solid in places[name]], others, visibility))
        for name in asked:
            found[name] = [max(map(fmean, next(told).values()), default=0.0) for _ in places[name]]
    return found
