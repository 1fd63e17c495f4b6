"""What the last percepts of something on its way say of how it went on."""

from __future__ import annotations

import numpy as np
import pytest

from dsr.math3d.transforms import Pose
from simulation_handler.config import BeliefConfig
from simulation_handler.explaining.glimpses import DRAW_COUNT, Glimpse, glimpse_of
from simulation_handler.perception.percepts import SeenObject, WeighedPercept, weighed
from simulation_handler.shapes.geometry import Solid
from tests.simulation_handler.worlds import CUBE

CONFIG = BeliefConfig()
ABOVE = (0.3, 0.0, 0.7)


def percept(stamp: float, pose: Pose) -> WeighedPercept:
    return weighed([SeenObject("cube", pose, stamp, ABOVE)], CONFIG)[0]


def glimpse(*trail: WeighedPercept, bias: float = 0.0) -> Glimpse:
    return glimpse_of(Solid("cube", CUBE, (0.3, 0.0, 0.06)), trail, bias, CONFIG.learned_bias)


BEFORE = percept(1.0, Pose.from_rotvec((0.3, 0.0, 0.06), (0.0, 0.0, 0.5)))
TIPPING = percept(1.1, Pose.from_rotvec((0.32, 0.0, 0.062), (0.0, 0.2, 0.0)) @ Pose.from_rotvec((0, 0, 0), (0, 0, 0.5)))


def test_two_percepts_say_how_fast_it_moves_and_turns() -> None:
    seen = glimpse(BEFORE, TIPPING)
    assert seen.velocity[:2] == pytest.approx((0.2, 0.0), abs=0.01)
    assert seen.spin == pytest.approx((0.0, 2.0, 0.0), abs=1e-6)


def test_what_may_be_noise_of_the_depth_is_no_velocity_but_a_fall_is() -> None:
    assert glimpse(BEFORE, TIPPING).velocity @ TIPPING.ray == pytest.approx(0.0, abs=1e-9)
    falling = percept(1.1, Pose((0.3, 0.0, 0.02)))
    assert glimpse(BEFORE, falling).velocity == pytest.approx((0.0, 0.0, -0.4), abs=1e-6)


def test_one_percept_or_one_of_long_ago_says_nothing_of_that() -> None:
    for trail in ((TIPPING,), (percept(0.0, Pose((0.2, 0.0, 0.06))), TIPPING)):
        assert np.all(glimpse(*trail).velocity == 0.0) and np.all(glimpse(*trail).spin == 0.0)


def test_the_known_error_of_the_depth_is_undone() -> None:
    assert glimpse(percept(1.0, Pose((0.3, 0.0, 0.07))), bias=-0.01).solid.position == pytest.approx((0.3, 0.0, 0.06))


def test_the_ways_it_may_have_gone_on_surround_what_was_seen_and_are_the_same_each_time() -> None:
    seen = glimpse(BEFORE, TIPPING)
    motions = [seen.motion(draw) for draw in range(DRAW_COUNT)]
    assert motions == [glimpse(BEFORE, TIPPING).motion(draw) for draw in range(DRAW_COUNT)]
    assert motions[0].solid == seen.solid and len({motion.solid.position for motion in motions}) > DRAW_COUNT // 2
    assert {round(motion.spin[1], 6) for motion in motions} == {2.0, 4.0, 6.0}
    shifts = np.array([motion.solid.position for motion in motions]) - seen.solid.position
    assert np.abs(shifts).max() < 4.0 * np.sqrt(np.diag(seen.covariance).max())
