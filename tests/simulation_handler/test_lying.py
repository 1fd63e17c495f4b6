"""Where a thing lies that nothing holds: beneath where it was let go."""

from __future__ import annotations

import pytest

from simulation_handler.shapes.geometry import Solid
from simulation_handler.worlds.lying import let_go

TABLE = Solid("table", (0.8, 1.0, 0.04), (0.0, 0.0, 0.7), fixed=True)
FLOOR = Solid("_floor", (20.0, 20.0, 0.2), (0.0, 0.0, -0.1), fixed=True)
BOX = Solid("box", (0.1, 0.1, 0.1), (0.2, 0.0, 0.77))
CUBE = Solid("cube", (0.04, 0.04, 0.04), (0.0, 0.0, 1.0))
FIXTURES = (TABLE, FLOOR)


@pytest.mark.parametrize(
    ("x", "height", "supports"),
    [(0.0, 0.74, ("table",)), (0.2, 0.84, ("box",)), (0.6, 0.02, ()), (0.38, 0.74, ("table",))],
)  # fmt: skip
def test_what_is_let_go_in_the_air_lies_on_the_highest_thing_beneath(
    x: float, height: float, supports: tuple[str, ...]
) -> None:
    found = let_go(CUBE.moved((x, 0.0, 1.0)), [*FIXTURES, BOX])
    assert found is not None
    assert found.pose.t == pytest.approx((x, 0.0, height))
    assert found.supports == supports


def test_what_rests_stays_though_it_seems_to_be_pressed_in_a_little() -> None:
    found = let_go(CUBE.moved((0.0, 0.0, 0.738)), FIXTURES)
    assert found is not None and found.pose.t == pytest.approx((0.0, 0.0, 0.74))


def test_of_what_has_nothing_beneath_nobody_knows_where_it_lies() -> None:
    assert let_go(CUBE, [TABLE.moved((0.0, 0.0, 1.5))]) is None
