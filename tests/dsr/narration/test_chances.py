"""Where a thing could be, in words: what is told, what is not, and the answers to questions."""

from __future__ import annotations

import numpy as np
import pytest

from dsr import Alternative, Memory, Pose, Whereabouts
from dsr.believing.distribution import ATTRIBUTE, encoded
from dsr.narration import Basis, Moment, account, chances, chances_of_thing
from dsr.narration.answers import answer_alone
from dsr.narration.chances import alternative_words
from dsr.vocabulary.sentences import percent

THERE = Pose((0.2, -0.3, 0.05), covariance=np.diag([0.04, 0.04, 0.01, 1.0, 1.0, 1.0]))


def ball(first: float) -> Whereabouts:
    """A ball in the box, or in a hand, or gone."""
    rest = 1.0 - first
    alternatives = (
        Alternative(weight=first, pose=Pose((0.5, 0.0, 0.03)), containers=("box",)),
        Alternative(weight=0.75 * rest, pose=THERE, hand="hand_0", reason="taken", worlds=(1,)),
        Alternative(weight=0.25 * rest, pose=None, reason="gone", worlds=(2,)),
    )
    return Whereabouts("ball", alternatives, ("ball",), (first, 0.75 * rest, 0.25 * rest))


def test_alternatives_are_told_with_their_probabilities(memory: Memory) -> None:
    memory.update_node("ball", **{ATTRIBUTE: encoded(ball(0.6))})
    told = chances_of_thing(Moment.of(memory), memory.node("ball"))
    assert told is not None and told.basis is Basis.BELIEVED and told.confidence == pytest.approx(0.6)
    assert told.text == (
        "ball is probably in box, at x 0.50 m, y 0.00 m (60 %), but could be "
        "in hand_0, within about 17 cm of x 0.20 m, y -0.30 m (30 %); or gone (10 %)."
    )
    assert set(told.names) == {"ball", "box", "hand_0"}
    assert [row["probability"] for row in told.evidence["alternatives"]] == pytest.approx([0.6, 0.3, 0.1])


def test_what_is_all_but_certain_needs_no_alternatives(memory: Memory) -> None:
    assert chances_of_thing(Moment.of(memory), memory.node("ball")) is None
    memory.update_node("ball", **{ATTRIBUTE: encoded(ball(0.97))})
    assert chances_of_thing(Moment.of(memory), memory.node("ball")) is None
    wide = Pose((0.5, 0.0, 0.03), covariance=np.diag([0.01] * 6))
    less_exactly = (
        Alternative(weight=0.8, pose=Pose((0.5, 0.0, 0.03)), containers=("box",)),
        Alternative(weight=0.2, pose=wide, containers=("box",), worlds=(1,)),
    )
    memory.update_node("ball", **{ATTRIBUTE: encoded(Whereabouts("ball", less_exactly, ("ball",), (0.8, 0.2)))})
    assert chances_of_thing(Moment.of(memory), memory.node("ball")) is None, "the same place, less exactly"
    beside = Pose((0.502, 0.001, 0.03))
    as_told = (*less_exactly[:1], Alternative(weight=0.2, pose=beside, containers=("box",), worlds=(1,)))
    memory.update_node("ball", **{ATTRIBUTE: encoded(Whereabouts("ball", as_told, ("ball",), (0.8, 0.2)))})
    assert chances_of_thing(Moment.of(memory), memory.node("ball")) is None, "the same in words"


def test_questions_and_accounts_list_alternatives(memory: Memory) -> None:
    memory.update_node("ball", **{ATTRIBUTE: encoded(ball(0.6))})
    response = answer_alone(Moment.of(memory), "where is the ball?", "nobody simulates")
    assert "in hand_0" in response.text and "(30 %)" in response.text and "(60 %)" in response.text
    assert tuple(response.names) == ("box",)
    told = [statement.text for statement in account(Moment.of(memory), about=["ball"])]
    assert sum("could be in hand_0" in text for text in told) == 1


def test_rows_are_plain_data_of_every_alternative(memory: Memory) -> None:
    memory.update_node("ball", **{ATTRIBUTE: encoded(ball(0.97))})
    found = memory.belief("ball")
    assert found is not None
    rows = chances(found)
    assert [row["gone"] for row in rows] == [False, False, True]
    assert rows[0]["in"] == ["box"] and rows[1]["hand"] == "hand_0" and rows[2]["place"] is None
    assert rows[1]["deviation"] == pytest.approx(np.sqrt(0.09 / 3), abs=1e-3)


def test_words_never_claim_certainty() -> None:
    assert [percent(p) for p in (0.0, 0.001, 0.5, 0.999, 1.0)] == ["0 %", "less than 1 %", "50 %", "more than 99 %",
                                                                   "100 %"]  # fmt: skip
    assert alternative_words(Alternative(weight=1.0, pose=Pose((0.1, 0.2, 0.3)))) == "at x 0.10 m, y 0.20 m, z 0.30 m"
