"""Which fingertips touch an object: near it, not withdrawn from it, and not those of an open hand around it."""

from __future__ import annotations

import pytest

from simulation_handler.fingertips import FAR, NEAR, TIP_RADIUS, Gaps, meet
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
    assert meet(CUBE, points, dict.fromkeys(points, FAR)).keys() == touching


TIP = ("thumb", "cube")


@pytest.mark.parametrize(("gap", "most"), [(-0.01, NEAR), (0.004, 0.012), (0.01, FAR)])
def test_a_fingertip_touches_until_it_is_further_away_than_while_it_touched(gap: float, most: float) -> None:
    gaps = Gaps()
    assert gaps.most(TIP) == FAR
    gaps.update({TIP: gap}, ())
    for _ in range(30):
        gaps.update({TIP: gap}, [TIP])
    assert gaps.most(TIP) == pytest.approx(most)
    gaps.update({}, [TIP])
    assert gaps.most(TIP) == pytest.approx(most)
    gaps.update({}, ())
    assert gaps.most(TIP) == FAR


def test_one_gap_that_is_off_changes_little() -> None:
    gaps = Gaps()
    for gap in (0.002, 0.002, 0.007):
        gaps.update({TIP: gap}, [TIP])
    assert gaps.most(TIP) == pytest.approx(0.011)
