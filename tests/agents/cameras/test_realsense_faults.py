"""The driver of a RealSense on a library that misbehaves: stands in for pyrealsense2, which needs not be there."""

from __future__ import annotations

import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from agents.cameras import RealSense, realsense
from agents.drivers import camera_entry, make_driver
from dsr import LocalNetwork
from dsr.clock import WALL_CLOCK
from dsr.config.extras import MissingExtraError
from dsr.images.blobs import Frame
from dsr.network.keys import Keys
from tests.agents.cameras.conftest import eventually

Make = Callable[..., RealSense]
HEIGHT, WIDTH = 12, 16


class Shot:
    """A frame of one stream."""

    def __init__(self, pixels: np.ndarray, format: str, number: int, stamp: float, domain: str) -> None:
        self._pixels, self._format, self._number, self._stamp, self._domain = pixels, format, number, stamp, domain

    def get_data(self) -> np.ndarray:
        return self._pixels

    def get_frame_number(self) -> int:
        return self._number

    def get_timestamp(self) -> float:
        return 1e3 * self._stamp

    def get_frame_timestamp_domain(self) -> str:
        return self._domain

    def get_profile(self) -> Any:
        return SimpleNamespace(format=lambda: self._format)


class Library:
    """A camera whose sets of frames the test gives; the names are those of pyrealsense2."""

    stream = SimpleNamespace(color="color", depth="depth")
    format = SimpleNamespace(rgb8="rgb8", bgr8="bgr8", z16="z16")
    distortion = SimpleNamespace(none="none")
    timestamp_domain = SimpleNamespace(global_time="global", system_time="system", hardware_clock="hardware")
    camera_info = SimpleNamespace(serial_number="serial")

    def __init__(self) -> None:
        self.serials = ["111"]
        self.sets: deque[Any] = deque()
        self.fails = ""
        self.started = self.stopped = 0
        self.asked: dict[str, Any] = {}

    def context(self) -> Any:
        devices = [SimpleNamespace(supports=lambda _: True, get_info=lambda _, s=s: s) for s in self.serials]
        return SimpleNamespace(query_devices=lambda: devices)

    def config(self) -> Any:
        return SimpleNamespace(
            enable_device=lambda serial: self.asked.update(serial=serial),
            enable_stream=lambda kind, *rest: self.asked.update({kind: rest}),
        )

    def pipeline(self) -> Any:
        return SimpleNamespace(start=self._start, stop=self._stop, try_wait_for_frames=self._wait)

    def _start(self, config: Any) -> Any:
        if self.fails:
            raise RuntimeError(self.fails)
        self.started += 1
        lens = SimpleNamespace(
            fx=20.0, fy=20.0, ppx=7.5, ppy=5.5, width=WIDTH, height=HEIGHT, model="none", coeffs=[0.0] * 5
        )
        unmoved = SimpleNamespace(rotation=np.eye(3).ravel(), translation=[0.0] * 3)
        video = SimpleNamespace(get_intrinsics=lambda: lens, get_extrinsics_to=lambda _: unmoved)
        sensor = SimpleNamespace(get_depth_scale=lambda: 1e-3)
        return SimpleNamespace(
            get_device=lambda: SimpleNamespace(first_depth_sensor=lambda: sensor),
            get_stream=lambda kind: SimpleNamespace(as_video_stream_profile=lambda: video),
        )

    def _stop(self) -> None:
        self.stopped += 1

    def _wait(self, milliseconds: int) -> tuple[bool, Any]:
        if not self.sets:
            WALL_CLOCK.wait(NEVER, 0.002)
            return False, None
        step = self.sets.popleft()
        if isinstance(step, Exception):
            raise step
        color, depth = step
        return True, SimpleNamespace(get_color_frame=lambda: color, get_depth_frame=lambda: depth)


NEVER = threading.Event()


def color(number: int, stamp: float, *, domain: str = "hardware", format: str = "rgb8", shape: Any = None) -> Shot:
    pixels = np.full(shape or (HEIGHT, WIDTH, 3), 100 + number, np.uint8)
    pixels[0, 0] = (1, 2, 3)[: pixels.shape[-1]] if pixels.ndim == 3 else 1
    return Shot(pixels, format, number, stamp, domain)


def depth(number: int, stamp: float, pixels: np.ndarray | None = None) -> Shot:
    made = np.full((HEIGHT, WIDTH), 1000 + number, np.uint16) if pixels is None else pixels
    return Shot(made, "z16", number, stamp, "hardware")


@pytest.fixture
def library(monkeypatch: pytest.MonkeyPatch) -> Library:
    made = Library()
    monkeypatch.setattr(realsense, "load_library", lambda: made)
    return made


@pytest.fixture
def make(library: Library) -> Iterator[Make]:
    made: list[RealSense] = []

    def driver(**options: object) -> RealSense:
        made.append(make_driver("realsense", LocalNetwork().connect("a"), Keys("g"), first_pause=0.01, **options))
        return made[-1]

    yield driver
    for one in made:
        one.close()


def next_frame(camera: RealSense) -> Frame:
    found: list[Frame] = []
    eventually(lambda: found.extend(filter(None, [camera.frame()])) or found)
    return found[0]


def test_the_wanted_streams_of_the_wanted_camera_are_asked_for(make: Make, library: Library) -> None:
    library.serials = ["111", "222"]
    make(serial="222", width=1280, height=720, fps=15)
    eventually(lambda: library.started)
    assert library.asked == {"serial": "222", "color": (1280, 720, "rgb8", 15), "depth": ("z16", 15)}


def test_no_camera_another_one_and_no_permission_are_told(make: Make, library: Library) -> None:
    library.serials = []
    camera = make(serial="222")
    eventually(lambda: camera.trouble == "no RealSense is connected")
    library.serials = ["111"]
    eventually(lambda: camera.trouble == "no RealSense 222 is connected; there are: 111")
    library.serials, library.fails = ["222"], "failed to open usb interface: 0, error: RS2_USB_STATUS_ACCESS"
    eventually(lambda: "no permission for the camera" in camera.trouble and "udev rules" in camera.trouble)
    library.fails = "Couldn't resolve requests"
    eventually(lambda: camera.trouble == "Couldn't resolve requests")
    library.fails = ""
    library.sets.append((color(1, 1.0), depth(1, 1.0)))
    assert next_frame(camera).arrays["depth"][5, 5] == np.float32(1.001)
    assert camera.trouble == ""


@pytest.mark.parametrize("error", [RuntimeError("device disconnected"), None], ids=["raised", "silent"])
def test_unplugged_and_plugged_in_again(make: Make, library: Library, error: Exception | None) -> None:
    library.sets.append((color(1, 1.0), depth(1, 1.0)))
    camera = make(silence=0.2)
    next_frame(camera)
    if error is not None:
        library.sets.append(error)
    eventually(lambda: library.stopped >= 1)
    assert camera.trouble in ("device disconnected", "no usable picture for 0.2 s")
    eventually(lambda: library.started >= 2)
    library.sets.append((color(2, 2.0), depth(2, 2.0)))
    next_frame(camera)
    assert camera.counts["lost"] >= 1


def test_sets_that_mix_moments_are_paired_by_stamps(make: Make, library: Library) -> None:
    period = 1.0 / 30.0
    for k in range(1, 9):
        library.sets.append((color(k, k * period), depth(k - 1, (k - 1) * period + 0.004)))
        library.sets.append((color(k, k * period), depth(k, k * period + 0.004)))
    camera = make()
    eventually(lambda: not library.sets and camera.counts.get("passed over", 0) >= 7)
    frame = next_frame(camera)
    assert frame.arrays["color"][5, 5, 0] == 108 and frame.arrays["depth"][5, 5] == np.float32(1.008)
    assert camera.counts.get("unpaired", 0) <= 1


def test_colour_without_its_depth_is_counted(make: Make, library: Library) -> None:
    for k in range(1, 12):
        library.sets.append((color(k, k / 30.0), depth(k, k / 30.0) if k % 3 else None))
    camera = make()
    eventually(lambda: not library.sets and camera.counts.get("unpaired", 0) >= 3)


@pytest.mark.parametrize(
    ("shot", "said"),
    [
        ((color(2, 2.0, shape=(6, 8, 3)), depth(2, 2.0)), "colour (6, 8, 3)"),
        ((color(2, 2.0, format="yuyv"), depth(2, 2.0)), "yuyv"),
        ((color(2, 2.0, shape=(HEIGHT, WIDTH)), depth(2, 2.0)), "colour (12, 16)"),
        ((color(2, 2.0), depth(2, 2.0, np.ones((6, 8), np.uint16))), "a depth image of (6, 8)"),
        ((color(2, 2.0), depth(2, 2.0, np.ones((HEIGHT, WIDTH), np.float32))), "float32"),
    ],
)
def test_pictures_that_make_no_sense_are_counted(make: Make, library: Library, shot: Any, said: str) -> None:
    library.sets.append(shot)
    camera = make()
    eventually(lambda: camera.counts.get("corrupt") == 1)
    assert said in camera.trouble and camera.counts["corrupt"] == 1
    library.sets.append((color(3, 3.0), depth(3, 3.0)))
    next_frame(camera)
    assert camera.trouble == ""


def test_blue_first_is_turned_round(make: Make, library: Library) -> None:
    library.sets.append((color(1, 1.0, format="bgr8"), depth(1, 1.0)))
    assert next_frame(make()).arrays["color"][0, 0].tolist() == [3, 2, 1]


@pytest.mark.parametrize("domain", ["global", "system", "hardware"])
def test_stamps_are_on_our_clock(make: Make, library: Library, domain: str) -> None:
    told = round(WALL_CLOCK.now() - 0.2, 3) if domain != "hardware" else 77.0  # the library counts in ms
    library.sets.append((color(1, told, domain=domain), depth(1, told)))
    stamp = next_frame(make()).stamp
    assert stamp == told if domain != "hardware" else abs(WALL_CLOCK.now() - stamp) < 60.0


def test_a_library_that_is_not_there_or_cannot_be_loaded_is_told(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "pyrealsense2", None)
    with pytest.raises(MissingExtraError, match="driver realsense: the library 'pyrealsense2' is not installed"):
        realsense.load_library()
    (absent,) = realsense.what_is_missing()
    assert absent.endswith("pip install 'dsr-memory[realsense]'")
    monkeypatch.delitem(sys.modules, "pyrealsense2")
    (tmp_path / "pyrealsense2.py").write_text("raise ImportError('libusb-1.0.so.0: cannot open shared object file')")
    monkeypatch.syspath_prepend(str(tmp_path))
    (broken,) = realsense.what_is_missing()
    assert "libusb-1.0.so.0" in broken and broken.endswith("apt install libusb-1.0-0")


def test_the_list_tells_whether_a_camera_is_connected(library: Library) -> None:
    assert camera_entry("realsense").missing() == []
    library.serials = []
    assert camera_entry("realsense").missing() == ["no RealSense is connected"]
