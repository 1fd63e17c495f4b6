"""Frames and tag readings: what is seen in good ones, and that bad ones are refused."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
import pytest

from agents.drivers import TagReading, TagReadings
from agents.scene_estimator.pose import NoiseModel
from agents.scene_estimator.sighting import FrameSource, read_sensor
from dsr import Frame, Pose
from dsr.errors import WireError

from .conftest import MARKER, SMALL, covariance

CUBE = Pose((0.02, -0.01, 0.3), (1.0, 0.0, 0.0, 0.0))
READING = TagReading(3, (0.0, 0.3, 0.4, 0.0, 0.0, 0.0, 1.0), 0.001, 0.002)


@pytest.fixture(scope="module")
def frame() -> Frame:
    return SMALL.frame({MARKER: CUBE}, np.random.default_rng(0), stamp=12.5)


def reader(*size: float) -> FrameSource:
    x, y, z = size or (0.04, 0.04, 0.04)
    return FrameSource(lambda _: (x, y, z), 0.8, NoiseModel())


def test_a_cube_is_seen_where_and_when_it_was(frame: Frame) -> None:
    (sighting,), outlines = reader().read(frame)
    assert sighting.marker_id == MARKER
    assert sighting.pose.stamp == 12.5
    assert sighting.pose.distance(CUBE)[0] < 0.006
    assert outlines.ids.tolist() == [MARKER]
    assert outlines.corners.shape == (1, 4, 2)
    assert outlines.corners[0].mean(axis=0) == pytest.approx(
        SMALL.intrinsics.project(CUBE.apply([[0, 0, 0.02]]))[0], abs=1
    )


def test_the_tag_is_on_the_shorter_side_of_a_face_and_the_centre_half_a_height_below(frame: Frame) -> None:
    cube = reader().read(frame)[0][0].pose
    box = reader(0.04, 0.09, 0.10).read(frame)[0][0].pose
    assert (cube.inverse() @ box).translation == pytest.approx([0.0, 0.0, -0.03])


def test_an_empty_frame_shows_nothing(frame: Frame) -> None:
    empty = msgspec.structs.replace(frame, arrays={"color": np.full((240, 320, 3), 90, np.uint8)})
    sightings, outlines = reader().read(empty)
    assert sightings == []
    assert outlines.ids.shape == (0,)
    assert outlines.corners.shape == (0, 4, 2)


@pytest.mark.parametrize(
    "arrays",
    [
        {"color": None},
        {"color": np.zeros((240, 320), np.uint8)},
        {"color": np.zeros((240, 320, 4), np.uint8)},
        {"color": np.zeros((240, 320, 3), np.float32)},
        {"color": np.zeros((0, 320, 3), np.uint8)},
        {"depth": np.zeros((120, 160), np.float32)},
        {"depth": np.zeros((240, 320), np.uint16)},
        {"depth": np.zeros((240, 320, 1), np.float32)},
        {"depth": np.full((240, 320), 812.0, np.float32)},
        {"depth": np.full((240, 320), 3e38, np.float32)},
    ],
)
def test_images_of_another_kind_are_refused(frame: Frame, arrays: dict[str, Any]) -> None:
    merged = {name: array for name, array in {**frame.arrays, **arrays}.items() if array is not None}
    with pytest.raises(WireError, match=r"frame at 12\.5"):
        reader().read(msgspec.structs.replace(frame, arrays=merged))


def test_depth_that_is_endless_where_nothing_is_seen_is_in_metres_all_the_same(frame: Frame) -> None:
    depth = frame.arrays["depth"].copy()
    depth[::2] = np.inf
    depth[1::4] = np.inf
    assert reader().read(msgspec.structs.replace(frame, arrays={**frame.arrays, "depth": depth}))[0]


@pytest.mark.parametrize("name", ["fx", "fy", "cx", "cy"])
@pytest.mark.parametrize("value", [None, "wide", np.nan, np.inf, -1e300, 1e300, 1e9])
def test_intrinsics_of_no_camera_are_refused(frame: Frame, name: str, value: Any) -> None:
    meta = {key: number for key, number in {**frame.meta, name: value}.items() if number is not None}
    with pytest.raises(WireError, match=r"frame at 12\.5: intrinsics"):
        reader().read(msgspec.structs.replace(frame, meta=meta))


@pytest.mark.parametrize("focal", [1.0, 1e5])
@pytest.mark.parametrize("centre", [-1e5, 0.0, 1e5])
@pytest.mark.parametrize("size", [1e-6, 1e6])
def test_odd_intrinsics_and_sizes_do_no_harm(frame: Frame, focal: float, centre: float, size: float) -> None:
    odd = msgspec.structs.replace(frame, meta={"fx": focal, "fy": 1.0, "cx": centre, "cy": 0.0})
    for arrays in (frame.arrays, {"color": frame.arrays["color"]}):
        sightings, _ = reader(size, size, size).read(msgspec.structs.replace(odd, arrays=arrays))
        assert len(sightings) <= 1


def test_readings_become_sightings_uncertain_along_the_ray() -> None:
    (sighting,) = read_sensor(TagReadings(7.0, [READING]), NoiseModel(depth_bias_std=0.01))
    assert sighting.marker_id == 3
    assert sighting.pose.stamp == 7.0
    assert sighting.pose.translation == pytest.approx([0.0, 0.3, 0.4])
    expected = 0.001**2 * np.eye(3) + 0.01**2 * np.outer([0.0, 0.6, 0.8], [0.0, 0.6, 0.8])
    assert covariance(sighting.pose)[:3, :3] == pytest.approx(expected)
    assert covariance(sighting.pose)[3:, 3:] == pytest.approx(0.002**2 * np.eye(3))


@pytest.mark.parametrize(
    "wrong",
    [
        {"marker_id": -1},
        {"marker_id": 587},
        {"pose": (0.0,) * 7},
        {"pose": (0.0, 0.0, np.nan, 0.0, 0.0, 0.0, 1.0)},
        {"pose": (0.0, 0.0, 1.0)},
        {"sigma_translation": np.nan},
        {"sigma_rotation": np.inf},
    ],
)
def test_readings_that_cannot_be_are_refused(wrong: dict[str, Any]) -> None:
    readings = TagReadings(7.0, [READING, msgspec.structs.replace(READING, **wrong)])
    with pytest.raises(WireError, match=r"tag readings at 7\.0"):
        read_sensor(readings, NoiseModel())
