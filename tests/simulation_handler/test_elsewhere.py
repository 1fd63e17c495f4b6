"""Where a thing lies that something unknown moved: on a table, beyond its edge, on another thing, behind a screen."""

from __future__ import annotations

import numpy as np
import pytest

from dsr.believing.absence import Absence
from dsr.math3d.quaternions import Vector3
from simulation_handler.shapes.geometry import Solid
from simulation_handler.worlds.elsewhere import LOOKED_AT, Area, Elsewhere, places_about

TABLE = Solid("table", (0.8, 1.0, 0.04), (0.0, 0.0, 0.7), fixed=True)
FLOOR = Solid("_floor", (20.0, 20.0, 0.2), (0.0, 0.0, -0.1), fixed=True)
SHELF = Solid("shelf", (0.8, 1.0, 0.04), (0.0, 0.0, 1.5), fixed=True)
CUBE = Solid("cube", (0.04, 0.04, 0.04), (0.0, 0.0, 0.74))
FIXTURES = (TABLE, FLOOR, SHELF)
ABSENCE = Absence(rate=4.0, blind=0.02)
ROUND = LOOKED_AT
"""Looks after which cameras have been asked about each place"""


def areas(position: Vector3, deviation: float, *others: Solid) -> list[Area]:
    """Where a cube may lie that was there."""
    return Elsewhere(0.0).areas(places_about(CUBE.moved(position), deviation, [*FIXTURES, *others]), deviation)


def test_what_was_moved_near_the_middle_of_a_table_is_on_it() -> None:
    (area,) = areas((0.0, 0.0, 0.74), 0.1)
    assert area.share == pytest.approx(1.0)
    assert area.position == pytest.approx((0.0, 0.0, 0.74))
    assert area.sideways == pytest.approx(0.01 * np.eye(2))


@pytest.mark.parametrize("x", [0.4, 0.3, 0.7])
def test_what_was_moved_near_the_edge_of_a_table_is_on_it_or_on_the_floor_beyond(x: float) -> None:
    """However high it was."""
    on_table, on_floor = sorted(areas((x, 0.0, 1.0), 0.2), key=lambda area: -area.position[2])
    assert (on_table.position[2], on_floor.position[2]) == pytest.approx((0.74, 0.02))
    assert on_table.position[0] < 0.4 < on_floor.position[0]
    assert on_table.share == pytest.approx({0.4: 0.5, 0.3: 0.69, 0.7: 0.07}[x], abs=0.05)
    shares = np.array([area.share for area in (on_table, on_floor)])
    offsets = np.array([area.position[:2] for area in (on_table, on_floor)]) - (x, 0.0)
    assert shares @ offsets == pytest.approx((0.0, 0.0))
    spread = shares @ offsets[:, 0] ** 2, shares @ np.array([area.sideways[0, 0] for area in (on_table, on_floor)])
    assert sum(spread) == pytest.approx(0.04), "together they are as broad as before"


def test_what_was_moved_may_lie_on_another_thing_and_is_not_inside_it() -> None:
    box = Solid("box", (0.1, 0.1, 0.1), (0.1, 0.0, 0.77))
    on_table, on_box = areas((0.0, 0.0, 0.74), 0.1, box)
    assert on_box.position == pytest.approx((0.1, 0.0, 0.84), abs=0.02)
    assert 0.05 < on_box.share < 0.3 and on_table.position[0] < 0.0


def test_what_nothing_is_known_to_carry_stays_on_its_level() -> None:
    (area,) = Elsewhere(0.0).areas(places_about(CUBE, 0.1, ()), 0.1)
    assert area.position == pytest.approx(CUBE.position)


def look(about: Elsewhere, seen: float, rounds: int) -> float:
    """Look at all places about the cube for some rounds; cameras should see it `seen` (1) where x > 0, and not else.

    Gives the probability that it is not seen, if it is at one of these places.
    """
    places, unseen = places_about(CUBE, 0.1, FIXTURES), 1.0
    for step in range(rounds * ROUND):
        asked = places[about.asked()]
        unseen *= about.miss([seen if x > 0.0 else 0.0 for x, _, _ in asked], 0.2 * (step + 1), ABSENCE)
    return unseen


def test_what_cameras_do_not_see_is_where_they_do_not_look() -> None:
    about = Elsewhere(0.0)
    assert look(about, 1.0, 10) == pytest.approx(0.5, abs=0.02) == about.hidden
    (area,) = about.areas(places_about(CUBE, 0.1, FIXTURES), 0.1)
    assert area.position[0] == pytest.approx(-0.08, abs=0.01), "the mean of half of a Gaussian"
    assert area.sideways[0, 0] == pytest.approx(0.01 * (1.0 - 2.0 / np.pi), rel=0.25)
    assert area.sideways[1, 1] == pytest.approx(0.01)


def test_that_half_of_it_is_seen_tells_less() -> None:
    half, nothing = Elsewhere(0.0), Elsewhere(0.0)
    assert 0.5 < look(half, 0.5, 10) < 0.6
    assert look(nothing, 0.0, 10) == 1.0


def test_what_comes_later_is_looked_for_anew_and_what_came_before_is_not() -> None:
    places = places_about(CUBE, 0.1, FIXTURES)
    for before in (False, True):
        about = Elsewhere(0.0)
        look(about, 1.0, 10)
        about.join(0.9, before=before)
        (area,) = about.areas(places, 0.1)
        assert (area.position[0] > -0.02) == (not before), "it may be in sight if it came just now"
        assert look(about, 1.0, 10) == pytest.approx(1.0 if before else 0.5 + 0.05, abs=0.06)
