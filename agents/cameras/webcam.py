"""A webcam, as a driver: any camera that Video4Linux or OpenCV's other backends know, colour only."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

from agents.cameras.condition import FROZEN
from agents.cameras.errors import CorruptFrameError, DeviceError
from agents.cameras.given_intrinsics import GivenIntrinsics
from agents.cameras.pictures import color_frame
from agents.cameras.reader import FIRST_PAUSE, CameraReader, Wait
from agents.drivers import SILENCE
from dsr.clock import WALL_CLOCK, Clock
from dsr.config.extras import check_installed
from dsr.errors import ConfigError
from dsr.images.blobs import Frame
from dsr.network.keys import Keys
from dsr.network.transport import Transport

_MOST_AGE = 1.0
"""s, no picture is older when it arrives: a stamp beyond is of another clock than ours"""
_RETRY = 0.05
"""s between two questions to a camera that has no picture: about the time of one"""
_DEVICES = Path("/dev")
NO_PERMISSION = "no permission for {}: join the group that owns it (sudo usermod -aG video $USER), then log in again"
"""What is said of a device that somebody may not use"""

Capture = Callable[[int | str], Any]
"""Opens something like a `cv2.VideoCapture`"""


def open_capture(where: int | str) -> Any:
    """OpenCV's access to a camera or a file."""
    import cv2

    return cv2.VideoCapture(where)


class Webcam(CameraReader):
    """A `CameraDriver` without depth.

    Args:
        bus: not used; drivers are made with it.
        keys: not used either.
        name: of the camera, for people.
        device: number of the camera, or the path of its device such as "/dev/video0" or one in /dev/v4l/by-id, which
            stays the same when it is plugged in elsewhere.
        width: px, which the camera is asked for; 0 for its own.
        height: px, likewise.
        fps: pictures a second, likewise.
        calibration: file with its intrinsics, see `read_intrinsics_file`.
        fov: deg, its horizontal field of view, if there is no calibration; without both there are no intrinsics.
        latency: s from exposure until a picture arrives, taken off its stamp where the backend tells none.
        silence: s without a usable picture after which the camera is opened again.
        frozen: s of one and the same picture after which it is opened again; 0 for never.
        first_pause: s until it is opened again for the first time.

    Raises:
        MissingExtraError: without OpenCV.
        ConfigError: for options that no camera has, or a calibration that cannot be used.
    """

    clock: ClassVar[Clock] = WALL_CLOCK
    capture: ClassVar[Capture] = staticmethod(open_capture)

    def __init__(
        self, bus: Transport, keys: Keys, name: str = "webcam", *, device: int | str = 0, width: int = 0,
        height: int = 0, fps: float = 0.0, calibration: str = "", fov: float = 0.0, latency: float = 0.0,
        silence: float = SILENCE, frozen: float = FROZEN, first_pause: float = FIRST_PAUSE,
    ) -> None:  # fmt: skip
        check_installed(["cv2"], "driver webcam")
        if not all(0.0 <= number < math.inf for number in (width, height, fps, latency)):
            raise ConfigError("driver webcam: width, height, fps, latency: expected numbers that are not negative")
        kind = type(self)
        source = WebcamDevice(device, (width, height, fps), latency, kind.clock, kind.capture)
        intrinsics = GivenIntrinsics(calibration, fov)
        super().__init__(
            name, source, intrinsics, silence=silence, frozen=frozen, first_pause=first_pause, clock=kind.clock
        )


class WebcamDevice:
    """A `CameraDevice` on `cv2.VideoCapture`.

    Args:
        device: see `Webcam`.
        wanted: width and height in px, and pictures a second; 0 for the camera's own.
        latency: s.
        clock: of stamps.
        capture: opens the camera.
    """

    def __init__(
        self, device: int | str, wanted: tuple[int, int, float], latency: float, clock: Clock, capture: Capture
    ) -> None:
        self._device, self._wanted, self._latency = device, wanted, latency
        self._clock, self._capture = clock, capture
        self._opened: Any = None

    def open(self) -> None:
        """Open the camera and ask for what is wanted. Raises `DeviceError`."""
        import cv2

        if sys.platform == "linux":
            check_device(device_path(self._device))
        opened = self._capture(self._device)
        if not opened.isOpened():
            opened.release()
            raise DeviceError(f"{device_path(self._device)} does not open: another program uses it, or it is no camera")
        asked = (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT, cv2.CAP_PROP_FPS)
        for what, value in zip(asked, self._wanted, strict=True):
            if value:
                opened.set(what, value)
        self._opened = opened

    def read(self, wait: Wait) -> Frame | None:
        """The next picture. Raises `CorruptFrameError`, and `DeviceError` if it was unplugged."""
        import cv2

        try:
            grabbed = self._opened.grab()
            stamp = self._stamp(float(self._opened.get(cv2.CAP_PROP_POS_MSEC)) / 1e3) if grabbed else 0.0
            read, picture = self._opened.retrieve() if grabbed else (False, None)
        except cv2.error as error:
            raise CorruptFrameError(str(error).strip()) from error
        if not grabbed:
            if sys.platform == "linux":
                check_device(device_path(self._device))
            wait(_RETRY)
            return None
        if not read:
            raise CorruptFrameError("it cannot be decoded")
        return color_frame(picture, stamp)

    def close(self) -> None:
        """Release the camera."""
        opened, self._opened = self._opened, None
        if opened is not None:
            opened.release()

    def _stamp(self, told: float) -> float:
        """Time of the exposure, s: the kernel's, which is on our monotonic clock, or that of the arrival."""
        age = self._clock.monotonic() - told
        return self._clock.now() - (age if math.isfinite(told) and 0.0 <= age < _MOST_AGE else self._latency)


def device_path(device: int | str) -> Path:
    """Path of a camera that is a number or a path."""
    return Path(device) if isinstance(device, str) else _DEVICES / f"video{device}"


def check_device(path: Path) -> None:
    """Raise `DeviceError`, with the remedy, if a device is not there or may not be used."""
    if not path.exists():
        there = ", ".join(map(str, devices())) or "none"
        raise DeviceError(f"there is no {path}: it is not plugged in, or has another number; there are: {there}")
    if not os.access(path, os.R_OK | os.W_OK):
        raise DeviceError(NO_PERMISSION.format(path))


def devices() -> list[Path]:
    """The devices of Video4Linux."""
    return sorted(_DEVICES.glob("video*"))
