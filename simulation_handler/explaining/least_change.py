"""Chooses, among explanations that are as good as each other, the one that changes the least of the belief."""

from __future__ import annotations

import math
from collections.abc import Sequence

from dsr.perception.scales import SAME_OUTCOME
from dsr.vocabulary import nats
from simulation_handler.explaining.hypotheses import Hypothesis
from simulation_handler.explaining.piles import moved
from simulation_handler.explaining.scoring import prior
from simulation_handler.explaining.search import Candidate
from simulation_handler.explaining.situation import Situation


def with_least_change(situation: Situation, ranking: Sequence[Candidate]) -> list[Candidate]:
    """The ranking, led by the candidate that changes the least of those as good as its first; else by its order.

    As good are those that assume the same of other unseen objects, and fit as well (`nats.AS_GOOD`): they differ in
    which objects came along, are beneath which, or are gone.
    """
    if not ranking:
        return []
    best = ranking[0]
    rivals = [candidate for candidate in ranking if _is_as_good(situation, candidate, best)]
    first = min(rivals, key=lambda candidate: round(change(situation, candidate) / SAME_OUTCOME))
    return [first, *(candidate for candidate in ranking if candidate is not first)]


def change(situation: Situation, candidate: Candidate) -> float:
    """Sum up the distances (m) of objects from their believed places."""
    settled = candidate.settled
    return sum(
        moved(solid.position, settled[name].position) for name, solid in situation.believed.items() if name in settled
    )


def _is_as_good(situation: Situation, candidate: Candidate, best: Candidate) -> bool:
    if candidate is best:
        return True
    return (
        _kind(candidate.hypothesis) == _kind(best.hypothesis)
        and candidate.score.total - best.score.total <= nats.AS_GOOD
        and len(candidate.score.residuals) <= len(best.score.residuals)
        and math.isclose(prior(situation, candidate.hypothesis), prior(situation, best.hypothesis))
    )


def _kind(hypothesis: Hypothesis) -> tuple[object, ...]:
    """The hypothesis without which unseen objects moved or are gone. Which falls are typical is another question."""
    moves = tuple((move.name, move.held, len(move.moved_along), len(move.beneath)) for move in hypothesis.moves)
    return moves, len(hypothesis.removed), hypothesis.fallen, hypothesis.kept, hypothesis.camera_moved
