"""The driver of video files, on files that the test writes: whole, cut off, of something else."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from agents.cameras import VideoFile
from agents.drivers import make_driver
from dsr import LocalNetwork
from dsr.clock import WALL_CLOCK
from dsr.errors import ConfigError
from dsr.images.blobs import Frame
from dsr.network.keys import Keys
from tests.agents.cameras.conftest import eventually

Make = Callable[..., VideoFile]
FPS, COUNT, WIDTH, HEIGHT = 25.0, 20, 64, 48


@pytest.fixture
def video(tmp_path: Path) -> Path:
    """A file whose picture k has the red 10 k."""
    path = tmp_path / "filmed.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), FPS, (WIDTH, HEIGHT))
    assert writer.isOpened()
    for number in range(COUNT):
        writer.write(np.full((HEIGHT, WIDTH, 3), (90, 100, 10 * number), np.uint8))
    writer.release()
    return path


@pytest.fixture
def make() -> Iterator[Make]:
    made: list[VideoFile] = []

    def driver(file: Path, **options: object) -> VideoFile:
        made.append(make_driver("video", LocalNetwork().connect("a"), Keys("g"), file=str(file), **options))
        return made[-1]

    yield driver
    for one in made:
        one.close()


def watched(camera: VideoFile, enough: Callable[[list[Frame]], bool]) -> list[Frame]:
    frames: list[Frame] = []
    eventually(lambda: frames.extend(filter(None, [camera.frame()])) or enough(frames))
    return frames


def numbers(frames: list[Frame]) -> list[int]:
    return [round(float(frame.arrays["color"][..., 0].mean()) / 10.0) for frame in frames]


def test_the_film_plays_in_order_at_its_rate_and_ends(make: Make, video: Path) -> None:
    began = WALL_CLOCK.now()
    camera = make(video, loop=False, fov=60.0)
    frames = watched(camera, lambda _: camera.ended)
    frames += [frame for frame in [camera.frame()] if frame is not None]
    seen = numbers(frames)
    assert seen == sorted(set(seen)) and seen[-1] == COUNT - 1
    assert len(seen) + camera.counts.get("passed over", 0) == COUNT
    for frame, number in zip(frames, seen, strict=True):
        assert frame.stamp - frames[0].stamp == pytest.approx((number - seen[0]) / FPS, abs=1e-3)
    assert began <= frames[0].stamp and frames[-1].stamp <= WALL_CLOCK.now()
    assert frames[0].meta["fx"] > 0 and set(frames[0].arrays) == {"color"}
    assert camera.trouble == ""


def test_the_film_begins_again_and_stamps_go_on(make: Make, video: Path) -> None:
    camera = make(video, speed=20.0)
    frames = watched(camera, lambda frames: len(frames) > 2 * COUNT)
    assert all(one.stamp < other.stamp for one, other in itertools.pairwise(frames))
    assert camera.counts.get("lost", 0) == 0


def test_it_starts_where_it_should(make: Make, video: Path) -> None:
    camera = make(video, begin=0.4, loop=False)
    assert numbers(watched(camera, bool))[0] >= 10


def test_a_film_that_was_cut_off_ends_where_it_was(make: Make, video: Path) -> None:
    data = video.read_bytes()
    video.write_bytes(data[: data.index(b"movi") + (len(data) - data.index(b"movi")) // 2])
    camera = make(video, loop=False, speed=20.0)
    seen = numbers(watched(camera, lambda _: camera.ended))
    assert seen and seen[-1] < COUNT - 1


@pytest.mark.parametrize("content", [b"", b"\x00" * 5000, b"\x00\x00\x00\x18ftypmp42" + b"x" * 100])
def test_what_is_no_video_is_refused(
    make: Make, tmp_path: Path, content: bytes, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.mp4").write_bytes(content)
    with pytest.raises(ConfigError, match=r"a\.mp4: no video"):
        make(tmp_path / "a.mp4")
    assert capfd.readouterr() == ("", "")


def test_wrong_files_and_options_are_refused(make: Make, video: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="there is no such file"):
        make(tmp_path / "nowhere.mp4")
    for options in ({"speed": 0.0}, {"begin": -1.0}, {"begin": 1e9}, {"speed": float("nan")}):
        with pytest.raises(ConfigError):
            make(video, **options)
