"""Keeps the weighted worlds of all objects: one and its doubt while an object is seen, and alternatives while not."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dsr.errors import ConfigError
from dsr.math3d.transforms import Pose
from dsr.perception.scales import FRAME, PRESENT
from simulation_handler.perception.bumped import MovedThing
from simulation_handler.scales import ROUNDING
from simulation_handler.worlds.alternatives import (
    COURSE,
    FOLLOWED,
    GONE,
    INSIDE_OF,
    LEFT,
    Alternatives,
    Mode,
    mode_circumstance,
    speed_of,
)
from simulation_handler.worlds.blackouts import Blackouts
from simulation_handler.worlds.circumstances import (
    CIRCUMSTANCES,
    DOUBTED,
    INSIDE,
    MOVED_UNSEEN,
    RESTLESS,
    RESTS_UNSEEN,
    hold,
    in_view,
    is_unseen,
    unseen,
)
from simulation_handler.worlds.displaced import Former, Staying, StayingOverTime, staying
from simulation_handler.worlds.evidence import Evidence, ObjectEvidence, SharesQuery, seen_shares
from simulation_handler.worlds.followed import (
    Followed,
    WeightedPose,
    WeightedState,
    or_aslant,
    otherwise,
    places_of,
    reached,
    staying_or_not,
    turned,
    with_places,
)
from simulation_handler.worlds.holders import UNKNOWN, shares_of_hold
from simulation_handler.worlds.islands import MOST_WORLDS, islands_of
from simulation_handler.worlds.merging import WeightedPlace, merged
from simulation_handler.worlds.model import Island, ObjectState, WeightedWorld
from simulation_handler.worlds.parameters import WorldParameters
from simulation_handler.worlds.spread import (
    squared_distance,
    with_spread,
    with_spreads,
    with_world_covariances,
)

ON_COURSE = "went on unseen"
"""Reason of a world in which what vanished on its way has gone on otherwise than the simulation has it"""
LOOK_PERIOD = 2.0 * FRAME
"""s between two times at which it is worked out what cameras should see of an unseen object: at every second image"""


@dataclass
class _Watched:
    """One object over time."""

    circumstance: str = ""
    """When it was recognised last"""
    seen: ObjectEvidence | None = None
    """The object then"""
    seen_at: float = -math.inf
    """s, that time"""
    alternatives: Alternatives | None = None
    """While it is not recognised"""
    was_doubted: bool = False
    """Whether cameras that saw it have been in doubt"""
    displaced: StayingOverTime = field(default_factory=StayingOverTime)
    """Whether it is where the simulation has it, or had it"""
    poses: list[Pose] = field(default_factory=list)
    """Where it was believed lately, oldest first"""

    def note(self, pose: Pose | None, now: float) -> None:
        """Keep where it is believed at `now` (s)."""
        if pose is not None:
            self.poses.append(pose)
        while len(self.poses) > 1 and self.poses[1].stamp <= now - LOOK_PERIOD:
            del self.poses[0]

    @property
    def velocity(self) -> NDArray[np.float64]:
        """(3,) m/s"""
        return speed_of(self.poses[0], self.poses[-1]) if self.poses else np.zeros(3)


class WeightedWorlds:
    """The belief as islands of weighted worlds, brought up to date by evidence.

    Args:
        parameters: what was learned.
        shares: how much cameras should see of an object in places.

    Raises:
        ConfigError: for parameters without the noise of some circumstance.
    """

    def __init__(self, parameters: WorldParameters, shares: SharesQuery = seen_shares) -> None:
        if missing := [name for name in CIRCUMSTANCES if name not in parameters.noise]:
            raise ConfigError(f"no learned noise for {', '.join(map(repr, missing))}; expected all circumstances")
        self._parameters = parameters
        self._moved = MovedThing(parameters.elsewhere.level, parameters.elsewhere.height)
        self._shares = shares
        self._watched: dict[str, _Watched] = {}
        self._evidence: Evidence | None = None
        self._blackouts = Blackouts(parameters.rates.work)
        self._returned: dict[str, tuple[_Places, _Places]] = {}
        self._ratios: dict[str, float] = {}
        self._poses: dict[str, Pose] | None = None

    def update(self, evidence: Evidence, names: Collection[str] | None = None) -> None:
        """Take in the evidence of a moment that is not before the last one, of the objects `names`, or of all."""
        self._note_returned(evidence)
        before, self._evidence, self._poses = self._evidence, evidence, None
        self._watched = {name: self._watched.get(name, _Watched()) for name in evidence.objects}
        if self._blackouts.begins(evidence):
            self._returned.clear()
            for name, alternatives in self._unseen().items():
                alternatives.settle(self._ratios.get(name, 1.0))
        work = self._blackouts.update(evidence, sum(one.unshown for one in self._unseen().values()))
        rather = {name: at for name, one in self._watched.items() if (at := one.displaced.rather_at) is not None}
        staying_now = staying(evidence, self._moved, rather)
        unseen_names: list[str] = []
        for name, thing in evidence.objects.items():
            if thing.percept is None or not (names is None or name in names):
                continue
            watched = self._watched[name]
            watched.note(thing.believed, evidence.now)
            if thing.gripper or not (is_unseen(thing, evidence.now) or thing.believed is None):
                watched.was_doubted |= thing.is_doubted
                stays = watched.displaced.note(thing, staying_now.get(name), evidence.now)
                watched.circumstance = in_view(thing, stays=stays, was_doubted=watched.was_doubted)
                watched.seen, watched.seen_at, watched.alternatives = thing, evidence.now, None
            elif watched.seen is not None:
                if watched.alternatives is None:
                    watched.alternatives = Alternatives(
                        self._parameters, watched.seen, watched.circumstance, watched.seen_at, self._blackouts.before,
                    )  # fmt: skip
                unseen_names.append(name)
        unseen = {name: found for name in unseen_names if (found := self._watched[name].alternatives) is not None}
        looking = self._looking(unseen, evidence.now - (evidence if before is None else before).now)
        for name, found in unseen.items():
            found.step(name, evidence, work)
        self._look({name: found for name, found in unseen.items() if name in looking}, evidence)
        for found in unseen.values():
            found.balance()
        self._hear_returned(evidence)

    def _look(self, unseen: Mapping[str, Alternatives], evidence: Evidence) -> None:
        """Take in that objects are not seen where cameras should see them: one question about all of them."""
        if not unseen:
            return
        blind = not any(evidence.now - shown < PRESENT for shown in evidence.shown())
        asked = {name: found.asked(name, evidence, blind=blind) for name, found in unseen.items()}
        shares = self._shares(evidence, asked)
        for name, found in unseen.items():
            found.miss(name, evidence, shares[name], blind=blind)

    def _unseen(self) -> dict[str, Alternatives]:
        """Alternatives of the objects that are not recognised."""
        return {name: one.alternatives for name, one in self._watched.items() if one.alternatives is not None}

    def _note_returned(self, evidence: Evidence) -> None:
        """Keep where each object that is seen again might have been, with somebody at work and without."""
        before = self._evidence
        for name, alternatives in self._unseen().items():
            thing = evidence.objects.get(name)
            if thing is None or before is None or name not in before.objects:
                continue
            if alternatives.odds is not None and not is_unseen(thing, evidence.now):
                modes = alternatives.modes.items()
                worked = {key: mode.weight * mode.worked for key, mode in modes}
                idle = {key: mode.weight - worked[key] for key, mode in modes}
                self._returned[name] = self._places(name, before, worked), self._places(name, before, idle)

    def _places(self, name: str, evidence: Evidence, weights: Mapping[str, float]) -> _Places:
        places = self._places_of((name,)).get(name, ())
        states = self._states(name, self._watched[name], evidence, weights, places)
        return [(weight, state.pose) for weight, state, _ in states if state.pose is not None]

    def _hear_returned(self, evidence: Evidence) -> None:
        """Where objects are seen again tells whether somebody was at work while cameras saw nothing."""
        for name, (worked, idle) in list(self._returned.items()):
            thing = evidence.objects.get(name)
            if thing is not None and thing.seen is not None and not (thing.is_moving or thing.gripper):
                self._blackouts.tell(
                    name, math.log(_density(worked, thing.seen)) - math.log(_density(idle, thing.seen))
                )
            elif thing is not None and not (thing.gripper or is_unseen(thing, evidence.now)):
                continue  # what a gripper has taken meanwhile tells nothing by where it is
            del self._returned[name]
        odds = {name: one.odds for name, one in self._unseen().items()}
        self._ratios = self._blackouts.ratios({name: value for name, value in odds.items() if value is not None})

    def _looking(self, unseen: Mapping[str, Alternatives], step: float) -> Collection[str]:
        """Names of the unseen objects whose visibility is worked out now, in turn: that takes most of the time."""
        most = math.ceil(len(unseen) * step / LOOK_PERIOD)
        waiting = [(found.looked, name) for name, found in unseen.items()]
        return {name for _, name in sorted(waiting)[:most]}

    def islands(self) -> list[Island]:
        """All objects that were ever seen, at the time of the last evidence."""
        places = self._places_of(self._watched)
        worlds = {name: found for name in sorted(self._watched) if (found := self._worlds(name, places.get(name, ())))}
        contents = () if self._evidence is None else self._evidence.contents
        unseen_contents = [pair for pair in sorted(contents) if self._watched[pair[0]].alternatives is not None]
        return islands_of(worlds, unseen_contents)

    def worlds(self, name: str) -> list[WeightedWorld]:
        """Those of one object, the most probable first; none if it was never seen."""
        return self._worlds(name, self._places_of((name,)).get(name, ()))

    def _worlds(self, name: str, places: Sequence[WeightedPose]) -> list[WeightedWorld]:
        """As `worlds`, of an object that the simulation has in these places."""
        watched, evidence = self._watched[name], self._evidence
        if evidence is None or watched.seen is None:
            return []
        alternatives = watched.alternatives
        weights = {} if alternatives is None else alternatives.weights(self._ratios.get(name, 1.0))
        states = sorted(self._states(name, watched, evidence, weights, places), key=lambda one: -one[0])[:MOST_WORLDS]
        total = sum(weight for weight, _, _ in states)
        return [WeightedWorld(weight / total, {name: state}, reason) for weight, state, reason in states]

    def followed(self, name: str) -> Followed | None:
        """How the place of an object in the simulation is known; None if it was never seen, or has none."""
        watched, evidence = self._watched[name], self._evidence
        if evidence is None or watched.seen is None:
            return None
        thing, alternatives = evidence.objects[name], watched.alternatives
        if alternatives is None:
            if thing.believed is None:
                return None
            found = Followed(
                watched.circumstance, thing.believed, watched.velocity, seen=thing.seen,
                stays=watched.displaced.stays if watched.circumstance in (DOUBTED, RESTLESS) else None,
            )  # fmt: skip
            return reached(found, thing) if watched.circumstance == RESTLESS else found
        pose = alternatives.modes[FOLLOWED].pose
        if pose is None:
            return None
        circumstance = unseen(thing, evidence, alternatives.moved, alternatives.before)
        return Followed(circumstance, pose, watched.velocity, evidence.now - thing.seen_at, alternatives.moved)

    def staying(self) -> frozenset[str]:
        """Things that rather are where they were than where they are seen now, for their camera has moved.

        Of a thing that is driven, that is where it has set out.
        """
        chances = {name: one.displaced.by_camera for name, one in self._watched.items()}
        return frozenset(name for name, by_camera in chances.items() if by_camera > 1.0 - by_camera)

    def leading(self, name: str) -> tuple[str, Mode] | None:
        """The mode of an unseen object that is more probable than all others together, by its kind; None without."""
        alternatives = self._watched[name].alternatives if name in self._watched else None
        if alternatives is None:
            return None
        weights = alternatives.weights(self._ratios.get(name, 1.0))
        return next(((key, alternatives.modes[key]) for key, weight in weights.items() if weight > 1.0 - weight), None)

    def pose(self, name: str) -> Pose | None:
        """world_from_object as the simulation has it, with the covariance of its circumstance; None if unknown."""
        return self.poses().get(name)

    def poses(self) -> dict[str, Pose]:
        """As `pose`, of all objects at once; those of which nothing is known are left out."""
        if self._poses is None:
            self._poses = self._all_poses()
        return self._poses

    def _all_poses(self) -> dict[str, Pose]:
        groups: dict[str, list[tuple[str, Followed]]] = {}
        for name in self._watched:
            if (followed := self.followed(name)) is not None:
                groups.setdefault(followed.circumstance, []).append((name, followed))
        found: dict[str, Pose] = {}
        for circumstance, members in groups.items():
            names, known = zip(*members, strict=True)
            ages, moved, reaches = np.array([(one.age, one.moved, one.reach) for one in known]).T
            velocities = np.array([one.velocity for one in known])
            noise = self._parameters.noise[circumstance]
            spread = with_spreads([one.pose for one in known], noise, ages, moved, velocities, reaches)
            found |= zip(names, spread, strict=True)
        return found

    def _places_of(self, names: Collection[str]) -> dict[str, list[WeightedPose]]:
        """Where the simulation has objects, more or less, or percepts have them; without those of which it has none."""
        groups: dict[str, list[tuple[str, Followed]]] = {}
        for name in names:
            if (followed := self.followed(name)) is not None:
                groups.setdefault(followed.circumstance, []).append((name, followed))
        found: dict[str, list[WeightedPose]] = {}
        for circumstance, members in groups.items():
            those, known = zip(*members, strict=True)
            placed, noise = [self.poses()[name] for name in those], self._parameters.noise[circumstance]
            found |= zip(those, places_of(known, noise, placed), strict=True)
        return found

    def _simulated(
        self, name: str, weight: float, thing: ObjectEvidence, places: Sequence[WeightedPose]
    ) -> list[WeightedState]:  # fmt: skip
        """What the simulation says, and that something unknown is wrong with it."""
        followed = self.followed(name)
        if followed is None:
            return []
        noise, placed = self._parameters.noise[followed.circumstance], self.poses()[name]
        x, y, z = followed.velocity.tolist()
        alternatives = self._watched[name].alternatives
        supports = thing.supports if alternatives is None else alternatives.modes[FOLLOWED].supports
        state = ObjectState(placed, (x, y, z), thing.gripper, thing.containers, supports)
        parts = with_places(state, places)
        if followed.stays is not None:
            others = self._otherwise(followed, thing, state)
            both = (parts, others) if followed.circumstance == DOUBTED else (others, parts)
            parts = staying_or_not(followed.stays, *both)
        parts = [one for part in parts for one in turned(part, thing)]
        if alternatives is None and (former := self._watched[name].displaced.former) is not None:
            parts = self._or_former(parts, former, state)
        if thing.aslant is not None:
            parts = or_aslant(parts, state, *thing.aslant, noise)
        hands = self._holders(name, thing, followed.circumstance) or {state.hand: 1.0}
        return [
            (weight * share * held, one if one.hand == hand else one._replace(hand=hand), reason)
            for share, one, reason in parts
            for hand, held in hands.items()
        ]

    def _otherwise(self, followed: Followed, thing: ObjectEvidence, state: ObjectState) -> list[WeightedState]:
        """The worlds of a thing that is seen displaced, if it is in the less probable circumstance."""
        one = otherwise(followed, thing)
        noise = self._parameters.noise[one.circumstance]
        placed = with_spread(one.pose, noise, one.age, one.moved, one.velocity, one.reach)
        return with_places(state, *places_of([one], noise, [placed]))

    def _or_former(self, parts: list[WeightedState], former: Former, state: ObjectState) -> list[WeightedState]:
        """Worlds of an object that the simulation has where it is seen, and those in which its camera moved instead."""
        noise, stays = self._parameters.noise[DOUBTED], former.stays
        pose = with_spread(former.pose, noise, 0.0, 0.0, np.zeros(3))
        there = with_places(state, *places_of([Followed(DOUBTED, former.pose, np.zeros(3))], noise, [pose]))
        return staying_or_not(Staying(stays.by_camera, stays.camera, stays.by_camera), there, parts)

    def _holders(self, name: str, thing: ObjectEvidence, circumstance: str) -> dict[str, float]:
        """Probabilities of the human hands that may hold an object, and that no known one does; empty if none may."""
        if thing.gripper or self._evidence is None:
            return {}
        hands = shares_of_hold(name, self._evidence, self._parameters.rates.taken)
        held = self._parameters.holding.get(hold(thing, circumstance), 0.0)
        told = {hand: held * share for hand, share in hands.items()}
        return told | {UNKNOWN: 1.0 - held + told.get(UNKNOWN, 0.0)} if hands else {}

    def _states(
        self, name: str, watched: _Watched, evidence: Evidence, weights: Mapping[str, float],
        places: Sequence[WeightedPose],
    ) -> list[WeightedState]:  # fmt: skip
        """Weighted states of an object, of one that is not recognised by the `weights` of its modes.

        The simulation has it at these `places`.
        """
        alternatives, thing = watched.alternatives, evidence.objects[name]
        if alternatives is None:
            return self._simulated(name, 1.0, thing, places)
        found: list[WeightedState] = []
        courses: dict[tuple[tuple[str, ...], tuple[str, ...]], list[WeightedPlace]] = {}
        for key, mode in alternatives.modes.items():
            if key == FOLLOWED:
                found += self._simulated(name, weights[key], thing, places)
            elif mode.pose is None:
                found.append((weights[key], ObjectState(None), GONE))
            elif mode.elsewhere is not None:
                found += self._elsewhere(name, key, weights[key], alternatives, evidence)
            elif weights[key] > 0.0:
                age = evidence.now - thing.seen_at
                state = self._alternative(name, key, mode, alternatives.left, evidence, age)
                if key.startswith(COURSE) and state.pose is not None:
                    there = state.supports, evidence.containers_at(name, state.pose.t)
                    courses.setdefault(there, []).append(WeightedPlace(weights[key], state.pose))
                else:
                    found.append((weights[key], state, key))
        for (supports, containers), ends in courses.items():
            found += [
                (one.weight, ObjectState(one.pose, containers=containers, supports=supports), ON_COURSE)
                for one in merged(ends)
            ]
        return found

    def _elsewhere(
        self, name: str, key: str, weight: float, alternatives: Alternatives, evidence: Evidence
    ) -> list[WeightedState]:  # fmt: skip
        """The states of an object that is somewhere near in a mode, on each level on which it may lie there."""
        mode = alternatives.modes[key]
        assert mode.pose is not None and mode.elsewhere is not None
        places, deviation = alternatives.places_about(name, mode, evidence), alternatives.deviation(mode, evidence.now)
        found = []
        for area in mode.elsewhere.areas(places, deviation) if weight > 0.0 else ():
            covariance = np.diag((0.0, 0.0, self._parameters.elsewhere.height**2))
            covariance[:2, :2] = area.sideways
            there = with_world_covariances(Pose.unchecked(area.position, mode.pose.q), covariance, _ANY_TURN)
            containers = evidence.containers_at(name, area.position)
            supports = (area.support,) if area.support else ()
            found.append((weight * area.share, ObjectState(there, containers=containers, supports=supports), key))
        return found

    def _alternative(
        self, name: str, key: str, mode: Mode, left: Pose, evidence: Evidence, age: float
    ) -> ObjectState:  # fmt: skip
        """The state of an object in a mode other than what the simulation says; it was `left` when it was seen last."""
        parameters, pose = self._parameters, mode.pose
        assert pose is not None
        moved = math.dist(pose.t, left.t) if key == LEFT or key.startswith(COURSE) else 0.0
        if key == LEFT and not moved:
            noise = parameters.noise[RESTS_UNSEEN]
        elif key == LEFT or key.startswith(COURSE):
            noise = parameters.noise[MOVED_UNSEEN]
        elif key.startswith(INSIDE_OF):
            noise = parameters.noise[INSIDE]
        else:
            noise = parameters.noise[mode_circumstance(mode, evidence)]
        placed = with_spread(pose, noise, age, moved, np.zeros(3))
        if mode.container and (solid := evidence.objects[mode.container].solid) is not None:
            edges = parameters.within.level * np.array(solid.size)
            turn = solid.pose.rotation_matrix
            placed = with_world_covariances(pose, turn @ np.diag(edges**2) @ turn.T, _ANY_TURN)
        containers: tuple[str, ...] = (mode.container,) if mode.container else ()
        if key == LEFT and moved:  # it fell from a hand
            containers = evidence.containers_at(name, pose.t)
        return ObjectState(placed, hand=mode.hand, containers=containers, supports=mode.supports)


def _density(worlds: _Places, seen: Pose) -> float:
    """1/m^2, over the floor, by weighted places, of where an object is seen, times their weight.

    It is never 0, for all of them may be wrong: then their weight alone tells.
    """
    own, found = seen.parent_covariances()[0], ROUNDING * max(sum(weight for weight, _ in worlds), ROUNDING**2)
    for weight, pose in worlds:
        covariance = (own + pose.parent_covariances()[0])[:2, :2]
        distance = float(squared_distance(np.subtract(seen.t, pose.t)[:2], covariance))
        found += weight * math.exp(-0.5 * distance) / (2.0 * math.pi * math.sqrt(float(np.linalg.det(covariance))))
    return found


_Places = Sequence[tuple[float, Pose]]
"""Weights of where an object may be"""
_ANY_TURN = np.eye(3)
"""rad^2, of an object of which nobody knows how it is turned"""
