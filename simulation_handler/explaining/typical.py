"""Of many ways to fall, all of them as good an explanation, the one that ends where the others do, too."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from simulation_handler.explaining.hypotheses import Hypothesis
from simulation_handler.explaining.least_change import AS_GOOD
from simulation_handler.explaining.search import Candidate


def with_typical_fall(ranking: Sequence[Candidate]) -> list[Candidate]:
    """The ranking, with one in the place of the best and all that differ from it only in how something fell.

    That is the medoid: the one whose objects come to lie nearest, on average, to where those of the others do, by
    the probabilities of these.
    """
    if not ranking or not ranking[0].hypothesis.fallen:
        return list(ranking)
    best, kind = ranking[0], _kind(ranking[0].hypothesis)
    alike = [candidate for candidate in ranking if _kind(candidate.hypothesis) == kind]
    weights = [math.exp(best.score.total - candidate.score.total) for candidate in alike]

    def distance(candidate: Candidate) -> float:
        """Mean distance (m), up to a factor, of what fell to where it lies in the other outcomes."""
        return sum(
            weight * math.dist(candidate.settled[name].position, other.settled[name].position)
            for weight, other in zip(weights, alike, strict=True)
            for name, _ in best.hypothesis.fallen
        )

    typical = min((c for c in alike if c.score.total - best.score.total <= AS_GOOD), key=distance)
    return [typical, *(candidate for candidate in ranking if _kind(candidate.hypothesis) != kind)]


def _kind(hypothesis: Hypothesis) -> Hypothesis:
    """The hypothesis without how things fell."""
    return replace(hypothesis, fallen=tuple((name, 0) for name, _ in hypothesis.fallen))
