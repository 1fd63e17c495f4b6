"""Of falls that explain the same, the one in the middle is taken, and never one that is refuted."""

from __future__ import annotations

from simulation_handler.explaining.by_hypotheses import with_typical_fall
from simulation_handler.explaining.drafting import Draft
from simulation_handler.explaining.hypotheses import FROM_GLIMPSE, Hypothesis
from simulation_handler.explaining.scoring import Score
from simulation_handler.explaining.search import Candidate
from simulation_handler.shapes.geometry import Solid
from tests.simulation_handler.worlds import CUBE

REMOVED = Hypothesis().with_removed(["a"])


def candidate(hypothesis: Hypothesis, total: float, x: float) -> Candidate:
    solids = {"a": Solid("a", CUBE, (x, 0.0, 0.02))}
    return Candidate(hypothesis, Draft(solids, {}, frozenset()), solids, Score(total, ()))


def fell(draw: int, total: float, x: float) -> Candidate:
    return candidate(Hypothesis().with_fall("a", FROM_GLIMPSE + draw), total, x)


def test_the_fall_in_the_middle_stands_for_all() -> None:
    gone = candidate(REMOVED, 6.0, 0.0)
    falls = [fell(0, 4.0, 0.3), fell(1, 4.0, 0.1), fell(2, 4.1, 0.12), fell(3, 4.2, 0.13), fell(4, 19.0, 0.5)]
    assert with_typical_fall([*falls[:4], gone, falls[4]]) == [falls[2], gone]


def test_what_is_refuted_is_not_taken_though_it_is_in_the_middle() -> None:
    left, middle, right = fell(0, 4.0, 0.1), fell(1, 19.0, 0.2), fell(2, 4.0, 0.3)
    assert with_typical_fall([left, right, middle])[0] in (left, right)


def test_other_rankings_stay() -> None:
    ranking = [candidate(REMOVED, 3.0, 0.0), fell(0, 4.0, 0.1), fell(1, 4.0, 0.2)]
    assert with_typical_fall(ranking) == ranking and with_typical_fall([]) == []
