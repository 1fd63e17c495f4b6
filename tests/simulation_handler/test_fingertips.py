"""Which fingertips touch an object: near it, not withdrawn from it, and not those of an open hand around it."""

from __future__ import annotations

import pytest

from simulation_handler.fingertips import FAR, TIP_RADIUS, Gaps, closed, meet
from simulation_handler.geometry import Solid

CUBE = Solid("cube", (0.04, 0.04, 0.04), (0.0, 0.0, 0.02))


@pytest.mark.parametrize(
    ("thumb", "index", "middle", "touching"),
    [
        (0.0, 0.0, 0.015, {"thumb", "index", "middle"}),
        (-0.005, 0.017, None, {"thumb", "index"}),
        (0.008, 0.008, None, {"thumb", "index"}),
        (0.014, 0.016, None, set()),
        (0.006, 0.002, 0.017, {"thumb", "index"}),
        (0.015, None, None, {"thumb"}),
        (0.019, 0.0, None, {"index"}),
    ],
)  # fmt: skip
def test_fingertips_far_apart_on_opposite_sides_do_not_touch(
    thumb: float, index: float | None, middle: float | None, touching: set[str]
) -> None:
    left, right = -0.02 - TIP_RADIUS, 0.02 + TIP_RADIUS
    points = {"thumb": (0.0, left - thumb, 0.02)}
    points |= {} if index is None else {"index": (0.0, right + index, 0.02)}
    points |= {} if middle is None else {"middle": (0.01, right + middle, 0.02)}
    met = meet(CUBE, points)
    assert {tip for tip in closed(met) if met[tip].gap <= FAR} == touching


TIP = ("thumb", "cube")
NOISE = (0.003, -0.004, 0.001, -0.002, 0.004, -0.002)


def touches(*gaps: float) -> bool:
    """Whether a fingertip touches in the end, that was at each gap for 0.6 s at 20 Hz, with noise."""
    known: set[tuple[str, str]] = set()
    tracked = Gaps()
    for step, noise in enumerate(2 * NOISE * len(gaps)):
        gap = gaps[step // (2 * len(NOISE))] + noise
        tracked.touching({("thumb", "other"): 0.03}, known, 0.05 * step)
        known = tracked.touching({TIP: gap}, known, 0.05 * step)
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
    assert gaps.touching({TIP: 0.0}, (), 0.0) == {TIP}
    assert gaps.touching({TIP: 0.014}, (), 0.3) == set()
    assert gaps.touching({TIP: 0.009}, (), 1.3) == {TIP}
