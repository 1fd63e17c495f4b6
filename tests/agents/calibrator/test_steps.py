"""Small bumps, of which beliefs take no notice: found by what a camera saw just before."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from dsr.math3d.transforms import Pose
from dsr.vocabulary.calibration import ADOPTED, CALIBRATION, CONFIRMED, IN_DOUBT, PROVISIONAL, STEADY
from tests.agents.calibrator.scenes import DOWN, Stage

SMALL = Pose.from_rotvec((0.002, 0.0, 0.0), (0.008, 0.0, 0.005))


@pytest.fixture
def stage() -> Iterator[Stage]:
    """Has looked for a while with a camera that is where it is believed to be."""
    stage = Stage()
    stage.memory.add_edge("world", "camera", "RT", pose=DOWN)
    stage.look(4.0)
    yield stage
    stage.lockstep.close()


def mount(stage: Stage) -> str:
    return str(stage.memory.node("camera").get("mount", STEADY))


def follow(stage: Stage, seconds: float) -> None:
    """Look, with beliefs that follow what is seen."""
    for _ in range(round(seconds * 10)):
        stage.look(0.1)
        for name in stage.objects:
            seen = stage.memory.transform("world", "camera") @ stage.memory.edge("camera", name, "RT")["pose"]
            believed = stage.memory.edge("world", name, "Virtual_RT")["pose"]
            place = np.add(believed.t, 0.1 * np.subtract(seen.t, believed.t)).tolist()
            stage.memory.add_edge("world", name, "Virtual_RT", pose=Pose(tuple(place), believed.q))


def test_a_small_bump_is_found_out_though_nothing_is_surprising(stage: Stage) -> None:
    stage.parent_from_camera = DOWN @ SMALL
    follow(stage, 1.2)
    assert mount(stage) == IN_DOUBT
    follow(stage, 1.5)
    (request,) = stage.memory.nodes(CALIBRATION)
    assert request["status"] == ADOPTED and mount(stage) in (STEADY, PROVISIONAL)
    assert stage.error[0] < 0.0015 and stage.error[1] < 0.003


def test_beliefs_that_went_astray_before_are_led_back(stage: Stage) -> None:
    stage.parent_from_camera = DOWN @ Pose.from_rotvec((0.0, 0.0, 0.0), (0.018, 0.0, 0.0))
    stage.look(0.8)
    astray = Pose((0.0, 0.01, 0.0)) @ stage.memory.edge("world", "cube_1", "Virtual_RT")["pose"]
    stage.memory.add_edge("world", "cube_1", "Virtual_RT", pose=astray)
    stage.look(1.6)
    assert mount(stage) == CONFIRMED and stage.error[0] < 0.0015
    stage.look(3.5)
    assert mount(stage) == STEADY


def test_noise_and_a_cube_that_was_pushed_raise_no_doubt(stage: Stage) -> None:
    stage.objects["cube_2"] = Pose((0.008, 0.0, 0.0)) @ stage.objects["cube_2"]
    stage.look(3.0)
    assert not stage.memory.nodes(CALIBRATION)


def test_a_tower_that_was_pushed_is_no_camera_that_moved(stage: Stage) -> None:
    for upper, lower in (("cube_4", "cube_3"), ("cube_3", "cube_2")):
        stage.memory.add_edge(upper, lower, "on")
    for name in ("cube_2", "cube_3", "cube_4"):
        stage.objects[name] = Pose((0.006, 0.003, 0.0)) @ stage.objects[name]
    stage.look(3.0)
    assert not stage.memory.nodes(CALIBRATION)


def test_what_is_displaced_far_is_left_to_those_whom_it_surprises(stage: Stage) -> None:
    stage.objects = {name: Pose((0.05, 0.03, 0.0)) @ pose for name, pose in stage.objects.items()}
    stage.look(3.0)
    assert not stage.memory.nodes(CALIBRATION)
