"""Surprise at what happens behind a screen: nothing for what physics lets expect, more the less it can be."""

from __future__ import annotations

import math

import pytest

from tests.benchmarks.unseen.stage import Stage, sliding


def test_what_comes_out_as_physics_says_is_no_surprise() -> None:
    nats = Stage().play(4.4, sliding())
    assert max(nats[30:]) < 1.5, "after it has become known"


def test_what_stays_hidden_is_less_surprising_than_what_has_vanished() -> None:
    def stopped(time: float) -> tuple[float, float]:
        return -0.6, min(-2.2 + time, 0.0)

    def vanished(time: float) -> tuple[float, float] | None:
        return sliding()(time) if time < 2.2 else None

    def stands(time: float) -> bool:
        return time < 5.0

    hidden, gone = (Stage().play(6.5, course, screen=stands) for course in (stopped, vanished))
    assert hidden[:124] == pytest.approx(gone[:124], abs=1e-9), "until it can be told"
    assert 1.0 < max(hidden[75:]) < 5.0
    assert max(gone[125:]) > 5.0 and max(gone[125:]) > max(hidden[75:]) + 1.5


def test_a_stranger_from_behind_the_screen_is_less_surprising_than_one_from_nothing() -> None:
    def emerges(time: float) -> tuple[float, float] | None:
        return sliding(begin=0.0)(time)

    def appears(time: float) -> tuple[float, float] | None:
        return sliding(begin=0.0)(time) if time >= 2.0 else None

    hidden = Stage().play(3.0, emerges)
    nothing = Stage().play(3.0, appears, screen=lambda _: False)
    assert max(hidden) < 6.0
    assert max(nothing) > 9.0


def test_it_is_the_same_with_the_same_seed() -> None:
    one, other, third = (Stage(seed).play(3.0, sliding()) for seed in (3, 3, 4))
    assert one == other
    assert all(math.isfinite(nats) and nats >= 0.0 for nats in (*one, *third))


def test_two_things_that_pass_each_other_behind_the_screen_keep_their_identity() -> None:
    nats = Stage().play(4.4, sliding(x=-0.4), sliding(begin=2.2, speed=-1.0, x=-1.6))
    assert max(nats[40:]) < 2.0
