"""The driver of webcams on an OpenCV that misbehaves: no camera, no permission, unplugged, busy, broken pictures."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from agents.cameras import Webcam, webcam
from agents.drivers import make_driver
from dsr import LocalNetwork
from dsr.clock import WALL_CLOCK
from dsr.errors import ConfigError
from dsr.images.blobs import Frame
from dsr.network.keys import Keys
from tests.agents.cameras.conftest import eventually, picture

Make = Callable[..., Webcam]
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="devices are files on Linux only")


class FakeCapture:
    """Stands in for `cv2.VideoCapture`; pictures differ from each other, blue is 10 and red 200."""

    opens = True

    def __init__(self, where: int | str) -> None:
        self.where = where
        self.set_to: dict[int, float] = {}
        self.number = 0
        self.plugged = True
        self.broken: object = None
        """What is given instead of a picture"""
        self.age: float | None = None
        """s, of pictures, as the kernel tells it"""
        self.released = False

    def isOpened(self) -> bool:
        return self.opens

    def set(self, what: int, value: float) -> bool:
        self.set_to[what] = value
        return True

    def get(self, what: int) -> float:
        assert what == cv2.CAP_PROP_POS_MSEC
        return 0.0 if self.age is None else 1e3 * (WALL_CLOCK.monotonic() - self.age)

    def grab(self) -> bool:
        return self.plugged

    def retrieve(self) -> tuple[bool, Any]:
        if isinstance(self.broken, Exception):
            raise self.broken
        if self.broken is not None:
            return self.broken is not False, self.broken
        self.number += 1
        image = picture(self.number)
        image[..., 0], image[..., 2] = 10, 200
        return True, image

    def release(self) -> None:
        self.released = True


@pytest.fixture
def captures(monkeypatch: pytest.MonkeyPatch) -> list[FakeCapture]:
    """All that were opened."""
    made: list[FakeCapture] = []

    def capture(where: int | str) -> FakeCapture:
        made.append(FakeCapture(where))
        return made[-1]

    monkeypatch.setattr(Webcam, "capture", staticmethod(capture))
    return made


@pytest.fixture
def device(tmp_path: Path) -> Path:
    path = tmp_path / "video0"
    path.touch()
    return path


@pytest.fixture
def make(captures: list[FakeCapture], device: Path) -> Iterator[Make]:
    made: list[Webcam] = []

    def driver(**options: object) -> Webcam:
        given = {"device": str(device), "first_pause": 0.01, **options}
        made.append(make_driver("webcam", LocalNetwork().connect("a"), Keys("g"), **given))
        return made[-1]

    yield driver
    for one in made:
        one.close()


def frame_of(camera: Webcam) -> Frame:
    found: list[Frame] = []
    eventually(lambda: found.extend(filter(None, [camera.frame()])) or found)
    return found[0]


@pytest.mark.parametrize(
    "option", [{"fps": np.nan}, {"latency": np.inf}, {"silence": np.nan}, {"silence": 0.0}, {"first_pause": np.nan},
               {"first_pause": np.inf}, {"frozen": np.nan}, {"frozen": -1.0}],
)  # fmt: skip
def test_times_that_cannot_be_waited_are_refused(make: Make, option: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match="expected"):
        make(**option)


def test_pictures_come_in_red_green_blue_with_stamps_of_now(make: Make, captures: list[FakeCapture]) -> None:
    camera = make(fov=90.0)
    frame = frame_of(camera)
    assert frame.arrays["color"].shape == (48, 64, 3) and frame.arrays["color"].dtype == np.uint8
    assert frame.arrays["color"][0, 0, 0] == 200 and frame.arrays["color"][0, 0, 2] == 10
    assert "depth" not in frame.arrays and frame.meta["fx"] == pytest.approx(32.0)
    assert 0.0 <= WALL_CLOCK.now() - frame.stamp < 60.0
    camera.close()
    assert captures[0].released


def test_the_kernels_stamp_is_that_of_the_exposure(make: Make, captures: list[FakeCapture]) -> None:
    camera = make()
    eventually(lambda: captures)
    captures[0].age = 0.25
    ages: list[float] = []

    def is_older() -> bool:
        if (frame := camera.frame()) is not None:
            ages.append(WALL_CLOCK.now() - frame.stamp)
        return bool(ages) and ages[-1] >= 0.2

    eventually(is_older)
    captures[0].age = 1e6  # a clock that is not ours
    eventually(lambda: not is_older())


def test_what_is_wanted_is_asked_for(make: Make, captures: list[FakeCapture]) -> None:
    frame_of(make(width=1280, height=720, fps=15.0))
    assert captures[0].set_to == {
        cv2.CAP_PROP_FRAME_WIDTH: 1280, cv2.CAP_PROP_FRAME_HEIGHT: 720, cv2.CAP_PROP_FPS: 15.0,
    }  # fmt: skip


def test_no_device_is_told_and_waited_for(make: Make, device: Path, captures: list[FakeCapture]) -> None:
    device.unlink()
    camera = make()
    eventually(lambda: "there is no" in camera.trouble)
    assert "it is not plugged in, or has another number" in camera.trouble and captures == []
    device.touch()
    frame_of(camera)
    assert camera.trouble == ""


def test_no_permission_is_told_with_the_remedy(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda *_: False)
    camera = make()
    eventually(lambda: "usermod -aG video" in camera.trouble)
    monkeypatch.undo()


def test_a_camera_that_another_program_uses(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FakeCapture, "opens", False)
    camera = make()
    eventually(lambda: "another program uses it" in camera.trouble)


def test_unplugged_and_plugged_in_again(make: Make, captures: list[FakeCapture], device: Path) -> None:
    camera = make()
    frame_of(camera)
    device.unlink()
    captures[0].plugged = False
    eventually(lambda: "not plugged in" in camera.trouble)
    assert captures[0].released
    device.touch()
    eventually(lambda: camera.frame() is not None and len(captures) == 2)
    assert camera.trouble == "" and camera.counts["lost"] == 1


@pytest.mark.parametrize(
    "broken",
    [False, np.zeros((0, 0, 3), np.uint8), np.zeros((4, 4, 7), np.uint8), np.zeros((4, 4, 3), np.float32),
     "no image", cv2.error("broken JPEG")],
    ids=["not decoded", "empty", "seven channels", "floats", "text", "raised"],
)  # fmt: skip
def test_broken_pictures_are_counted_and_the_next_ones_come(
    make: Make, captures: list[FakeCapture], broken: object
) -> None:
    camera = make()
    frame_of(camera)
    captures[0].broken = broken
    eventually(lambda: camera.counts.get("corrupt", 0) >= 3)
    assert "cannot be used" in camera.trouble
    captures[0].broken = None
    eventually(lambda: camera.trouble == "")


def test_grey_pictures_are_pictures(make: Make, captures: list[FakeCapture]) -> None:
    camera = make()
    eventually(lambda: captures)
    captures[0].broken = np.full((48, 64), 77, np.uint8)
    eventually(lambda: (frame := camera.frame()) is not None and (frame.arrays["color"] == 77).all())


def test_a_device_has_a_number_or_a_path() -> None:
    assert webcam.device_path(2) == Path("/dev/video2")
    assert webcam.device_path("/dev/v4l/by-id/usb-cam") == Path("/dev/v4l/by-id/usb-cam")


@pytest.mark.parametrize(
    "options", [{"width": -1}, {"silence": 0.0}, {"fov": 200.0}, {"calibration": "nowhere.toml"}, {"colour": True}]
)
def test_options_that_make_no_sense_are_refused(make: Make, options: dict[str, object]) -> None:
    with pytest.raises(ConfigError):
        make(**options)
