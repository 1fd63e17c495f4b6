"""Searches for the best explanation: assume, simulate, score, and go on from the surprises that remain.

Best-first search. It begins with the simplest hypotheses about what is surprising; the best one that leaves
something unexplained is extended by assumptions about just that, until the budget is spent or nothing better can
be expected.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from simulation_handler.explaining.camera import comparable, corrected, explained_by_camera
from simulation_handler.explaining.drafting import Draft, draft
from simulation_handler.explaining.glimpses import DRAW_COUNT
from simulation_handler.explaining.hypotheses import FALLS, FROM_GLIMPSE, Hypothesis, Move
from simulation_handler.explaining.piles import BREADTH, piles_beneath
from simulation_handler.explaining.scoring import Score, displaced, prior, score
from simulation_handler.explaining.situation import Situation
from simulation_handler.shapes.geometry import Solid

Simulate = Callable[[Situation, Sequence[Draft]], Sequence[Mapping[str, Solid] | None]]
"""Simulates drafts, and returns the poses of each some time later; None for drafts without an outcome in time."""


@dataclass(frozen=True)
class Candidate:
    """A hypothesis that was simulated and scored."""

    hypothesis: Hypothesis
    drafted: Draft
    settled: Mapping[str, Solid]
    """Solids after the rollout, by name."""
    score: Score


def search(situation: Situation, simulate: Simulate, most: int, first: Hypothesis | None = None) -> list[Candidate]:
    """The hypotheses that were looked at, the best first.

    Args:
        situation: what is believed, seen and surprising.
        simulate: runs drafts.
        most: how many may be simulated.
        first: one to try first; if it explains everything, nothing else is tried.
    """
    seen: set[Hypothesis] = set()
    found: list[Candidate] = []
    expanded: set[Hypothesis] = set()

    def evaluate(hypotheses: Iterator[Hypothesis] | Sequence[Hypothesis]) -> None:
        new = [h for h in dict.fromkeys(hypotheses) if h not in seen][: max(most - len(seen), 0)]
        seen.update(new)
        drafts = [draft(corrected(situation, hypothesis), hypothesis) for hypothesis in new]
        for hypothesis, drafted, settled in zip(new, drafts, simulate(situation, drafts), strict=True):
            if settled is not None:
                judged = score(situation, hypothesis, drafted, settled)
                found.append(Candidate(hypothesis, drafted, settled, judged))
        found.sort(key=_order)

    if first is not None:
        evaluate([first])
        if found and not found[0].score.residuals:
            return found
    evaluate(_beginnings(situation))
    stale = 0
    while stale < BREADTH and len(seen) < most:
        open_ = [c for c in found if c.hypothesis not in expanded and c.score.residuals]
        if not open_ or (found[0] is not open_[0] and prior(situation, open_[0].hypothesis) > found[0].score.total):
            break
        best = found[0].score.total
        expanded.add(open_[0].hypothesis)
        evaluate(list(_extensions(situation, open_[0])))
        stale = 0 if found[0].score.total < best else stale + 1
    return found


def _order(candidate: Candidate) -> tuple[float, int, str]:
    """The best first; what says the same in other words is told apart by these, so that every run does likewise."""
    return candidate.score.total, len(candidate.hypothesis.unseen), str(candidate.hypothesis)


def _beginnings(situation: Situation) -> list[Hypothesis]:
    """The simplest hypotheses: nothing happened; the displaced objects moved, alone or with what they stand on."""
    nothing = Hypothesis()
    moved = displaced(situation)
    alone = nothing
    for name in moved:
        alone = alone.with_move(Move(name))
    beginnings = [alone]
    together = alone
    for name in moved:
        chain = situation.chain_beneath(name) + situation.chain_above(name)
        if chain and name in situation.believed:
            together = together.with_move(Move(name, moved_along=chain))
            beginnings.append(alone.with_move(Move(name, moved_along=chain)))
    beginnings.append(together)
    false = nothing
    for name in moved:
        false = false.without_percept(name)
    beginnings.append(false)
    by_camera = explained_by_camera(situation)
    if len(by_camera.intersection(moved)) > 1:
        bumped = Hypothesis(camera_moved=True)
        unknown = situation.seen.keys() - situation.believed.keys()
        for name in sorted({*comparable(situation), *unknown, *situation.sure.intersection(moved)} - by_camera):
            bumped = bumped.with_move(Move(name))
        beginnings.append(bumped)
    return beginnings


def _extensions(situation: Situation, candidate: Candidate) -> Iterator[Hypothesis]:
    """Hypotheses that go on from one, about the worst of what it leaves unexplained."""
    for name in candidate.score.residuals[:BREADTH]:
        if name in situation.seen:
            yield from _about_seen(situation, candidate, name)
        else:
            yield from _about_unseen(situation, candidate, name)


def _about_seen(situation: Situation, candidate: Candidate, name: str) -> Iterator[Hypothesis]:
    """Why a seen object is not where the hypothesis leaves it."""
    hypothesis = candidate.hypothesis
    move = hypothesis.moved.get(name, Move(name))
    if name in situation.believed:
        chain = situation.chain_beneath(name)
        for length in range(1, len(chain) + 1):
            yield hypothesis.with_move(Move(name, moved_along=chain[:length]))
            yield hypothesis.with_move(Move(name, moved_along=chain[:length], held=True))
    for pile in _piles(situation, candidate, name):
        yield hypothesis.with_move(Move(name, beneath=pile))
    yield hypothesis.with_move(Move(name, moved_along=move.moved_along, held=True))
    yield hypothesis.with_move(Move(name, held=True))
    yield hypothesis.without_percept(name)
    yield hypothesis.with_move(Move(name))
    covers = _covers(candidate, name, situation)
    if covers:
        yield hypothesis.with_removed(covers)
        yield from _falls(situation, hypothesis, covers[0])


def _about_unseen(situation: Situation, candidate: Candidate, name: str) -> Iterator[Hypothesis]:
    """Why an object that should be seen is not."""
    hypothesis = candidate.hypothesis
    for move in hypothesis.moves:
        is_beneath = name in situation.chain_beneath(move.name) and name not in move.moved_along
        if is_beneath and move.name in situation.believed:
            chain = situation.chain_beneath(move.name)
            yield hypothesis.with_move(Move(move.name, moved_along=chain[: chain.index(name) + 1]))
        if name in situation.former.get(move.name, {}):
            yield hypothesis.with_move(replace(move, moved_along=(*move.moved_along, name)))
        for pile in _piles(situation, candidate, move.name):
            if name in pile:
                yield hypothesis.with_move(Move(move.name, beneath=pile))
    yield hypothesis.with_removed([name])
    if chain := situation.chain_beneath(name):
        yield hypothesis.with_removed([name, *chain])
    together = [other for other in candidate.score.residuals if other not in situation.seen]
    if len(together) > 1:
        yield hypothesis.with_removed(together)
    yield from _falls(situation, hypothesis, name)


def _falls(situation: Situation, hypothesis: Hypothesis, name: str) -> Iterator[Hypothesis]:
    """Ways in which an unseen object may have fallen: as it was seen to, or off its support in any direction."""
    direction = situation.fall_seen(name)
    if direction is not None:
        yield from (hypothesis.with_fall(name, FROM_GLIMPSE + draw) for draw in range(DRAW_COUNT))
        yield hypothesis.with_fall(name, direction)
    elif situation.beneath.get(name) and not set(situation.beneath[name]) <= set(situation.fixtures):
        yield from (hypothesis.with_fall(name, k) for k in range(len(FALLS)))


def _piles(situation: Situation, candidate: Candidate, name: str) -> list[tuple[str, ...]]:
    return piles_beneath(situation, name, candidate.drafted.solids, candidate.score.residuals)


def _covers(candidate: Candidate, name: str, situation: Situation) -> list[str]:
    """Unseen objects above a seen one, in the scene of a hypothesis, that would hide it.

    Those that are missed where they are come first, then what stands highest: what falls takes along what is on it.
    """
    solid = candidate.settled.get(name)
    if solid is None:
        return []
    covers = [
        other
        for other in candidate.settled.values()
        if other.name not in situation.seen
        and other.name not in situation.held
        and other.position[2] > solid.position[2]
        and math.dist(other.position[:2], solid.position[:2]) < other.radius + solid.radius
    ]
    missing = candidate.score.residuals
    return [other.name for other in sorted(covers, key=lambda o: (o.name not in missing, -o.position[2], o.name))]
