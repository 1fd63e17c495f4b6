"""What all percepts of a place have wrong alike, once a support tells the height."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dsr.math3d.transforms import Pose
from simulation_handler.config import BeliefConfig
from simulation_handler.contact.placement import Placement
from simulation_handler.perception.percepts import SeenObject, weighed
from simulation_handler.perception.tracking import Given, PerceptTrack
from simulation_handler.state.objects import BelievedObject
from simulation_handler.worlds.parameters import ConstantErrors

CONFIG = BeliefConfig()
STATED = 0.003
SHARES = ConstantErrors(color=0.1)


def resting(slope: float, *, tagged: bool = False, turn_std: float = 0.01) -> BelievedObject:
    """A thing seen from +x, along a ray that goes down by `slope` (1) of its length; its percepts do not scatter."""
    track = PerceptTrack(CONFIG)
    item = BelievedObject("crate", (0.1, 0.1, 0.1), 0.1, 0.5, track, tagged=tagged)
    eye = 0.4 + math.sqrt(1.0 - slope**2), 0.0, 0.05 + slope
    pose = Pose((0.4, 0.0, 0.05), (0.0, 0.0, 0.0, 1.0), 0.0, np.diag([STATED**2] * 3 + [turn_std**2] * 3))
    for k in range(20):
        percept = weighed([SeenObject("crate", pose, 0.1 * (k + 1), eye)], CONFIG)[0]
        track.add([Given(track, percept, False)])
        item.note(percept, "camera")
    item.placement = Placement(item.solid(pose.t, pose.q), ("table",), np.eye(3) * 1e-8)
    return item


@pytest.mark.parametrize("slope", [0.4, 0.7, 0.95])
def test_an_error_of_height_moves_the_place_the_more_the_flatter_it_is_seen(slope: float) -> None:
    error = resting(slope).constant_error(SHARES, CONFIG)
    assert error is not None
    across = math.sqrt(error[1, 1])
    assert math.sqrt(error[0, 0]) == pytest.approx(across / slope, rel=0.05)
    assert error[2] == pytest.approx(0.0, abs=1e-12)


def test_what_shows_how_it_is_turned_errs_alike_too_unless_it_has_a_tag() -> None:
    assert resting(0.7).shows_rotation
    assert resting(0.7).constant_error(SHARES, CONFIG) is not None
    assert resting(0.7, tagged=True).constant_error(SHARES, CONFIG) is None


def test_what_has_a_tag_errs_alike_if_its_percepts_are_by_colour() -> None:
    """They tell no rotation then."""
    assert resting(0.7, tagged=True, turn_std=math.pi).constant_error(SHARES, CONFIG) is not None
