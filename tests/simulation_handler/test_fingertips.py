"""Which fingertips touch an object: near it, and not withdrawn from it."""

from __future__ import annotations

import math

import pytest

from simulation_handler.hands.anatomy import HAND
from simulation_handler.hands.fingertips import FAR, Gaps, Met, Spans, is_opposed, meet
from simulation_handler.shapes.geometry import Solid
from tests.simulation_handler.worlds import container

CUBE = Solid("cube", (0.04, 0.04, 0.04), (0.0, 0.0, 0.02))

RADIUS = HAND.tip_radius


def test_gaps_and_ways_out_are_those_between_surfaces() -> None:
    reach = 0.02 + RADIUS
    points = {"thumb": (0.0, -reach - 0.005, 0.02), "index": (0.0, reach - 0.001, 0.02), "middle": (0.1, 0.0, 0.02)}
    met = meet(CUBE, points)
    assert met.keys() == {"thumb", "index"}
    assert (met["thumb"].gap, met["index"].gap) == (pytest.approx(0.005), pytest.approx(-0.001))
    assert met["thumb"].normal == pytest.approx((0.0, -1.0, 0.0))
    assert is_opposed(met) and not is_opposed({"thumb": met["thumb"], "index": None})


TIP = ("thumb", "cube")
USUAL = 0.005  # m, noise of percepts of what is in full view
NOISE = (0.003, -0.004, 0.001, -0.002, 0.004, -0.002)


def touches(*gaps: float) -> bool:
    """Whether a fingertip touches in the end, that was at each gap for 0.6 s at 20 Hz, with noise."""
    known: set[tuple[str, str]] = set()
    tracked = Gaps()
    for step, noise in enumerate(2 * NOISE * len(gaps)):
        gap = gaps[step // (2 * len(NOISE))] + noise
        tracked.touching({("thumb", "other"): 0.03}, known, USUAL, 0.05 * step)
        known = tracked.touching({TIP: gap}, known, USUAL, 0.05 * step)
    return bool(known)


@pytest.mark.parametrize("touch", [-0.01, -0.002, 0.004])
def test_a_fingertip_touches_until_it_is_further_away_than_while_it_touched(touch: float) -> None:
    away = max(touch, 0.0) + 0.013
    assert touches(touch)
    assert touches(touch, touch + 0.005)
    assert not touches(touch, away)
    assert not touches(touch, away, away, away)
    assert touches(touch, away, touch)
    assert not touches(0.017)


def test_what_was_far_away_is_forgotten() -> None:
    gaps = Gaps()
    assert gaps.touching({TIP: 0.0}, (), USUAL, 0.0) == {TIP}
    assert gaps.touching({TIP: 0.014}, (), USUAL, 0.3) == set()
    assert gaps.touching({TIP: 0.009}, (), USUAL, 1.3) == {TIP}


@pytest.mark.parametrize(("noise", "frames"), [(USUAL, 1), (2.0 * USUAL, 3)])
def test_what_is_half_covered_is_off_and_its_touch_ends_later(noise: float, frames: int) -> None:
    """A cube of colour that a hand covers more and more is seen ever farther from the fingertips that hold it."""
    gaps = Gaps()
    known = gaps.touching({TIP: 0.0}, (), noise, 0.0)
    for number in range(1, 10):
        known = gaps.touching({TIP: 0.028}, known, noise, 0.1 * number)
        assert bool(known) == (number < frames)


@pytest.mark.parametrize(("half", "is_pinch"), [(0.045 + RADIUS, True), (0.042 - RADIUS, False)])
def test_fingertips_that_are_spread_in_a_container_do_not_pinch_it(half: float, is_pinch: bool) -> None:
    size = (0.09, 0.09, 0.08)
    cup = Solid("cup", size, (0.0, 0.0, 0.04), shape=container(size))
    met = meet(cup, {"thumb": (0.0, -half, 0.05), "index": (0.0, half, 0.05)})
    assert met.keys() == {"thumb", "index"}
    assert is_opposed(met) == is_pinch


def test_one_wall_of_a_container_is_pinched_from_both_sides() -> None:
    size = (0.09, 0.09, 0.08)
    cup = Solid("cup", size, (0.0, 0.0, 0.04), shape=container(size))
    assert is_opposed(meet(cup, {"thumb": (0.0, 0.042 - RADIUS, 0.06), "index": (0.0, 0.045 + RADIUS, 0.06)}))


@pytest.mark.parametrize(("apart", "is_closed"), [(0.0, True), (0.008, True), (0.012, False), (-0.012, False)])
def test_fingertips_that_pinched_are_closed_while_they_are_as_far_apart(apart: float, is_closed: bool) -> None:
    spans, relation = Spans(), ("hand", "cup")
    places = {"thumb": (0.0, 0.03, 0.0), "index": (0.0, -0.03, 0.0)}
    ways = {"thumb": (0.0, 1.0, 0.0), "index": (0.0, -1.0, 0.0)}
    spans.note(relation, {tip: Met(0.0, ways[tip], place) for tip, place in places.items()})
    moved = places | {"thumb": (0.0, 0.03 + apart, 0.0)}
    cup = Solid("cup", (0.04, 0.04, 0.04), (0.0, 0.0, 0.0))
    assert spans.closed(relation, moved, cup, USUAL) == (set(moved) if is_closed else set())
    assert spans.closed(relation, {"thumb": moved["thumb"]}, cup, USUAL) == set()
    spans.keep(())
    assert spans.closed(relation, places, cup, USUAL) == set()


@pytest.mark.parametrize(("height", "is_closed"), [(0.0, True), (0.019, True), (0.021, False), (-0.021, False)])
def test_fingertips_that_slide_off_what_they_pinched_are_not_closed_about_it(height: float, is_closed: bool) -> None:
    spans, relation = Spans(), ("hand", "cup")
    places = {"thumb": (0.0, 0.03, 0.0), "index": (0.0, -0.03, 0.0)}
    ways = {"thumb": (0.0, 1.0, 0.0), "index": (0.0, -1.0, 0.0)}
    spans.note(relation, {tip: Met(0.0, ways[tip], place) for tip, place in places.items()})
    off = height + math.copysign(FAR, height)  # half of the cup is 20 mm high
    moved = {tip: (x, y, off) for tip, (x, y, _) in places.items()}
    cup = Solid("cup", (0.04, 0.04, 0.04), (0.0, 0.0, 0.0))
    assert spans.closed(relation, moved, cup, USUAL) == (set(moved) if is_closed else set())
