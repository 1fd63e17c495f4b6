"""Lets a policy explain surprises, and changes the belief as the explanation says."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Set
from dataclasses import replace

from dsr.math3d.tolerance import PoseTolerance
from dsr.math3d.transforms import Pose
from dsr.perception.scales import FRAME, PRESENT, RESOLUTION
from dsr.vocabulary.explained import CAMERA_MOVED, REMOVED, TAKEN_ALONG, ExplainedChange
from simulation_handler.config import BeliefConfig
from simulation_handler.contact.containment import Containment
from simulation_handler.contact.relations import ContactRelations, Relation
from simulation_handler.explaining.discrepancies import Discrepancies
from simulation_handler.explaining.glimpses import Glimpse, glimpse_of
from simulation_handler.explaining.policy import ExplainingPolicy, Explanation
from simulation_handler.explaining.scoring import is_far
from simulation_handler.explaining.situation import (
    Properties,
    Situation,
    VisibilityQuery,
    seen_now,
)
from simulation_handler.explaining.wording import is_lasting, moved_together
from simulation_handler.scales import TICK_SLACK
from simulation_handler.shapes.geometry import Solid
from simulation_handler.state.bodies import Bodies
from simulation_handler.state.objects import BelievedObject

EXPLANATION = "explanation"
"""Source of relations that hold because of an explanation."""
KEPT = 20
"""count of explanations that are remembered, by the graph and until they are written; older ones are dropped"""
_REMEMBERED = 10.0  # s for which it is known what was beneath an object, and what moved together with it


class Explainer:
    """Watches a belief for surprises and explains them.

    Args:
        bodies: what is believed.
        relations: what rests on what.
        policy: explains.
        config: when to explain.
        containment: what is in what.
    """

    def __init__(
        self,
        bodies: Bodies,
        relations: ContactRelations,
        policy: ExplainingPolicy,
        config: BeliefConfig,
        containment: Containment,
    ) -> None:
        self.flagged: frozenset[str] = frozenset()
        """Objects that the working memory says are surprising."""
        self.planned: frozenset[tuple[str, str]] = frozenset()
        """(object, support): where a plan has just put something."""
        self.visibility: VisibilityQuery | None = None
        """What cameras should see; None without one."""
        self.take: Callable[[str, float], str] = lambda name, now: ""
        """Lets a hand have, at a time (s), what is missing where it covered it; names the hand, or nothing."""
        self.cameras_in_doubt: frozenset[str] = frozenset()
        """Somebody finds out whether these have moved."""
        self.cameras_standing: frozenset[str] = frozenset()
        """It is known that these have not moved."""
        self._bodies = bodies
        self._relations = relations
        self._policy = policy
        self._config = config
        self._containment = containment
        self._discrepancies = Discrepancies(bodies, config)
        self._planned: dict[tuple[str, str], float] = {}  # until when it counts
        self._companions: dict[str, tuple[float, frozenset[str]]] = {}  # until when, what moves with an object
        self._moved_along: dict[str, dict[str, Pose]] = {}  # leader_from_other of what moves with a followed object
        self._former: dict[tuple[str, str], tuple[float, Pose]] = {}  # (upper, lower) -> until when, upper_from_lower
        self._news: list[tuple[float, Explanation]] = []
        self._moved: set[str] = set()
        self._doubted_until: dict[str, float] = {}  # by camera
        self._look_again_at = -math.inf
        self._left: dict[str, Solid | None] = {}  # what no explanation helps, and where it was seen then, if anywhere
        self._left_until = -math.inf
        self._told: tuple[tuple[ExplainedChange, ...], float] = (
            (),
            -math.inf,
        )  # the last, and until when the same is no news

    @property
    def waiting(self) -> Collection[str]:
        """Objects that perception must not move by itself."""
        return self._discrepancies.displaced

    @property
    def expected(self) -> Set[str]:
        """Objects that cameras should see where they are believed to be, seen or not."""
        return self._discrepancies.expected

    def missing(self, now: float) -> Collection[str]:
        """Objects that should be seen where they are believed to be, and are not."""
        return self._discrepancies.missing_for(now).keys()

    def missed(self, now: float) -> Set[str]:
        """Objects that should be seen where they are believed to be, and were not for surprisingly long."""
        return self._discrepancies.missed(now)

    def in_doubt(self, now: float) -> frozenset[str]:
        """Objects of which only cameras tell, or should tell, that may have moved."""
        return self._discrepancies.told_only_by(self._doubted(now), now)

    def sure(self, now: float) -> frozenset[str]:
        """Objects that a camera sees that is known not to have moved."""
        items, standing = self._bodies.objects.items(), self.cameras_standing
        return frozenset(name for name, item in items if standing and item.cameras_at(now - item.track.late) & standing)

    def notice(self, now: float) -> None:
        """Compare percepts with beliefs at time `now` (s)."""
        self._planned |= dict.fromkeys(self.planned, now + _REMEMBERED)
        self._discrepancies.update(now, self.visibility)
        if self.waiting or self.missing(now):
            self._policy.prepare()
        for name, item in self._bodies.objects.items():
            is_seen = item.track.age(now) < PRESENT and item.track.estimate is not None
            if is_seen and name in self._bodies.sim and name not in self.waiting and not item.holder:
                item.confirmed = self._bodies.solid(name)

    def _doubted(self, now: float) -> frozenset[str]:
        """Cameras that are in doubt, or were until what they saw meanwhile counts no more."""
        self._doubted_until |= dict.fromkeys(self.cameras_in_doubt, now + self._config.perceived_max_age)
        return frozenset(camera for camera, until in self._doubted_until.items() if now < until)

    def drag(self, now: float) -> None:
        """Let what moved with an object that goes on moving go on with it."""
        discrepancies, bodies = self._discrepancies, self._bodies
        self._moved_along = {
            name: others for name, others in self._moved_along.items() if discrepancies.is_followed(name, now)
        }
        for leader, moved_along in self._moved_along.items():
            for other, leader_from_other in moved_along.items():
                if leader not in bodies.sim or not self._may_be_dragged(other, now):
                    continue
                there = bodies.pose(leader) @ leader_from_other
                if bodies.pose(other).distance(there)[0] > RESOLUTION:
                    bodies.put(bodies.object(other), there.t, there.q)
                    discrepancies.follow([leader], now)

    def _may_be_dragged(self, name: str, now: float) -> bool:
        """Whether an object still goes where its leader goes: nothing holds it, and it has not been seen since."""
        if name not in self._bodies.sim:
            return False
        item = self._bodies.object(name)
        return not item.is_led and not item.track.is_fresh(now)

    def explain(self, now: float) -> None:
        """Explain the discrepancies that are due at time `now` (s), and adopt the explanation."""
        doubted = self._doubted(now)
        withheld = self._discrepancies.told_only_by(doubted, now)
        due = self._discrepancies.due(now, self.flagged, withheld)
        if not due or now < self._look_again_at or (now < self._left_until and self._is_left(due, now)):
            return
        explanation = self._policy.explain(self._situation(now, due, doubted, withheld))
        if explanation is None:
            self._look_again_at = now + FRAME - TICK_SLACK  # a better look at what is not clear yet
            return
        explanation = self._with_hands(explanation, now)
        if explanation.changes_belief:
            self._adopt(explanation, now)
            self._discrepancies.update(now, self.visibility)
        else:
            self._look_again_at = now + self._config.look_again_after
        if explanation.unexplained.issuperset(due):  # the same evidence would be explained as badly
            self._left = {name: self._percept(name, now) for name in due}
            self._left_until = now + self._config.explain_patience - TICK_SLACK
        told, until = self._told
        is_news = explanation.changes != told or now > until
        if is_news:  # what only goes on is told once
            self._news = [*self._news, (now, explanation)][-KEPT:]
        camera_moved = any(change.kind == CAMERA_MOVED for change in explanation.changes)
        if is_news or not camera_moved:  # a moved camera is told again until somebody did something about it
            self._told = (explanation.changes, now + 2.0 * self._config.follow_for)

    def _is_left(self, due: Collection[str], now: float) -> bool:
        """Whether the last explanation left all these, and each is seen where it was then, or still not seen."""
        return self._left.keys() >= set(due) and all(
            left is percept is None or (left and percept and not is_far(percept, left, self._config))
            for left, percept in ((self._left[name], self._percept(name, now)) for name in due)
        )

    def _percept(self, name: str, now: float) -> Solid | None:
        """Where an object is seen; None if nobody sees it."""
        item = self._bodies.object(name)
        return None if item.estimate_at(now) is None else item.percept()

    def _with_hands(self, explanation: Explanation, now: float) -> Explanation:
        """The same, but what was removed where a hand covered it is in that hand."""
        taken = {name: hand for name in sorted(explanation.removed) if (hand := self.take(name, now))}
        renamed = {
            ExplainedChange(REMOVED, ((name,),)): ExplainedChange(TAKEN_ALONG, ((name,), (hand,)))
            for name, hand in taken.items()
        }
        changes = tuple(renamed.get(change, change) for change in explanation.changes)
        return replace(explanation, changes=changes, removed=explanation.removed - taken.keys())

    def recall(self, changes: tuple[ExplainedChange, ...], time: float, now: float) -> None:
        """Take over at `now` (s) an explanation that an earlier run made at another `time` (s).

        The last call has the newest.

        What moved together goes on doing so; and what left the belief as it was is no news if it only goes on.
        """
        self._companions |= {
            name: (time + _REMEMBERED, moved_along) for name, moved_along in moved_together(changes).items()
        }
        self._told = (changes, (now if is_lasting(changes) else time) + 2.0 * self._config.follow_for)

    def settle_relations(self, now: float) -> None:
        """Give objects that were put elsewhere the relations of their contacts; call this after physics."""
        if self._moved:
            self._relations.establish(self._moved, self._bodies.sim.contacts(), now, EXPLANATION)
            self._moved.clear()

    def take_news(self) -> list[tuple[float, Explanation]]:
        """Explanations that were given since the last call, with when (s)."""
        news, self._news = self._news, []
        return news

    def close(self) -> None:
        """Release the resources of the policy."""
        self._policy.close()

    def _situation(
        self, now: float, due: tuple[str, ...], doubted: frozenset[str], withheld: frozenset[str]
    ) -> Situation:
        """As all cameras but those `doubted` tell it: of the objects `withheld` nothing is known now."""
        bodies, config = self._bodies, self._config
        placed = {name: bodies.solid(name) for name in bodies.objects if name in bodies.sim}
        objects = bodies.objects
        told = {name: item for name, item in objects.items() if name not in withheld}
        return Situation(
            now=now,
            config=config,
            fixtures=dict(bodies.fixtures),
            believed=placed,
            properties={
                **{name: Properties(0.0, bodies.friction_of(name)) for name in bodies.fixtures},
                **{
                    name: Properties(item.mass, item.friction, item.shape, item.rolling_friction)
                    for name, item in objects.items()
                },
            },
            seen={
                name: seen_now(item, config, now)
                for name, item in told.items()
                if not item.is_led and item.estimate_at(now) is not None
            },
            surprising=due,
            glanced=frozenset(
                name for name, item in told.items() if item.track.glance_at(now) is not None
            ),
            beneath=_by_first(self._relations.current()),
            inside=_by_first(self._containment.current()),
            former=self._remembered(now),
            companions={name: moved_along for name, (until, moved_along) in self._companions.items() if now <= until},
            unplaced=bodies.unplaced(),
            held=frozenset(name for name, item in objects.items() if item.is_led and name in placed),
            planned=frozenset(pair for pair, until in self._planned.items() if now <= until),
            confirmed={name: solid for name in placed if (solid := objects[name].confirmed) is not None},
            glimpsed={name: seen for name in placed if (seen := self._glimpse(objects[name], now)) is not None},
            missing_for=self._discrepancies.missing_for(now),
            evidence=self._discrepancies.evidence(now, withheld),
            visibility=self._visibility_without(doubted, withheld),
            sure=self.sure(now) - withheld,
        )

    def _visibility_without(self, cameras: frozenset[str], names: frozenset[str]) -> VisibilityQuery | None:
        """What cameras should see, without some of them and without some objects."""
        visibility = self.visibility
        if visibility is None or not cameras:
            return visibility
        return lambda solids, among: [
            {} if solid.name in names else {camera: one for camera, one in by.items() if camera not in cameras}
            for solid, by in zip(solids, visibility(solids, among), strict=True)
        ]

    def _glimpse(self, item: BelievedObject, now: float) -> Glimpse | None:
        """How an unseen object was last seen on its way, if that was not where it is believed to be.

        What a hand had in the air then, and was not seen to fall, went with the hand: that tells nothing of a fall.
        """
        if not item.track.trail or item.track.is_fresh(now) or item.holder:
            return None
        if (item.hand or item.vanished_when_let_go) and item.is_in_air and not item.falls:
            return None
        config, believed = self._config, self._bodies.solid(item.name)
        glimpse = glimpse_of(believed, item.track.trail, item.error_mean, item.error_std(config))
        expected = PoseTolerance(config.hover_tolerance, config.tilt_tolerance)
        is_near = expected.covers(glimpse.solid.pose, believed.pose)
        return glimpse if not is_near or item.track.is_restless else None

    def _remembered(self, now: float) -> dict[str, dict[str, Pose]]:
        """What was beneath each object until lately, and how."""
        self._former = {pair: entry for pair, entry in self._former.items() if now <= entry[0]}
        former: dict[str, dict[str, Pose]] = {}
        for (upper, lower), (_, upper_from_lower) in self._former.items():
            former.setdefault(upper, {})[lower] = upper_from_lower
        return former

    def _remember(self, now: float) -> None:
        """Keep in mind how things stand, before that changes."""
        sim = self._bodies.sim
        for upper, lower in self._relations.current():
            if upper in self._bodies.objects and lower in self._bodies.objects and upper in sim and lower in sim:
                upper_from_lower = self._bodies.pose(upper).inverse() @ self._bodies.pose(lower)
                self._former[upper, lower] = (now + _REMEMBERED, upper_from_lower)

    def _adopt(self, explanation: Explanation, now: float) -> None:
        """Make the belief what the explanation says."""
        bodies = self._bodies
        self._remember(now)
        for name in sorted(explanation.removed):
            bodies.take_away(bodies.object(name))
            self._relations.forget(name)
        for name in sorted(explanation.solids):  # physics depends a little on the order
            item, solid = bodies.object(name), explanation.solids[name]
            bodies.put(item, solid.position, solid.rotation)
            if name in explanation.placements:
                item.rest(explanation.placements[name], solid, now)
            else:
                item.leave_to_physics()
        for name, item in bodies.objects.items():
            if name in explanation.solids or (item.static and not item.holder and item.estimate_at(now) is None):
                bodies.set_static(item, name in explanation.held or item.strikes >= self._config.strikes)
        for relation in explanation.ended:
            self._relations.end(relation)
        self._moved |= explanation.solids.keys()
        self._discrepancies.follow(explanation.placements.keys(), now)
        self._note_moved_along(explanation, now)

    def _note_moved_along(self, explanation: Explanation, now: float) -> None:
        """Keep in mind what moves with which object, as long as that goes on moving."""
        moves = explanation.hypothesis.moves if explanation.hypothesis else ()
        self._companions |= {
            move.name: (now + _REMEMBERED, frozenset((*move.moved_along, *move.beneath))) for move in moves
        }
        self._moved_along |= {
            move.name: {
                other: self._bodies.pose(move.name).inverse() @ self._bodies.pose(other)
                for other in (*move.moved_along, *move.beneath)
            }
            for move in moves
        }


def _by_first(relations: Iterable[Relation]) -> dict[str, tuple[str, ...]]:
    """What each is related to."""
    found: dict[str, tuple[str, ...]] = {}
    for first, second in relations:
        found[first] = (*found.get(first, ()), second)
    return found
