"""The sensor that tells true poses with noise in place of images."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from agents.plant.reality import Reality
from agents.scenario.format.scenario import ObjectSpec, SensorSpec
from dsr.math3d.transforms import Pose

MakeReality = Callable[..., Reality]
MakeCube = Callable[..., ObjectSpec]


def seen(reality: Reality) -> list[int]:
    return sorted(reading.marker_id for reading in reality.readings(0.0).readings)


def test_only_the_top_of_a_tower_is_seen(make_reality: MakeReality, cube: MakeCube) -> None:
    reality = make_reality(cube(3, 0.3, 0.0), cube(4, 0.3, 0.0, 0.06), cube(5, 0.4, 0.1))
    assert seen(reality) == [4, 5]


def test_what_is_outside_the_image_is_not_seen(make_reality: MakeReality, cube: MakeCube) -> None:
    assert seen(make_reality(cube(3, 0.3, 0.5), cube(4, 0.3, 0.0))) == [4]


def test_what_lies_below_a_box_or_has_no_tag_is_not_seen(make_reality: MakeReality, cube: MakeCube) -> None:
    lid = ObjectSpec(name="lid", type="box", size=(0.2, 0.2, 0.01), position=(0.3, 0.0, 0.045))
    assert seen(make_reality(cube(3, 0.3, 0.05), cube(4, 0.3, -0.05), lid, cube(5, 0.5, 0.0))) == [5]


def test_the_arm_hides_what_is_below_it(make_reality: MakeReality, cube: MakeCube) -> None:
    from agents.scenario.format.scenario import RobotSpec

    over_the_cube = RobotSpec(start=(-0.4483, 0.2902, 3.3772, -2.2089, -0.1101, -0.653, -0.1347))
    assert seen(make_reality(cube(3, 0.3, 0.08), cube(4, 0.45, -0.1), robot=over_the_cube)) == [4]


def test_a_tag_on_its_side_is_not_seen(make_reality: MakeReality, cube: MakeCube) -> None:
    reality = make_reality(cube(3, 0.35, 0.0))
    reality.world.put("cube_3", Pose.from_rotvec((0.35, 0.0, 0.02), (math.pi / 2, 0.0, 0.0)))
    assert seen(reality) == []


def test_covered_and_removed_are_not_seen(make_reality: MakeReality, cube: MakeCube) -> None:
    reality = make_reality(cube(3, 0.35, 0.0), cube(4, 0.35, 0.1))
    reality.world.remove("cube_3")
    assert seen(reality) == [4]
    reality.camera.covers += 1
    assert seen(reality) == []


def test_errors_have_the_spread_they_claim(make_reality: MakeReality, cube: MakeCube) -> None:
    reality = make_reality(cube(3, 0.35, 0.1))
    true = reality.camera.pose.inverse() @ reality.world.pose("cube_3")
    samples = [reality.readings(0.0).readings[0] for _ in range(400)]
    errors = [true.inverse() @ Pose(sample.pose[:3], sample.pose[3:]) for sample in samples]
    translation = np.array([error.t for error in errors])
    rotation = np.array([error.rotvec for error in errors])
    assert translation.std(axis=0) == pytest.approx(samples[0].sigma_translation, rel=0.2)
    assert rotation.std(axis=0) == pytest.approx(samples[0].sigma_rotation, rel=0.2)
    assert np.median(np.linalg.norm(translation, axis=1)) == pytest.approx(0.0011, abs=0.0002)


@pytest.mark.parametrize("bias", [0.02, -0.02])
def test_bias_moves_readings_towards_the_camera(make_reality: MakeReality, cube: MakeCube, bias: float) -> None:
    reality = make_reality(cube(3, 0.35, 0.2), sensor=SensorSpec(depth_bias=(bias, bias)))
    true = (reality.camera.pose.inverse() @ reality.world.pose("cube_3")).translation
    measured = np.mean([reality.readings(0.0).readings[0].pose[:3] for _ in range(50)], axis=0)
    assert true - measured == pytest.approx(bias * true / np.linalg.norm(true), abs=1e-3)
