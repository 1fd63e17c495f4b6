"""Drafts: where a hypothesis puts what nobody sees."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dsr.vocabulary import nats
from simulation_handler.config import BeliefConfig
from simulation_handler.explaining.drafting import draft
from simulation_handler.explaining.hypotheses import Hypothesis, Move
from simulation_handler.explaining.scoring import score
from simulation_handler.explaining.situation import Properties, Seen, Situation
from simulation_handler.shapes.geometry import Solid

CUBE = (0.04, 0.04, 0.04)
TABLE = Solid("table", (1.2, 1.2, 0.04), (0.35, 0.0, -0.02), fixed=True)
TOP = Solid("top", CUBE, (0.31, 0.0, 0.06))
ASTRAY = Solid("below", CUBE, (0.4, 0.1, 0.02))


def situation(**more: object) -> Situation:
    """A cube is seen at the height of a second one; the one below is believed to be elsewhere."""
    seen = Seen(TOP, 1e-6 * np.eye(3), 1e-3 * np.eye(3), count=10, moving=False)
    return Situation(
        now=0.0,
        config=BeliefConfig(),
        fixtures={"table": TABLE},
        believed={"top": TOP.moved((0.31, 0.0, 0.02)), "below": ASTRAY},
        properties=dict.fromkeys(("table", "top", "below"), Properties(0.05, 0.6)),
        seen={"top": seen},
        surprising=("top",),
        **more,  # type: ignore[arg-type]
    )


@pytest.mark.parametrize(
    ("confirmed", "expected"),
    [
        ({}, (0.31, 0.0, 0.02)),
        ({"below": Solid("below", CUBE, (0.30, 0.005, 0.02))}, (0.30, 0.005, 0.02)),
        ({"below": Solid("below", CUBE, (0.25, 0.0, 0.02))}, (0.31, 0.0, 0.02)),
    ],
    ids=["never seen", "seen beneath it", "seen elsewhere"],
)
def test_what_is_put_beneath_goes_where_it_was_seen_if_that_is_beneath(
    confirmed: dict[str, Solid], expected: tuple[float, float, float]
) -> None:
    drafted = draft(situation(confirmed=confirmed), Hypothesis((Move("top", beneath=("below",)),)))
    assert drafted.solids["below"].position == pytest.approx(expected, abs=1e-4)
    assert drafted.solids["top"].position == pytest.approx((0.31, 0.0, 0.06), abs=1e-3)
    assert drafted.placements["top"].supports == ("below",)


@pytest.mark.parametrize("way", [0.01, 0.15])
def test_what_moves_pushes_along_what_nobody_sees_and_what_is_on_that(way: float) -> None:
    """However far it got: it does not give way, nor leave behind what would be nearer to its back."""
    bodies = {"block": Solid("block", (0.2, 0.3, 0.25), (0.3, 0.0, 0.125))}
    bodies["cup"] = Solid("cup", CUBE, (0.421, 0.0, 0.02))
    bodies["upper"] = Solid("upper", CUBE, (0.421, 0.01, 0.06))
    moved = bodies["block"].moved((0.3 + way, 0.0, 0.125))
    here = replace(
        situation(),
        believed=bodies,
        properties=dict.fromkeys(("table", *bodies), Properties(0.05, 0.6)),
        seen={"block": Seen(moved, 1e-5 * np.eye(3), 1e-3 * np.eye(3), count=3, moving=True)},
        beneath={"upper": ("cup",)},
        surprising=("block",),
    )
    hypothesis = Hypothesis((Move("block"),))
    drafted = draft(here, hypothesis)
    assert drafted.pushed == {"cup", "upper"}
    assert drafted.solids["block"].position == pytest.approx(moved.position, abs=1e-4)
    assert drafted.solids["cup"].position == pytest.approx((0.42 + way, 0.0, 0.02), abs=1e-3)
    assert drafted.solids["upper"].position == pytest.approx((0.42 + way, 0.01, 0.06), abs=1e-3)
    pushed = score(here, hypothesis, drafted, drafted.solids)
    assert pushed.total == pytest.approx(nats.MOVED + 2.0 * min(nats.CONSEQUENCE, 0.5 * (way / 0.01) ** 2), abs=0.2)
    assert pushed.residuals == ()


def test_what_is_put_on_something_unseen_does_not_push_it() -> None:
    here = replace(situation(), believed=situation().believed | {"below": ASTRAY.moved((0.32, 0.0, 0.02))})
    drafted = draft(here, Hypothesis((Move("top"),)))
    assert drafted.pushed == frozenset()
    assert drafted.placements["top"].supports == ("below",)


def test_what_hovers_is_held_only_if_the_hypothesis_says_so() -> None:
    assert draft(situation(), Hypothesis((Move("top"),))).held == frozenset()
    assert draft(situation(), Hypothesis((Move("top", held=True),))).held == {"top"}
