"""Scores how well a hypothesis explains present and missing percepts: minus its log-probability, up to a constant.

A hypothesis is charged for what it assumes (prior), for percepts that do not fit where physics lets things end up
(likelihood), for unseen things that it shoves aside without saying so, for things that should be seen and are not, and
for things that are seen where they cannot be.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass

from dsr.math3d.tolerance import PoseTolerance
from dsr.perception.noise import NOTHING_SEEN
from dsr.perception.scales import FRAME, PRESENT
from dsr.vocabulary import nats
from simulation_handler.config import BeliefConfig
from simulation_handler.explaining.camera import corrected
from simulation_handler.explaining.drafting import Draft
from simulation_handler.explaining.hypotheses import FROM_GLIMPSE, Hypothesis, Move
from simulation_handler.explaining.situation import Seen, Situation, seen_now, shown_now
from simulation_handler.perception.visibility import ExpectedVisibility
from simulation_handler.scales import UNSEEN_SLACK
from simulation_handler.shapes.geometry import Solid
from simulation_handler.state.objects import BelievedObject


@dataclass(frozen=True)
class Score:
    """The cost of a hypothesis (nats), and the objects that it leaves unexplained."""

    total: float
    """nats"""
    residuals: tuple[str, ...]
    """Objects that would still be surprising, the worst first."""


def score(situation: Situation, hypothesis: Hypothesis, drafted: Draft, settled: Mapping[str, Solid]) -> Score:
    """Judge a hypothesis by where physics lets things end up.

    Args:
        situation: what is seen.
        hypothesis: what is assumed.
        drafted: where that puts things.
        settled: where they are some time later.
    """
    costs: dict[str, float] = {}
    for name, seen in corrected(situation, hypothesis).seen.items():
        if name in hypothesis.kept:
            continue
        if name not in settled:
            costs[name] = nats.MOST_MISFIT
            continue
        costs[name] = min(seen.misfit(settled[name]), nats.MOST_MISFIT)
    costs |= _drifting(situation, hypothesis, drafted, settled)
    for name, cost in _visibility(situation, hypothesis, settled).items():
        costs[name] = costs.get(name, 0.0) + cost
    worst = sorted(
        (name for name, cost in costs.items() if cost > nats.SURPRISING), key=lambda name: (-costs[name], name)
    )
    return Score(prior(situation, hypothesis) + sum(costs.values()), tuple(worst))


def _drifting(
    situation: Situation, hypothesis: Hypothesis, drafted: Draft, settled: Mapping[str, Solid]
) -> dict[str, float]:
    """Nats for each unseen object that ends elsewhere than the hypothesis says; of others it says that they stay.

    What is shoved aside, by the draft or by physics, has been moved as if that had been assumed. What falls because it
    has lost what carried it is a mere consequence, and so is what a moved object pushed along on its way.
    """
    said = {**situation.believed, **{name: placement.solid for name, placement in drafted.placements.items()}}
    unseen = settled.keys() - situation.seen.keys() - situation.held - dict(hypothesis.fallen).keys()
    drifts = {name: math.dist(settled[name].position, said[name].position) for name in unseen}
    changed = (
        hypothesis.moved.keys() | hypothesis.unseen | {name for name, drift in drifts.items() if drift > UNSEEN_SLACK}
    )

    def most(name: str) -> float:
        carriers = {*situation.beneath.get(name, ()), *situation.inside.get(name, ())}
        if name in drafted.placements:
            return nats.MOST_MISFIT
        if name in drafted.pushed:
            return nats.CONSEQUENCE
        return nats.MOVED if carriers and carriers.isdisjoint(changed) else nats.CONSEQUENCE

    return {name: min(0.5 * (drift / UNSEEN_SLACK) ** 2, most(name)) for name, drift in drifts.items()}


def prior(situation: Situation, hypothesis: Hypothesis) -> float:
    """Cost (nats) of the assumptions of a hypothesis."""
    cost = sum(_move_prior(situation, move) for move in hypothesis.moves)
    for move in hypothesis.moves:
        cost += nats.PARTED * len(situation.contents(move.name) - hypothesis.unseen - hypothesis.moved.keys())
    cost += nats.REMOVED * len(hypothesis.removed)
    for name, direction in hypothesis.fallen:
        if name not in situation.glimpsed:
            cost += nats.FELL
        elif direction >= FROM_GLIMPSE:
            cost += nats.FELL_IN_VIEW
        else:
            cost += nats.FELL_ON_FROM_THERE if direction == situation.fall_seen(name) else nats.FELL
    for name in hypothesis.kept:
        frames = max(situation.seen[name].count, situation.evidence / FRAME)
        cost += nats.FALSE_PERCEPT + nats.FALSE_FRAME * frames
    if hypothesis.camera_moved:
        here = [name for name in hypothesis.moved if name in situation.believed and not _is_off(situation, name)]
        explained = len(situation.seen.keys() - hypothesis.moved.keys() - hypothesis.kept - situation.sure)
        cost += nats.CAMERA_MOVED + max(nats.COINCIDENCE, nats.MOVED * explained) * len(here)
    return cost


def _is_off(situation: Situation, name: str) -> bool:
    """Whether an object is seen elsewhere than it is believed to be."""
    return is_displaced(situation.seen[name], situation.believed[name], situation.config)


def _move_prior(situation: Situation, move: Move) -> float:
    companions = situation.companions.get(move.name, frozenset())
    cost = (
        nats.MOVED
        + nats.MOVED_ALONG * len(set(move.moved_along) - companions)
        + nats.PARTED * len(companions - set(move.moved_along))
    )
    for name in move.beneath:
        is_done = name in situation.beneath.get(move.name, ())  # what was put there already moved along, if at all
        cost += nats.FROM_ELSEWHERE if is_done or (move.name, name) not in situation.planned else nats.AS_PLANNED
    if move.held:
        cost += nats.HELD_ON_ITS_WAY if situation.seen[move.name].moving else nats.HELD
    return cost


def _visibility(situation: Situation, hypothesis: Hypothesis, settled: Mapping[str, Solid]) -> dict[str, float]:
    """Nats for each object that should be seen and is not, or is seen and should not be."""
    if situation.visibility is None or hypothesis.camera_moved:
        return {}
    there, costs = list(settled.values()), {}
    for name, seen_by in zip(settled, situation.visibility(there, there), strict=True):
        if not (by_camera := list(seen_by.values())):
            continue
        share = max(visible.share for visible in by_camera)
        if name in situation.seen:
            covered = share <= NOTHING_SEEN and _is_covered(by_camera, settled)
            if covered and name not in hypothesis.kept and situation.seen[name].age < PRESENT:
                costs[name] = nats.SEEN_THOUGH_HIDDEN
        elif name not in situation.held:
            frames = situation.missing_for.get(name, situation.evidence) / FRAME
            probability = max(visible.recognised for visible in by_camera)
            costs[name] = min(nats.MISSED_FRAME * frames, nats.MOST_MISSED) * probability
    return costs


def _is_covered(visibilities: Collection[ExpectedVisibility], settled: Mapping[str, Solid]) -> bool:
    """Whether objects hide something from all cameras that look there; the boxes around the arm are too rough."""
    covers = {visible.hidden_by for visible in visibilities} - {""}
    return bool(covers) and covers <= settled.keys()


def is_far(percept: Solid, solid: Solid, config: BeliefConfig) -> bool:
    """Whether a percept is off a pose by enough to need an explanation, noise or not."""
    expected = PoseTolerance(config.surprise_distance, config.surprise_angle)
    return not expected.covers(solid.pose, percept.pose)


def is_displaced(seen: Seen, solid: Solid, config: BeliefConfig) -> bool:
    """Whether a percept is off a pose by more than noise, and by enough to need an explanation."""
    if not is_far(seen.percept, solid, config):
        return False
    hovers = abs(solid.position[2] - seen.percept.position[2]) > config.hover_tolerance
    return hovers or seen.misfit(solid) > nats.SURPRISING


def seems_displaced(item: BelievedObject, solid: Solid, config: BeliefConfig, now: float) -> bool:
    """Whether an object that is seen at `now` (s) is displaced from a pose, as of `is_displaced`."""
    percept = item.percept()
    if item.agreed is not None and item.agreed[0] is percept and solid.is_at(item.agreed[1]):
        return False
    if is_far(shown_now(item, config)[0], solid, config):  # of most nothing more must be worked out
        return is_displaced(seen_now(item, config, now), solid, config)
    item.agreed = percept, solid
    return False


def displaced(situation: Situation) -> tuple[str, ...]:
    """The surprising objects that are seen, but not where they are believed to be."""
    return tuple(
        name
        for name in situation.surprising
        if name in situation.seen
        and (
            name not in situation.believed
            or is_displaced(situation.seen[name], situation.believed[name], situation.config)
        )
    )
