"""Components of a thing: shares, masses, what percepts and absences do, and copies that meet walls."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.adept.cases import CAMERA, LENS
from benchmarks.adept.unseen.ghosts import Ghosts, Mechanics, States
from benchmarks.adept.unseen.motions import Components, Motions
from benchmarks.adept.unseen.rates import EventRates
from benchmarks.adept.unseen.sight import CameraSight
from dsr.math3d.shapes import Part
from tests.benchmarks.unseen.stage import SCREEN, SIZE, SLIDING

OPEN, CLOSED = CameraSight(CAMERA, LENS), CameraSight(CAMERA, LENS, (SCREEN,), ("screen",))
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


def states(*places: tuple[float, float], velocity: tuple[float, float] = (0.0, 0.0)) -> States:
    count = len(places)
    position = np.array([(x, y, 0.3) for x, y in places])
    return States(
        position, np.tile(UPRIGHT, (count, 1)), np.tile((*velocity, 0.0), (count, 1)), np.zeros((count, 3))
    )


def thing(*places: tuple[float, float], columns: int = 6) -> Motions:
    count = len(places)
    mass = np.full((count, columns), -math.log(count))
    parts = Components(states(*places), np.tile([1e-4, 0, 0], (count, 1)), np.zeros(count), mass,
                       np.full(columns, -1e3))  # fmt: skip
    return Motions("box", SIZE, parts, EventRates(), 1.0, 0)


def test_copies_slide_without_friction_and_bounce_off_walls_but_not_off_each_other() -> None:
    ghosts = Ghosts(SIZE, SLIDING)
    wall = {"wall": ((0.2, 4.0, 1.0), (1.0, 0.0, 0.5), UPRIGHT)}
    moved = states((-1.0, 0.0), (-1.1, 0.0), (-1.0, 1.0), velocity=(1.0, 0.0))
    for _ in range(20):
        moved = ghosts.advance(moved, 0.04, wall)
    assert moved.position[:, 0] == pytest.approx([-0.2, -0.3, -0.2], abs=0.01)
    for _ in range(60):
        moved = ghosts.advance(moved, 0.04, wall)
    assert (moved.velocity[:, 0] < -0.5).all() and (moved.position[:, 0] < 0.6).all()
    assert (moved.position[:, 2] > 0.28).all(), "nothing falls through the floor"
    ghosts.close()
    ghosts.close()


def test_friction_stops_them() -> None:
    ghosts = Ghosts(SIZE, Mechanics(gravity=9.81, friction=0.5))
    moved = states((0.0, 0.0), velocity=(1.0, 0.0))
    for _ in range(25):
        moved = ghosts.advance(moved, 0.04, {})
    assert abs(moved.velocity[0, 0]) < 0.01 and moved.position[0, 0] == pytest.approx(1 / (2 * 0.5 * 9.81), rel=0.2)
    ghosts.close()


def test_shares_are_of_what_faces_the_camera_in_the_image_and_past_obstacles() -> None:
    places = np.array([(-0.6, 0.0, 0.3), (-0.6, 1.05, 0.3), (-0.6, 2.0, 0.3), (-0.6, 9.0, 0.3), (9.0, 0.0, 0.3)])
    turns = np.tile(np.eye(3), (5, 1, 1))
    hidden, partly, free, outside, behind = CLOSED.shares("box", SIZE, places, turns)
    assert (hidden, free, outside, behind) == (0.0, 1.0, 0.0, 0.0) and 0.2 < partly < 0.9
    assert OPEN.shares("box", SIZE, places[:2], turns[:2]) == pytest.approx([1.0, 1.0])
    own = CameraSight(CAMERA, LENS, (Part("box", SIZE, (-0.6, 0.0, 0.3)),), ("box",))
    assert own.shares("box", SIZE, places[:1], turns[:1]) == pytest.approx([1.0]), "nothing hides itself"
    assert OPEN.shares("box", SIZE, np.zeros((0, 3)), np.zeros((0, 3, 3))).shape == (0,)


def test_absence_in_full_view_makes_a_place_improbable_and_behind_the_screen_it_does_not() -> None:
    tried = thing((-0.6, 0.0), (-0.6, 2.0))
    for _ in range(4):
        tried.look(CLOSED)
        tried.take_in(tried.absence(()), None, None)
    best = tried.best
    assert best is not None and best[0][1] == 0.0
    assert tried.improbability(1) == pytest.approx(math.log(2), abs=0.01), "half of what was believed is refuted"


def test_a_percept_chooses_among_places_and_others_exclude_theirs() -> None:
    tried = thing((-0.6, 0.0), (-0.6, 0.5))
    tried.look(OPEN)
    place = np.array((-0.6, 0.48, 0.3))
    assert tried.evidence(tried.presence(place, ())) > tried.evidence(tried.presence(place, ((SIZE, place),)))
    tried.take_in(tried.presence(place, ()), place, UPRIGHT)
    best = tried.best
    assert best is not None and best[0][1] == pytest.approx(0.495, abs=0.02)


def test_masses_stay_a_distribution_and_bounded_in_number_however_long_nothing_is_seen() -> None:
    ghosts, tried = Ghosts(SIZE, SLIDING), thing((-0.6, 0.0))
    tried.seen = False
    for _ in range(500):
        tried.predict(0.04, ghosts, {})
    masses = np.append(tried._parts.mass[:, 0], tried._parts.gone[0])
    assert np.exp(masses).sum() == pytest.approx(1.0) and len(masses) <= 145
    rested = 1.0 - math.exp(-0.05 * 20.0)
    moved = np.abs(tried._parts.states.position[:, 1]) > 0.5
    assert 0.1 < np.exp(tried._parts.mass[moved, 0]).sum() < rested + 0.1
    ghosts.close()
