"""What hypotheses cost before anything is simulated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from simulation_handler.config import BeliefConfig
from simulation_handler.explaining.hypotheses import Hypothesis, Move
from simulation_handler.explaining.scoring import prior
from simulation_handler.explaining.situation import Properties, Seen, Situation
from simulation_handler.shapes.geometry import Solid
from tests.simulation_handler.worlds import CUBE

TOP, BELOW = Solid("top", CUBE, (0.3, 0.0, 0.06)), Solid("below", CUBE, (0.3, 0.0, 0.02))
PLANNED = Situation(
    now=0.0,
    config=BeliefConfig(),
    fixtures={},
    believed={"top": TOP, "below": BELOW},
    properties=dict.fromkeys(("top", "below"), Properties(0.05, 0.6)),
    seen={"top": Seen(TOP, 1e-6 * np.eye(3), 1e-3 * np.eye(3), count=10, moving=False)},
    surprising=("top",),
    planned=frozenset({("top", "below")}),
)
PUT_UNDER, TOGETHER = Hypothesis((Move("top", beneath=("below",)),)), Hypothesis((Move("top", moved_along=("below",)),))


def test_what_a_plan_puts_somewhere_is_likely_there() -> None:
    assert prior(PLANNED, PUT_UNDER) < prior(replace(PLANNED, planned=frozenset()), PUT_UNDER)


def test_what_a_plan_has_put_there_moves_along_rather_than_being_put_there_again() -> None:
    done = replace(PLANNED, beneath={"top": ("below",)})
    assert prior(done, TOGETHER) + 3.0 < prior(done, PUT_UNDER)
