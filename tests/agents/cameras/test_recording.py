"""The driver of recorded cameras, on recordings that the recorder makes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from agents.cameras import RecordedCamera
from agents.drivers import make_driver
from agents.recorder import RecordingError
from dsr import Frame, LocalNetwork
from dsr.clock import WALL_CLOCK
from dsr.errors import ConfigError
from dsr.network.keys import Keys
from tests.agents.cameras.conftest import eventually
from tests.agents.replay.conftest import STEP, Studio

Make = Callable[..., RecordedCamera]
COUNT = 12
META: dict[str, float | int | str] = {"fx": 60.0, "fy": 60.0, "cx": 31.5, "cy": 23.5, "distortion_model": "plumb_bob"}


def shot(number: int, stamp: float) -> Frame:
    color = np.full((48, 64, 3), 20 * number, np.uint8)
    return Frame(stamp, {"color": color, "depth": np.full((48, 64), 1.0 + 0.1 * number, np.float32)}, META)


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """A camera at 20 Hz, another one that shows nothing of use, and detections beside."""
    studio = Studio(tmp_path / "run")
    for number in range(COUNT):
        now = studio.clock.now()
        studio.memory.put_frame("camera_top", shot(number, now))
        studio.memory.put_frame("camera_top/detections", Frame(now, {"ids": np.zeros(1, np.int32)}, {}))
        studio.memory.put_frame("camera_dark", Frame(now, {"depth": np.ones((4, 4), np.float32)}, {}))
        studio.run(STEP)
    return studio.finish()


@pytest.fixture
def make() -> Iterator[Make]:
    made: list[RecordedCamera] = []

    def driver(recording: Path, **options: object) -> RecordedCamera:
        made.append(
            make_driver("recording", LocalNetwork().connect("a"), Keys("g"), recording=str(recording), **options)
        )
        return made[-1]

    yield driver
    for one in made:
        one.close()


def watched(camera: RecordedCamera, enough: Callable[[list[Frame]], bool]) -> list[Frame]:
    frames: list[Frame] = []
    eventually(lambda: frames.extend(filter(None, [camera.frame()])) or enough(frames))
    return frames


def numbers(frames: list[Frame]) -> list[int]:
    return [round(float(frame.arrays["color"].mean()) / 20.0) for frame in frames]


def test_a_recorded_camera_is_seen_as_if_it_were_now(make: Make, recording: Path) -> None:
    began = WALL_CLOCK.now()
    camera = make(recording, camera="camera_top", loop=False)
    frames = watched(camera, lambda _: camera.ended)
    seen = numbers(frames)
    assert seen == sorted(set(seen)) and seen[-1] == COUNT - 1
    assert len(seen) + camera.counts.get("passed over", 0) == COUNT
    for frame, number in zip(frames, seen, strict=True):
        assert frame.stamp - frames[0].stamp == pytest.approx(STEP * (number - seen[0]), abs=1e-6)
        assert frame.arrays["depth"] == pytest.approx(1.0 + 0.1 * number, abs=1e-4)
        assert frame.meta["fx"] == 60.0 and frame.meta["distortion_model"] == "plumb_bob"
    assert began <= frames[0].stamp and frames[-1].stamp <= WALL_CLOCK.now() and camera.trouble == ""


def test_it_begins_where_it_should_runs_faster_and_again(make: Make, recording: Path) -> None:
    camera = make(recording, camera="camera_top", begin=0.3, speed=4.0)
    frames = watched(camera, lambda frames: sum(np.diff(numbers(frames)) < 0) >= 2)
    stamps = [frame.stamp for frame in frames]
    assert min(numbers(frames)) >= 5 and stamps == sorted(stamps)
    steps = {number for number in np.diff(numbers(frames)) if number > 0}
    spans = [b - a for a, b, n in zip(stamps, stamps[1:], np.diff(numbers(frames)), strict=False) if n == 1]
    assert 1 in steps and spans == pytest.approx([STEP / 4.0] * len(spans), abs=1e-6)


def test_what_is_no_picture_is_counted(make: Make, recording: Path) -> None:
    camera = make(recording, camera="camera_dark", loop=False)
    eventually(lambda: camera.ended)
    assert camera.counts["corrupt"] == COUNT and camera.frame() is None


def test_wrong_recordings_cameras_and_options_are_refused(make: Make, recording: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="which `camera`\\? There are: camera_dark, camera_top"):
        make(recording)
    with pytest.raises(ConfigError, match="no camera 'camera_tip'; did you mean 'camera_top'"):
        make(recording, camera="camera_tip")
    with pytest.raises(RecordingError):
        make(tmp_path)
    (tmp_path / "a.bag").write_bytes(b"#ROSBAG V2.0\n")
    with pytest.raises(ConfigError, match="use the driver `bag`"):
        make(tmp_path / "a.bag")
    for options in ({"speed": 0.0}, {"begin": -1.0}, {"begin": 100.0}):
        with pytest.raises(ConfigError):
            make(recording, camera="camera_top", **options)


def test_a_cut_recording_is_played_as_far_as_it_goes(make: Make, recording: Path) -> None:
    (file,) = recording.glob("*.mcap")
    data = file.read_bytes()
    file.write_bytes(data[: 2 * len(data) // 3])
    camera = make(recording, camera="camera_top", loop=False)
    seen = numbers(watched(camera, lambda _: camera.ended))
    assert seen and seen == sorted(set(seen))
