"""Brier scores are proper, and calibration curves tell how often what is told is so."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.honesty.answers import Answer, brier, calibration, sure_and_wrong


@pytest.mark.parametrize("true", [0.0, 0.2, 0.7, 1.0])
def test_the_true_probability_costs_least(true: float) -> None:
    def expected(told: float) -> float:
        return true * brier([Answer(told, True)], 1) + (1 - true) * brier([Answer(told, False)], 1)

    best = min(np.linspace(0.0, 1.0, 101), key=expected)
    assert best == pytest.approx(true)


def test_what_nobody_tells_and_is_not_so_costs_nothing() -> None:
    answers = [Answer(1.0, True), Answer(0.0, True), Answer(0.5, False)]
    assert brier(answers, 5) == pytest.approx((0.0 + 1.0 + 0.25) / 5)


def test_a_calibration_curve_of_honest_answers_is_straight() -> None:
    rng = np.random.default_rng(0)
    told = rng.random(20000)
    answers = [Answer(float(one), bool(is_so)) for one, is_so in zip(told, rng.random(20000) < told, strict=True)]
    classes = calibration(answers)
    assert [one.size for one in classes] and sum(one.size for one in classes) == len(answers)
    assert all(abs(one.told - one.is_so) < 0.05 for one in classes) and len(classes) == 10


def test_sure_and_wrong() -> None:
    answers = [Answer(0.95, False), Answer(1.0, True), Answer(0.9, True), Answer(0.5, False), Answer(0.0, True)]
    assert sure_and_wrong(answers) == pytest.approx(1 / 3)
    assert sure_and_wrong([Answer(0.5, True)]) is None
    assert [(one.told, one.is_so) for one in calibration([Answer(1.0, True), Answer(0.0, True)])] == [(0, 1), (1, 1)]
