"""Everything that one run says at ten moments a second, beside the truth: of places, relations, holders and actions."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import accumulate
from typing import Literal

import msgspec

from agents.scenario.format.model import ObjectSpec
from agents.scenario.judge.accuracy import TrueRelations, thinned, true_holders
from agents.scenario.truth.actions import compare
from agents.scenario.truth.history import History, Inferred, Sample
from benchmarks.honesty.answers import Answer
from benchmarks.honesty.hands import by_true_hands
from benchmarks.honesty.statement import Statement, log_score, region_of, sideways_region_of, stated
from benchmarks.honesty.watching import ToldWorlds
from dsr.math3d.tolerance import PoseTolerance
from dsr.math3d.transforms import Pose
from dsr.vocabulary.observed_actions import Action

Seen = Literal["seen", "unseen", "never"]
"""In view of the camera; not, but it was before; not yet."""
Doing = Literal["rests", "moves", "held", "gone"]
"""What a thing truly does."""
UNTOUCHED = PoseTolerance(0.001, 0.01)
"""m, rad from where it was when last seen, up to which nothing has touched a thing: the slack of physics at rest"""


class Told(msgspec.Struct, frozen=True):
    """What one speaker says of one thing at one moment, and what it is worth."""

    speaker: str
    """`belief`, `one world` or `percept`."""
    log_score: float
    """nats, of the position"""
    region: float | None
    """Mass of the smallest region that holds the true position; None if nothing was said"""
    turned_log_score: float | None = None
    """nats, of the whole pose; None of things of which nobody can see how they are turned"""
    turned_region: float | None = None
    error: float | None = None
    """m, from the truth to the likeliest place"""
    says_gone: bool = False
    sideways_region: float | None = None
    """As `region`, of the horizontal position alone"""


class Moment(msgspec.Struct, frozen=True):
    """One thing at one moment."""

    object: str
    time: float
    """s after the start"""
    seen: Seen
    doing: Doing
    untouched: bool
    """It rests, is not seen, was last seen at rest, and is where it was then."""
    told: list[Told]


class Answers(msgspec.Struct, frozen=True):
    """What was told of one kind of relation, or of actions."""

    kind: str
    answers: list[Answer]
    questions: int
    """Things that it was told of, at all moments; of actions: actions."""
    never_seen: list[Answer] = []
    """Of what no camera had seen yet: in neither of those above."""


class RunScores(msgspec.Struct, frozen=True):
    """All that was told in one run."""

    family: str
    seed: int
    moments: list[Moment]
    answers: list[Answers]


Speaker = Callable[[Sample, ToldWorlds, str], Statement]
"""What somebody says of a thing (by name) at a moment."""


def believed(sample: Sample, worlds: ToldWorlds, name: str) -> Statement:
    """The belief: all weighted worlds."""
    return worlds.places.get(name, Statement())


def simulated(sample: Sample, worlds: ToldWorlds, name: str) -> Statement:
    """The simulated world alone, with the covariance of the percepts that led to it."""
    return worlds.simulated.get(name, Statement())


def last_percept(sample: Sample, worlds: ToldWorlds, name: str) -> Statement:
    """The naive one: the last percept with the sensor's covariance, however old."""
    return stated(sample.percepts.get(name))


SPEAKERS: dict[str, Speaker] = {"belief": believed, "one world": simulated, "percept": last_percept}
"""Those that are compared, by name."""


def scores_of(family: str, seed: int, history: History, worlds: Mapping[float, ToldWorlds]) -> RunScores:
    """Score all that was told in a finished run from its `settle` on; the worlds by the times of the samples (s)."""
    worlds = by_true_hands(history.samples, worlds)
    window = thinned(history.window(history.scenario.settle, history.end))
    moments = [moment for spec in history.scenario.objects for moment in _moments_of(spec, history, window, worlds)]
    return RunScores(family, seed, moments, [*_relations(history, window, worlds), _actions(history)])


def _moments_of(
    spec: ObjectSpec, history: History, window: Sequence[Sample], worlds: Mapping[float, ToldWorlds]
) -> Iterator[Moment]:
    last: tuple[Pose, bool] | None = None
    for sample in history.window(0.0, history.scenario.settle):
        last = _last_seen(spec.name, sample, last)
    for sample in window:
        last = _last_seen(spec.name, sample, last)
        truth, doing = sample.truth.get(spec.name), _doing(spec.name, sample)
        seen: Seen = "seen" if spec.name in sample.in_view else "never" if last is None else "unseen"
        untouched = (
            seen == "unseen" and doing == "rests" and last is not None and truth is not None
            and last[1] and UNTOUCHED.covers(last[0], truth)
        )  # fmt: skip
        yield Moment(
            spec.name, sample.time, seen, doing, untouched,
            [
                _told(name, speaker(sample, worlds[sample.time], spec.name), spec, truth)
                for name, speaker in SPEAKERS.items()
            ],
        )  # fmt: skip


def _last_seen(name: str, sample: Sample, before: tuple[Pose, bool] | None) -> tuple[Pose, bool] | None:
    """Where a thing was when the camera last saw it, and whether it rested."""
    if name in sample.in_view and name in sample.truth:
        return sample.truth[name], _doing(name, sample) == "rests"
    return before


def _doing(name: str, sample: Sample) -> Doing:
    if name not in sample.truth:
        return "gone"
    return "held" if name in sample.grasped else "moves" if name in sample.moving else "rests"


def _told(speaker: str, said: Statement, spec: ObjectSpec, truth: Pose | None) -> Told:
    turned = spec.marker_id is not None
    best = max(said.poses, key=lambda likely: likely.weight, default=None)
    return Told(
        speaker=speaker,
        log_score=log_score(said, truth),
        region=region_of(said, truth),
        turned_log_score=log_score(said, truth, turned=True) if turned else None,
        turned_region=region_of(said, truth, turned=True) if turned else None,
        error=None if best is None or truth is None else best.pose.distance(truth)[0],
        says_gone=said.gone > 0.5,
        sideways_region=sideways_region_of(said, truth),
    )


def _relations(history: History, window: Sequence[Sample], worlds: Mapping[float, ToldWorlds]) -> list[Answers]:
    """Of each kind, of all pairs that were told or are so: the weight of the worlds in which they hold.

    A pair is a statement of the thing that is held, inside or on something.
    """
    truths = TrueRelations(history.scenario)
    kinds = {"on": truths.on, "in": truths.inside, "grasping": true_holders}
    seen_before = _seen_before(history, window)
    found = []
    for kind, true_of in kinds.items():
        answers: dict[bool, list[Answer]] = {True: [], False: []}
        for sample, seen in zip(window, seen_before, strict=True):
            true, ignored = true_of(sample)
            said = {pair: told for pair, told in worlds[sample.time].relations[kind].items() if pair not in ignored}
            for pair in sorted(said.keys() | true):
                name = pair[1] if kind == "grasping" else pair[0]
                answers[name in seen].append(Answer(said.get(pair, 0.0), pair in true, sample.time, pair))
        questions = sum(len(sample.truth.keys() & seen) for sample, seen in zip(window, seen_before, strict=True))
        found.append(Answers(kind, answers[True], questions, answers[False]))
    return found


def _seen_before(history: History, window: Sequence[Sample]) -> list[frozenset[str]]:
    """Names of the things that the camera saw before each sample of the window: what it sees then, nobody knew yet."""
    seen = frozenset[str]().union(*(sample.in_view for sample in history.window(0.0, history.scenario.settle)))
    return list(accumulate((sample.in_view for sample in window[:-1]), frozenset.union, initial=seen))


def _actions(history: History) -> Answers:
    """Each action that was done or told, with the confidence that was told."""
    comparison = compare(history)
    found = [_answer(one.true, True, one.inferred) for one in comparison.matches]
    found += [_answer(inferred.action, False, inferred) for inferred in comparison.extra]
    return Answers("actions", found, len(found))


def _answer(action: Action, is_so: bool, inferred: Inferred | None) -> Answer:
    told = 0.0 if inferred is None else inferred.confidence
    return Answer(told, is_so, action.time, (action.kind, action.thing))
