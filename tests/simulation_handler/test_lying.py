"""Where a thing lies that nothing holds: beneath where it was let go, on a table or beyond its edge."""

from __future__ import annotations

import numpy as np
import pytest

from dsr.math3d.transforms import Pose
from simulation_handler.shapes.geometry import Solid
from simulation_handler.worlds.alternatives import ELSEWHERE, FOLLOWED, Alternatives, Mode
from simulation_handler.worlds.lying import let_go, moved_about

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


def test_what_was_moved_near_the_middle_of_a_table_is_on_it() -> None:
    (area,) = moved_about(CUBE.moved((0.0, 0.0, 0.74)), 0.74, 0.1, FIXTURES)
    assert area.share == 1.0
    assert area.position == pytest.approx((0.0, 0.0, 0.74))
    assert area.sideways == pytest.approx(0.01 * np.eye(2))


@pytest.mark.parametrize("x", [0.4, 0.3, 0.7])
def test_what_was_moved_near_the_edge_of_a_table_is_on_it_or_on_the_floor_beyond(x: float) -> None:
    """However it was held."""
    areas = moved_about(CUBE.moved((x, 0.0, 1.0)), 0.74 if x <= 0.4 else 0.02, 0.2, FIXTURES)
    on_table, on_floor = sorted(areas, key=lambda area: -area.position[2])
    assert (on_table.position[2], on_floor.position[2]) == pytest.approx((0.74, 0.02))
    assert on_table.position[0] < 0.4 < on_floor.position[0]
    assert on_table.share == pytest.approx({0.4: 0.5, 0.3: 0.69, 0.7: 0.07}[x], abs=0.05)
    shares = np.array([area.share for area in areas])
    offsets = np.array([area.position[:2] for area in areas]) - (x, 0.0)
    assert shares @ offsets == pytest.approx((0.0, 0.0))
    spread = shares @ offsets[:, 0] ** 2, shares @ np.array([area.sideways[0, 0] for area in areas])
    assert sum(spread) == pytest.approx(0.04), "together they are as broad as before"


def test_what_nothing_is_known_to_carry_stays_on_its_level() -> None:
    (area,) = moved_about(CUBE, CUBE.position[2], 0.1, ())
    assert area.position == pytest.approx(CUBE.position)


def test_what_was_moved_lies_as_high_as_the_likelier_of_held_and_not_has_it() -> None:
    """However little comes from a hand, it does not lift what was moved about on the table."""
    modes, high = Alternatives.__new__(Alternatives), Pose((0.0, 0.0, 0.9))
    modes.modes = {FOLLOWED: Mode(1.0, high), ELSEWHERE: Mode(0.1, Pose((0.0, 0.0, 0.05)))}
    modes._pass(FOLLOWED, ELSEWHERE, 1e-6, Mode(0.0, high, held=1.0))
    elsewhere = modes.modes[ELSEWHERE]
    assert elsewhere.pose is not None and elsewhere.pose.t[2] == 0.05 and elsewhere.held < 0.5
    modes._pass(FOLLOWED, ELSEWHERE, 0.5, Mode(0.0, high, held=1.0))
    assert elsewhere.pose is not None and elsewhere.pose.t[2] == 0.9 and elsewhere.held > 0.5
