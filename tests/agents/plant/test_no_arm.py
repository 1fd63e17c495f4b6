"""A world without an arm, seen by a camera on a stand."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from agents.plant.messages import Follow
from agents.plant.reality import Reality
from agents.scenario.format.scenario import CameraSpec, ObjectSpec, RobotSpec, Slide, load_scenario
from dsr.math3d.transforms import Pose

MakeReality = Callable[..., Reality]
MakeCube = Callable[..., ObjectSpec]
NOBODY = RobotSpec(model="none")
STAND = CameraSpec(position=(-0.3, 0.0, 0.6), look_at=(0.35, 0.0, 0.0))


def test_nothing_is_told_of_an_arm_that_is_not_there(make_reality: MakeReality, cube: MakeCube) -> None:
    reality = make_reality(cube(3, 0.3, 0.0), robot=NOBODY)
    reality.obey(Follow((0.0,), ((),)))
    reality.step(0.0)
    assert reality.arm_state(0.0) is None
    truth = reality.truth(0.0)
    assert (truth.robot, truth.held) == ((), None)


def test_the_camera_stands_where_it_should_and_sees(make_reality: MakeReality, cube: MakeCube) -> None:
    reality = make_reality(cube(3, 0.3, 0.0, size=(0.08, 0.08, 0.08), z=0.04), robot=NOBODY, camera=STAND)
    assert reality.camera.name == "fixed" and reality.camera.pose == STAND.pose
    (reading,) = reality.readings(0.0).readings
    seen = STAND.pose @ Pose(reading.pose[:3], reading.pose[3:])
    assert seen.t == pytest.approx((0.3, 0.0, 0.04), abs=0.005)


def test_the_experimenter_moves_things_without_an_arm(
    make_reality: MakeReality, cube: MakeCube, play: Callable[..., None]
) -> None:
    events = [Slide(at=0.0, object="cube_3", by=(0.1, 0.0)), Slide(when="idle()", object="cube_3", by=(0.0, 0.1))]
    reality = make_reality(cube(3, 0.3, 0.0), robot=NOBODY, events=events)
    play(reality, 3.0)
    assert reality.world.pose("cube_3").t[1] > 0.05


def test_a_cube_that_touches_a_thin_wall_is_not_seen_through_it(make_reality: MakeReality) -> None:
    scenario = load_scenario("cups_and_balls")
    cube, large = scenario.object("cube"), scenario.object("large")
    reality = make_reality(cube, large, robot=scenario.robot, camera=scenario.camera, table=scenario.table)
    reality.world.put("large", Pose((0.05, -0.25, 0.075)))
    reality.world.put("cube", Pose((0.05 - 0.062, -0.25, 0.02)))
    reality.readings(0.0)
    assert reality.camera.in_view == ["large"]
