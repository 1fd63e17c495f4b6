"""The driver of a RealSense on recordings that the real library makes and plays; no camera is needed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents.cameras import RealSense
from agents.cameras.realsense import load_library
from agents.cameras.realsense_lens import intrinsics_of, pose_of
from agents.drivers import make_driver
from benchmarks import recorded_realsense as recorded
from benchmarks.depth_alignment import aligned_both_ways
from dsr import LocalNetwork
from dsr.clock import WALL_CLOCK
from dsr.config.extras import MissingExtraError
from dsr.errors import ConfigError
from dsr.images.blobs import Frame
from dsr.network.keys import Keys
from tests.agents.cameras.conftest import eventually

try:
    rs = load_library()
except MissingExtraError as error:
    pytest.skip(str(error), allow_module_level=True)

Make = Callable[..., RealSense]


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("realsense") / "seen.db3"
    recorded.record(rs, path)
    return path


@pytest.fixture
def make() -> Iterator[Make]:
    made: list[RealSense] = []

    def driver(**options: object) -> RealSense:
        made.append(make_driver("realsense", LocalNetwork().connect("a"), Keys("g"), first_pause=0.01, **options))
        return made[-1]

    yield driver
    for one in made:
        one.close()


def watched(camera: RealSense, enough: Callable[[list[Frame]], bool]) -> list[Frame]:
    frames: list[Frame] = []
    eventually(lambda: frames.extend(filter(None, [camera.frame()])) or enough(frames))
    return frames


def number_of(frame: Frame) -> int:
    return int(frame.arrays["color"][0, 0, 0]) // 10


def test_colour_comes_with_the_depth_of_its_moment_in_its_image(make: Make, recording: Path) -> None:
    began = WALL_CLOCK.now()
    camera = make(file=str(recording), loop=False)
    frames = watched(camera, lambda _: camera.ended)
    numbers = [number_of(frame) for frame in frames]
    assert numbers == sorted(set(numbers)) and numbers[-1] == recorded.COUNT - 1
    assert len(numbers) + camera.counts.get("passed over", 0) + camera.counts.get("unpaired", 0) >= recorded.COUNT - 1
    for frame, number in zip(frames, numbers, strict=True):
        assert np.array_equal(frame.arrays["color"], recorded.color(number))
        depth = frame.arrays["depth"]
        assert depth.shape == (recorded.HEIGHT, recorded.WIDTH) and depth.dtype == np.float32
        assert depth[120, 160] == pytest.approx(0.8 + 1e-3 * number + recorded.BESIDE[2], abs=1e-5)
        assert np.median(depth) == pytest.approx(2.0 + recorded.BESIDE[2], abs=1e-5)
    spans = np.diff([frame.stamp for frame in frames]) / np.diff(numbers)
    assert spans == pytest.approx(1.0 / recorded.FPS, abs=1e-4)
    assert began <= frames[0].stamp and frames[-1].stamp <= WALL_CLOCK.now()
    assert camera.trouble == ""


def test_intrinsics_with_their_distortion_are_in_each_frame(make: Make, recording: Path) -> None:
    (frame,) = watched(make(file=str(recording)), bool)
    assert {key: frame.meta[key] for key in ("fx", "fy", "cx", "cy")} == {
        "fx": 280,
        "fy": 280,
        "cx": 159.5,
        "cy": 119.5,
    }
    assert frame.meta["distortion_model"] == "plumb_bob"
    assert [frame.meta[f"d{k}"] for k in range(1, 6)] == pytest.approx(recorded.COEFFICIENTS)


def test_depth_is_aligned_as_the_library_aligns_it(recording: Path) -> None:
    """It leaves out pixels that the image's edge cuts, and ones between those that lens and turn draw apart."""
    found = aligned_both_ways(rs, recording)
    assert found.both > 0.999 and found.known_to_them > 0.98 and found.same > 0.99
    assert (found.ours > 0).mean() > 0.8


def test_without_depth_colour_goes_alone(make: Make, recording: Path) -> None:
    frames = watched(make(file=str(recording), depth=False), lambda frames: len(frames) > 3)
    assert all(set(frame.arrays) == {"color"} for frame in frames)


def test_a_recording_begins_again_and_its_stamps_go_on(make: Make, recording: Path) -> None:
    camera = make(file=str(recording))
    frames = watched(camera, lambda frames: sum(np.diff([number_of(frame) for frame in frames]) < 0) >= 2)
    stamps = [frame.stamp for frame in frames]
    assert stamps == sorted(stamps) and camera.counts.get("lost", 0) == 0
    assert all(abs(frame.arrays["depth"][120, 160] - 0.801 - 1e-3 * number_of(frame)) < 1e-4 for frame in frames)


def test_a_file_of_something_else_is_told(make: Make, tmp_path: Path) -> None:
    (tmp_path / "a.db3").write_bytes(b"nothing of the kind")
    camera = make(file=str(tmp_path / "a.db3"))
    eventually(lambda: "no recording of a RealSense" in camera.trouble)
    with pytest.raises(ConfigError, match="there is no such file"):
        make(file=str(tmp_path / "b.db3"))


def test_no_camera_is_told_and_waited_for(make: Make) -> None:
    if rs.context().query_devices():
        pytest.skip("a RealSense is connected")
    camera = make()
    eventually(lambda: camera.trouble == "no RealSense is connected")
    eventually(lambda: camera.counts == {"lost": 1})


@pytest.mark.parametrize("options", [{"width": 0}, {"fps": -1}, {"silence": 0.0}])
def test_options_that_no_camera_has(make: Make, options: dict[str, Any]) -> None:
    with pytest.raises(ConfigError):
        make(**options)


def test_a_pose_is_that_of_the_library() -> None:
    told = recorded.extrinsics(rs)
    point = [0.3, -0.2, 1.5]
    assert pose_of(told).apply(point) == pytest.approx(rs.rs2_transform_point_to_point(told, point), abs=1e-6)


@pytest.mark.parametrize(
    ("name", "coefficients", "most"),
    [
        ("none", [0.1, 0.1, 0.0, 0.0, 0.0], 0.0),
        ("brown_conrady", [0.1, -0.2, 0.001, -0.002, 0.03], 0.0),
        ("kannala_brandt4", [0.02, -0.01, 0.003, -0.001, 0.0], 0.0),
        ("inverse_brown_conrady", [-0.055, 0.066, -0.0008, 0.0005, -0.02], 0.1),
        ("modified_brown_conrady", [0.1, -0.2, 0.001, -0.002, 0.03], 0.05),
    ],
)
def test_lenses_show_points_where_the_library_does(name: str, coefficients: list[float], most: float) -> None:
    told = recorded.intrinsics(rs, 300.0, getattr(rs.distortion, name), coefficients)
    found, off = intrinsics_of(rs, told)
    assert off <= most
    for point in ([0.1, -0.2, 1.0], [0.4, 0.3, 1.0], [-0.45, 0.0, 1.0], [0.0, 0.0, 2.0]):
        if name == "inverse_brown_conrady":
            pixel = found.project(np.array(point))
            back = rs.rs2_deproject_pixel_to_point(told, pixel.tolist(), point[2])
            assert back == pytest.approx(point, abs=(most + 0.01) / 300.0 * point[2])
        else:
            there = rs.rs2_project_point_to_pixel(told, point)
            assert found.project(np.array(point)) == pytest.approx(there, abs=most + 0.01)
