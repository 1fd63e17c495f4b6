"""Objects that are set in motion: balls roll and fall off the table, cubes slide, and nothing else helps them on."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from agents.plant.reality import Reality
from agents.scenario.format.scenario import HandEnter, Lift, ObjectSpec, Push, Remove, Roll, Slide, TableSpec
from dsr.math3d.shapes import Part

MakeReality = Callable[..., Reality]
MakeCube = Callable[..., ObjectSpec]
Play = Callable[..., None]
G = 9.81
RADIUS = 0.03
BALL = ObjectSpec(
    name="ball",
    type="ball",
    size=(0.06, 0.06, 0.06),
    shape=(Part("sphere", (0.06, 0.06, 0.06)),),
    rolling_friction=0.002,
    color=(1.0, 0.85, 0.0),
    known=True,
    position=(0.2, 0.0, RADIUS),
)


def test_a_ball_rolls_as_far_as_its_friction_lets_it(make_reality: MakeReality, play: Play) -> None:
    reality = make_reality(BALL, events=[Roll(at=0.1, object="ball", velocity=(0.0, 0.3))])
    play(reality, 0.15)
    velocity, spin = reality.world.velocity("ball")
    assert velocity[1] == pytest.approx(0.28, abs=0.02) and spin[0] == pytest.approx(-velocity[1] / RADIUS, rel=0.02)
    play(reality, 1.5, start=0.15)
    slowing = 0.002 / RADIUS * G / 1.4  # m/s^2 of a solid ball whose rolling is resisted with that lever arm
    assert reality.world.is_still("ball")
    assert reality.world.pose("ball").t == pytest.approx((0.2, 0.3**2 / (2 * slowing), RADIUS), abs=0.01)


def test_a_ball_rolls_less_far_on_a_rougher_table(make_reality: MakeReality, play: Play) -> None:
    ends = []
    for friction in (0.5, 2.0):
        roll = Roll(at=0.1, object="ball", velocity=(0.0, 0.2))
        reality = make_reality(BALL, events=[roll], table=TableSpec(friction=friction))
        play(reality, 2.5)
        ends.append(reality.world.pose("ball").t[1])
    assert ends[1] < 0.5 * ends[0]


def test_a_ball_that_is_fast_enough_falls_off_the_table(make_reality: MakeReality, play: Play) -> None:
    reality = make_reality(BALL, events=[Roll(at=0.1, object="ball", velocity=(0.0, 1.5))])
    play(reality, 3.0)
    assert reality.world.pose("ball").t[1] > 0.6 and reality.world.pose("ball").t[2] < -0.6


@pytest.mark.parametrize("how", [{"velocity": (-0.5, 0.0, 0.0)}, {"impulse": (-0.025, 0.0, 0.0)}])
def test_a_pushed_cube_slides_until_friction_stops_it(
    make_reality: MakeReality, cube: MakeCube, play: Play, how: dict[str, tuple[float, float, float]]
) -> None:
    reality = make_reality(cube(3, 0.4, 0.08, mass=0.05), events=[Push(at=0.1, object="cube_3", **how)])
    play(reality, 1.0)
    slid = 0.5**2 / (2 * 0.6 * G)
    assert reality.world.pose("cube_3").t == pytest.approx((0.4 - slid, 0.08, 0.02), abs=0.004)
    assert reality.experimenter.spans[1] == (pytest.approx(0.1, abs=5e-3),) * 2


def test_a_pushed_object_pushes_what_is_in_its_way(make_reality: MakeReality, cube: MakeCube, play: Play) -> None:
    events = [Push(at=0.1, object="cube_3", velocity=(-0.8, 0.0, 0.0))]
    reality = make_reality(cube(3, 0.4, 0.0), cube(4, 0.35, 0.0), events=events)
    play(reality, 1.0)
    assert reality.world.pose("cube_4").t[0] < 0.34
    assert reality.world.pose("cube_3").t[0] - reality.world.pose("cube_4").t[0] >= 0.0395


def test_what_is_pushed_is_held_no_longer(make_reality: MakeReality, cube: MakeCube, play: Play) -> None:
    events = [
        Lift(at=0.0, object="cube_3", height=0.1, speed=1.0),
        Push(at=0.5, object="cube_3", velocity=(0.0, 1.0, 0.0)),
    ]
    reality = make_reality(cube(3, 0.4, 0.0), events=events)
    play(reality, 2.0)
    assert not reality.truth(2.0).grasped
    assert reality.world.pose("cube_3").t[1] == pytest.approx(math.sqrt(2 * 0.1 / G), abs=0.1)
    assert reality.world.pose("cube_3").t[2] == pytest.approx(0.02, abs=2e-3)


def test_a_hand_pushes_from_behind_and_lets_go(make_reality: MakeReality, play: Play) -> None:
    reality = make_reality(BALL, events=[Roll(at=0.0, object="ball", velocity=(0.0, 0.3), hand=0)])
    nearest, rolled = 1.0, 0.0
    for step in range(4 * 240):
        reality.step(step / 240)
        ball = reality.world.pose("ball").t
        tips = [np.array(point) for hand in reality.hands.present for point in hand.landmarks]
        if ball[1] < 0.001:
            nearest = min([nearest, *(float(np.linalg.norm(tip - ball)) for tip in tips)])
        rolled = rolled or (step / 240 if ball[1] > 0.01 else 0.0)
    (hand,) = reality.hands.present
    assert nearest < RADIUS + 0.015 and rolled > 0.5
    assert hand.held is None and hand.pose.t[1] < reality.world.pose("ball").t[1]
    assert reality.world.pose("ball").t[1] == pytest.approx(0.096, abs=0.02)


def test_a_push_of_what_is_not_there_is_told_as_given_up(make_reality: MakeReality, cube: MakeCube, play: Play) -> None:
    events = [
        Remove(at=0.0, object="cube_3"),
        Push(at=0.1, object="cube_3", velocity=(1.0, 0.0, 0.0)),
        Slide(at=0.1, object="cube_4", by=(0.01, 0.0)),
        HandEnter(at=0.1, position=(0.3, 0.0, 0.2)),
    ]
    reality = make_reality(cube(3, 0.4, 0.0), cube(4, 0.4, 0.2), events=events)
    play(reality, 0.3)
    assert list(reality.truth(0.3).given_up) == [2]
    assert "no object 'cube_3' in the scene" in reality.truth(0.3).given_up[2]
