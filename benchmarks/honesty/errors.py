"""Which relations, holders and actions cost the Brier score most, and where to find them in an episode."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

import msgspec

from benchmarks.honesty.answers import SURE, Answer
from benchmarks.honesty.moments import RunScores


class CostlyPair(msgspec.Struct, frozen=True, kw_only=True):
    """One pair of one episode that was told wrongly: at which moments, and what that cost."""

    kind: str
    family: str
    seed: int
    about: tuple[str, str]
    """The pair of a relation, as in its edge; of an action its kind and its thing"""
    cost: float
    """Sum of the squared errors of the probabilities"""
    missed: int
    """Moments at which it is so and was told with less than one half."""
    sure_and_wrong: int
    """Moments at which it is not so and was told with `SURE` or more."""
    first: float
    last: float
    """s after the start, of the moments at which the error was more than one half"""


def costly_pairs(runs: Sequence[RunScores], kind: str) -> list[CostlyPair]:
    """The pairs of a kind that were told with an error of more than one half, the costliest first."""
    found = []
    for run in runs:
        by_pair: dict[tuple[str, str], list[Answer]] = defaultdict(list)
        for answer in (one for told in run.answers if told.kind == kind for one in told.answers):
            by_pair[answer.about].append(answer)
        for about, answers in by_pair.items():
            wrong = [answer for answer in answers if abs(answer.probability - answer.is_so) > 0.5]
            if wrong:
                found.append(
                    CostlyPair(
                        kind=kind,
                        family=run.family,
                        seed=run.seed,
                        about=about,
                        cost=sum((answer.probability - answer.is_so) ** 2 for answer in answers),
                        missed=sum(answer.is_so for answer in wrong),
                        sure_and_wrong=sum(not answer.is_so and answer.probability >= SURE for answer in wrong),
                        first=min(answer.time for answer in wrong),
                        last=max(answer.time for answer in wrong),
                    )
                )
    return sorted(found, key=lambda pair: -pair.cost)
