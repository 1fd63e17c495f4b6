"""Sums up what was told in many runs: by family, speaker, and whether a thing was seen."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import msgspec
import numpy as np

from benchmarks.honesty.answers import Answer, brier, sure_and_wrong
from benchmarks.honesty.errors import CostlyPair, costly_pairs
from benchmarks.honesty.moments import Moment, RunScores, Seen, Told
from benchmarks.honesty.statement import Statement, log_score
from dsr.math3d.transforms import Pose

LEVELS = (0.5, 0.9, 0.99)
"""Masses of the regions of which it is told how often they hold the truth"""
NEAR_SEEN, NEAR_UNSEEN = 0.005, 0.020
"""m, within which a thing that rests should be believed: in view; unseen, since nothing touched it"""


class PlaceScores(msgspec.Struct, frozen=True, kw_only=True):
    """What one speaker's statements of places were worth."""

    family: str
    speaker: str
    seen: Seen
    moments: int
    """Things times moments."""
    silent: float
    """Share of them at which nothing was said."""
    log_score: float
    """nats, mean"""
    log_score_error: float | None
    """nats, standard error of the mean over episodes: moments of one are much alike; None of one episode"""
    turned_log_score: float | None
    """nats, mean of whole poses, of things whose tag tells how they are turned"""
    coverage: dict[float, float]
    """Share of the statements whose region of that mass holds the truth."""
    sideways_coverage: dict[float, float]
    """The same of the horizontal position alone."""
    turned_coverage: dict[float, float]
    median_error: float | None
    """m, of the best guess"""
    p95_error: float | None


class RelationScores(msgspec.Struct, frozen=True, kw_only=True):
    """What the belief's statements of one kind of relation, or of actions, were worth."""

    family: str
    kind: str
    brier: float
    silent: float
    """The Brier score of somebody who tells none."""
    sure_and_wrong: float | None
    """Share of what is told with 0.9 or more that is wrong."""


class Share(NamedTuple):
    """How often something is so, and of how many moments that is told."""

    share: float
    of: int


class NearScores(msgspec.Struct, frozen=True, kw_only=True):
    """How often the belief's best guess is near."""

    family: str
    seen_at_rest: Share | None
    """Share of the moments at which a thing rests in view and is believed within `NEAR_SEEN`."""
    untouched: Share | None
    """Share of those at which it rests unseen, untouched since it was seen at rest, believed within `NEAR_UNSEEN`."""
    contained: Share | None
    """Share of the true relations `in` that are told, of what was seen before."""
    contained_never_seen: Share | None
    """The same of what no camera had seen yet."""


class Failures(msgspec.Struct, frozen=True, kw_only=True):
    """When the belief's region of 99 % missed the truth."""

    family: str
    share: float
    """Of all moments."""
    kinds: list[tuple[str, float]]
    """What kind of moment it was, and the share of all failures; the most frequent first."""
    worst: list[tuple[int, str, float]]
    """The objects that cost most: seed, name, nats beyond those of a silent speaker."""


class Report(msgspec.Struct, frozen=True, kw_only=True):
    """All of it."""

    places: list[PlaceScores]
    relations: list[RelationScores]
    near: list[NearScores]
    failures: list[Failures]
    costly: list[CostlyPair]
    """The costliest pairs of each kind of relation, and of actions."""


COSTLY = 5
"""Pairs of each kind that a report tells"""


def summarise_runs(runs: Sequence[RunScores]) -> Report:
    """Sum up runs, family by family, and all of them together as `all`."""
    groups: dict[str, list[RunScores]] = defaultdict(list)
    for run in sorted(runs, key=lambda run: run.seed):
        groups[run.family].append(run)
    groups["all"] = list(runs)
    return Report(
        places=[found for family, of in groups.items() for found in _places(family, of)],
        relations=[found for family, of in groups.items() for found in _relations(family, of)],
        near=[_near(family, of) for family, of in groups.items()],
        failures=[_failures(family, of) for family, of in groups.items()],
        costly=[pair for kind in _kinds(runs) for pair in costly_pairs(runs, kind)[:COSTLY]],
    )


def told_by(moment: Moment, speaker: str) -> Told:
    """What a speaker said at a moment."""
    return next(told for told in moment.told if told.speaker == speaker)


def regions(runs: Iterable[RunScores], speaker: str, seen: Seen) -> list[float]:
    """The masses of the smallest regions that hold the truth, of all statements of a speaker."""
    found = (told_by(moment, speaker).region for run in runs for moment in run.moments if moment.seen == seen)
    return [region for region in found if region is not None]


def answers_of(runs: Iterable[RunScores], kind: str, *, never_seen: bool = False) -> list[Answer]:
    """All answers of one kind: of what was seen before, or of what no camera had seen yet."""
    chosen = (told for run in runs for told in run.answers if told.kind == kind)
    return [answer for told in chosen for answer in (told.never_seen if never_seen else told.answers)]


def _places(family: str, runs: Sequence[RunScores]) -> list[PlaceScores]:
    found: list[PlaceScores] = []
    speakers = dict.fromkeys(told.speaker for run in runs for moment in run.moments for told in moment.told)
    for speaker in speakers:
        kinds: tuple[Seen, ...] = ("seen", "unseen", "never")
        for seen in kinds:
            by_run = [[told_by(one, speaker) for one in run.moments if one.seen == seen] for run in runs]
            if any(by_run):
                found.append(_places_of(family, speaker, seen, [told for told in by_run if told]))
    return found


def _places_of(family: str, speaker: str, seen: Seen, by_run: Sequence[Sequence[Told]]) -> PlaceScores:
    every = [told for of_run in by_run for told in of_run]
    turned = [told.turned_log_score for told in every if told.turned_log_score is not None]
    errors = [told.error for told in every if told.error is not None]
    means = [float(np.mean([told.log_score for told in of_run])) for of_run in by_run]
    spread = float(np.std(means, ddof=1)) / math.sqrt(len(means)) if len(means) > 1 else None
    stated = [told.region for told in every if told.region is not None]
    sideways = [told.sideways_region for told in every if told.sideways_region is not None]
    turned_stated = [told.turned_region for told in every if told.turned_region is not None]
    return PlaceScores(
        family=family,
        speaker=speaker,
        seen=seen,
        moments=len(every),
        silent=1.0 - len(stated) / len(every),
        log_score=float(np.mean([told.log_score for told in every])),
        log_score_error=spread,
        turned_log_score=float(np.mean(turned)) if turned else None,
        coverage=_coverage(stated),
        sideways_coverage=_coverage(sideways),
        turned_coverage=_coverage(turned_stated),
        median_error=float(np.median(errors)) if errors else None,
        p95_error=float(np.quantile(errors, 0.95)) if errors else None,
    )


def _coverage(found: Sequence[float]) -> dict[float, float]:
    return {level: float(np.mean(np.array(found) <= level)) for level in LEVELS} if found else {}


def _relations(family: str, runs: Sequence[RunScores]) -> list[RelationScores]:
    found = []
    for kind in _kinds(runs):
        answers = answers_of(runs, kind)
        questions = sum(told.questions for run in runs for told in run.answers if told.kind == kind)
        if questions and answers:
            found.append(
                RelationScores(
                    family=family,
                    kind=kind,
                    brier=brier(answers, questions),
                    silent=brier([Answer(0.0, answer.is_so) for answer in answers], questions),
                    sure_and_wrong=sure_and_wrong(answers),
                )
            )
    return found


def _kinds(runs: Iterable[RunScores]) -> Iterable[str]:
    """The kinds of relations, and actions, that runs tell of."""
    return dict.fromkeys(told.kind for run in runs for told in run.answers)


def _near(family: str, runs: Sequence[RunScores]) -> NearScores:
    moments = [moment for run in runs for moment in run.moments]
    seen = [told_by(one, "belief") for one in moments if one.seen == "seen" and one.doing == "rests"]
    untouched = [told_by(one, "belief") for one in moments if one.untouched]
    return NearScores(
        family=family,
        seen_at_rest=_share([_is_near(told, NEAR_SEEN) for told in seen]),
        untouched=_share([_is_near(told, NEAR_UNSEEN) for told in untouched]),
        contained=_told_share(answers_of(runs, "in")),
        contained_never_seen=_told_share(answers_of(runs, "in", never_seen=True)),
    )


def _told_share(answers: Sequence[Answer]) -> Share | None:
    return _share([answer.probability > 0.5 for answer in answers if answer.is_so])


def _is_near(told: Told, limit: float) -> bool:
    return told.error is not None and told.error <= limit


def _share(values: Sequence[bool]) -> Share | None:
    return Share(sum(values) / len(values), len(values)) if values else None


def _failures(family: str, runs: Sequence[RunScores]) -> Failures:
    kinds: Counter[str] = Counter()
    costs: dict[tuple[int, str], float] = defaultdict(float)
    count = 0
    silent = log_score(Statement(), Pose.identity())
    for run in runs:
        for moment in run.moments:
            told = told_by(moment, "belief")
            count += told.region is not None
            if told.region is not None and told.region > LEVELS[-1]:
                kinds[kind_of(moment, told)] += 1
                costs[run.seed, moment.object] += told.log_score - silent
    total = sum(kinds.values())
    return Failures(
        family=family,
        share=total / count if count else 0.0,
        kinds=[(kind, number / total) for kind, number in kinds.most_common()],
        worst=[(seed, name, cost) for (seed, name), cost in sorted(costs.items(), key=lambda one: -one[1])[:3]],
    )


def kind_of(moment: Moment, told: Told) -> str:
    """The kind of a failure in words: what the thing did, whether it was seen, and what was said."""
    if moment.doing == "gone":
        return "gone, believed there"
    if told.says_gone:
        return f"there ({moment.seen}), believed gone"
    if moment.doing == "rests" and moment.seen == "unseen":
        return "rests unseen, untouched" if moment.untouched else "rests unseen, was moved"
    return f"{moment.doing} {'in view' if moment.seen == 'seen' else 'unseen'}"
