"""Where a thing lies that something unknown moved: on a table, beyond its edge, on another thing, behind a screen."""

from __future__ import annotations

import numpy as np
import pytest

from dsr.believing.absence import Absence
from dsr.math3d.quaternions import Vector3
from simulation_handler.shapes.geometry import Solid
from simulation_handler.worlds.carriers import Carriers
from simulation_handler.worlds.elsewhere import LOOKED_AT, Area, HiddenPlaces, places_about
from tests.simulation_handler.worlds import container

TABLE = Solid("table", (0.8, 1.0, 0.04), (0.0, 0.0, 0.7), fixed=True)
FLOOR = Solid("_floor", (20.0, 20.0, 0.2), (0.0, 0.0, -0.1), fixed=True)
SHELF = Solid("shelf", (0.8, 1.0, 0.04), (0.0, 0.0, 1.5), fixed=True)
CUBE = Solid("cube", (0.04, 0.04, 0.04), (0.0, 0.0, 0.74))
FIXTURES = (TABLE, FLOOR, SHELF)
ABSENCE = Absence(rate=4.0, blind=0.02)
ROUND = LOOKED_AT
"""Looks after which cameras have been asked about each place"""


def areas(position: Vector3, deviation: float, *others: Solid, about: HiddenPlaces | None = None) -> list[Area]:
    """Where a cube may lie that was there, the fixtures and other things being about."""
    carriers = Carriers([*FIXTURES, *others])
    places = places_about(CUBE.moved(position), deviation, carriers)
    return (about or HiddenPlaces(0.0)).areas(places, deviation)


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
    assert (on_table.support, on_box.support) == ("table", "box")


def test_what_was_moved_beside_a_crate_may_lie_in_it_but_not_in_the_air_over_it() -> None:
    crate = Solid("crate", (0.3, 0.3, 0.15), (0.1, 0.0, 0.795), shape=container((0.3, 0.3, 0.15)))
    shares = {area.support: area.share for area in areas((0.0, 0.0, 0.74), 0.1, crate) if area.position[2] < 0.76}
    assert 0.3 < shares["crate"] < 0.8 and sum(shares.values()) > 0.9, "but for the rim"


def test_many_things_of_one_height_are_one_level() -> None:
    rng = np.random.default_rng(0)
    others = [
        Solid(f"cube_{x}_{y}", CUBE.size, (0.05 * x, 0.05 * y, 0.74 + 2e-4 * rng.normal()))
        for x in range(-3, 4) for y in range(-3, 4)
    ]  # fmt: skip
    on_table, on_cubes = sorted(areas((0.0, 0.0, 0.74), 0.05, *others), key=lambda area: area.position[2])
    assert on_cubes.position[2] == pytest.approx(0.78, abs=5e-4) and on_cubes.support == ""
    assert on_table.support == "table"


def test_what_was_moved_is_not_on_what_stands_on_a_higher_fixture() -> None:
    box = Solid("box", (0.3, 0.3, 0.1), (0.0, 0.0, 1.57))
    (area,) = areas((0.0, 0.0, 0.74), 0.05, box)
    assert area.position[2] == pytest.approx(0.74)
    shares = {area.support: area.share for area in areas((0.0, 0.0, 1.54), 0.05, box)}
    assert shares.keys() == {"box"}, "of what was on that fixture"


def test_what_is_thin_does_not_fall_through_what_it_lies_on() -> None:
    card, carriers = Solid("card", (0.08, 0.05, 0.002), (0.0, 0.0, 0.7195)), Carriers(FIXTURES)
    assert places_about(card, 0.05, carriers).positions[:, 2] == pytest.approx(0.721)


def test_what_nothing_is_known_to_carry_stays_on_its_level() -> None:
    (area,) = HiddenPlaces(0.0).areas(places_about(CUBE, 0.1, Carriers(())), 0.1)
    assert area.position == pytest.approx(CUBE.position) and area.support == ""


def look(about: HiddenPlaces, seen: float, rounds: int, begin: float = 0.0) -> float:
    """Look at all places about the cube for some rounds; cameras should see it `seen` (1) where x > 0, and not else.

    Gives the probability that it is not seen, if it is at one of these places.
    """
    unseen = 1.0
    for step in range(rounds * ROUND):
        asked = places_about(CUBE, 0.1, Carriers(FIXTURES), numbers=about.asked()).positions
        unseen *= about.miss([seen if x > 0.0 else 0.0 for x, _, _ in asked], begin + 0.2 * (step + 1), ABSENCE)
    return unseen


def test_what_cameras_do_not_see_is_where_they_do_not_look() -> None:
    about = HiddenPlaces(0.0)
    assert look(about, 1.0, 10) == pytest.approx(0.5, abs=0.02) == about.hidden
    (area,) = areas(CUBE.position, 0.1, about=about)
    assert area.position[0] == pytest.approx(-0.08, abs=0.01), "the mean of half of a Gaussian"
    assert area.sideways[0, 0] == pytest.approx(0.01 * (1.0 - 2.0 / np.pi), rel=0.25)
    assert area.sideways[1, 1] == pytest.approx(0.01)


def test_that_half_of_it_is_seen_tells_less() -> None:
    half, nothing = HiddenPlaces(0.0), HiddenPlaces(0.0)
    assert 0.5 < look(half, 0.5, 10) < 0.6
    assert look(nothing, 0.0, 10) == 1.0


def test_what_comes_later_is_looked_for_anew_and_what_came_before_is_not() -> None:
    for before in (False, True):
        about = HiddenPlaces(0.0)
        look(about, 1.0, 10)
        if before:
            about.join_before(0.9)
        else:
            about.join(0.9)
        (area,) = areas(CUBE.position, 0.1, about=about)
        assert (area.position[0] > -0.02) == (not before), "it may be in sight if it came just now"
        assert look(about, 1.0, 10, 8.0) == pytest.approx(1.0 if before else 0.1 + 0.9 * 0.5, abs=0.06)


def test_what_comes_bit_by_bit_is_as_what_comes_at_once() -> None:
    at_once, by_bits = HiddenPlaces(0.0), HiddenPlaces(0.0)
    for about in (at_once, by_bits):
        look(about, 1.0, 2)
    at_once.join(0.75)
    by_bits.join(0.5)
    by_bits.join(0.5)
    assert look(at_once, 1.0, 2, 1.6) == pytest.approx(look(by_bits, 1.0, 2, 1.6))


def test_time_in_which_cameras_do_not_look_tells_nothing() -> None:
    through, dark = HiddenPlaces(0.0), HiddenPlaces(0.0)
    for about in (through, dark):
        look(about, 1.0, 1)
    dark.pass_over(30.0)
    assert look(dark, 1.0, 1, 30.8) == pytest.approx(look(through, 1.0, 1, 0.8))
