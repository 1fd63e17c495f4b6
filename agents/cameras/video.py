"""A video file, as a driver: agents that are at work see what somebody filmed, as if it were now; colour only."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, ClassVar

from agents.cameras.errors import CorruptFrameError, DeviceError, EndOfPicturesError
from agents.cameras.given_intrinsics import GivenIntrinsics
from agents.cameras.pictures import color_frame
from agents.cameras.reader import CameraReader, Wait
from agents.cameras.webcam import Capture, open_capture
from dsr.clock import WALL_CLOCK, Clock
from dsr.config.extras import check_installed
from dsr.errors import ConfigError
from dsr.images.blobs import Frame
from dsr.network.keys import Keys
from dsr.network.transport import Transport
from dsr.runtime.native_output import silenced

_LIKELY_FPS = 30.0
"""Hz of a file that tells no rate"""
_LONGEST = 1e9
"""s, thirty years: no film is as long, and OpenCV counts no further"""
_FASTEST_FPS = 1000.0
"""Hz, no camera films faster: a rate beyond is none"""


class VideoFile(CameraReader):
    """A `CameraDriver` without depth. Stamps are moved, so that the video begins when the driver is made.

    Args:
        bus: not used; drivers are made with it.
        keys: not used either.
        name: of the camera, for people.
        file: path of the video, in any format that FFmpeg reads.
        begin: s from its beginning, where to start.
        speed: seconds of the video a second.
        loop: begin again at the end; otherwise nothing comes any more.
        calibration: file with the camera's intrinsics, see `read_intrinsics_file`.
        fov: deg, its horizontal field of view, if there is no calibration; without both there are no intrinsics.

    Raises:
        MissingExtraError: without OpenCV.
        ConfigError: for a file that is not there or no video, or options that make no sense.
    """

    clock: ClassVar[Clock] = WALL_CLOCK
    capture: ClassVar[Capture] = staticmethod(open_capture)

    def __init__(
        self, bus: Transport, keys: Keys, name: str = "video", *, file: str, begin: float = 0.0, speed: float = 1.0,
        loop: bool = True, calibration: str = "", fov: float = 0.0,
    ) -> None:  # fmt: skip
        check_installed(["cv2"], "driver video")
        if not (math.isfinite(speed) and speed > 0.0 and 0.0 <= begin < _LONGEST):
            raise ConfigError(f"speed {speed}, begin {begin}: expected a positive number, and 0 to {_LONGEST:g} s")
        intrinsics = GivenIntrinsics(calibration, fov)
        kind = type(self)
        device = VideoDevice(file, begin, speed, loop, kind.clock, kind.capture)
        device.check()
        super().__init__(name, device, intrinsics, frozen=0.0, clock=kind.clock)


class VideoDevice:
    """A `CameraDevice` on a file; see `VideoFile`.

    Args:
        file: path of the video.
        begin: s, where to start.
        speed: seconds of the video a second.
        loop: begin again at the end.
        clock: by which pictures are due.
        capture: opens the file.
    """

    def __init__(self, file: str, begin: float, speed: float, loop: bool, clock: Clock, capture: Capture) -> None:
        self._file, self._begin, self._speed, self._loop = Path(file), begin, speed, loop
        self._clock, self._capture = clock, capture
        self._opened: Any = None
        self._started = 0.0
        self._period = 1.0 / _LIKELY_FPS
        self._last = -math.inf
        """s of the video, its last picture"""

    def check(self) -> None:
        """Raise `ConfigError` unless there is a video with a picture at the beginning."""
        if not self._file.is_file():
            raise ConfigError(f"{self._file}: there is no such file")
        try:
            with silenced():  # FFmpeg has its own say about other files
                self.open()
            self._next()
        except (DeviceError, CorruptFrameError) as error:
            raise ConfigError(str(error)) from error
        except EndOfPicturesError as error:
            raise ConfigError(f"{self._file}: no picture from {self._begin:g} s on") from error
        finally:
            self.close()

    def open(self) -> None:
        """Open the file, and go to the beginning. Raises `DeviceError`."""
        import cv2

        opened = self._capture(str(self._file))
        if not opened.isOpened():
            opened.release()
            raise DeviceError(f"{self._file}: no video, or in a format that FFmpeg does not read")
        fps = float(opened.get(cv2.CAP_PROP_FPS))
        self._period = 1.0 / (fps if 0.0 < fps < _FASTEST_FPS else _LIKELY_FPS)
        if self._begin:
            opened.set(cv2.CAP_PROP_POS_MSEC, 1e3 * self._begin)
        self._opened = opened
        self._started = self._clock.now()
        self._last = self._begin - self._period

    def read(self, wait: Wait) -> Frame | None:
        """The next picture when it is due. Raises `CorruptFrameError`, and `EndOfPicturesError` at the end."""
        try:
            at, picture = self._next()
        except EndOfPicturesError:
            if not self._loop:
                raise
            if self._last < self._begin:
                raise DeviceError(f"{self._file}: no picture from {self._begin:g} s on") from None
            wait(max(0.0, self._due(self._last + self._period) - self._clock.now()))
            self.close()
            self.open()
            return None
        due = self._due(at)
        if wait(due - self._clock.now()):
            return None
        return color_frame(picture, due)

    def close(self) -> None:
        """Close the file."""
        opened, self._opened = self._opened, None
        if opened is not None:
            opened.release()

    def _next(self) -> tuple[float, Any]:
        """The next picture, and when it was taken, s of the video: a period after the last one if it does not tell."""
        import cv2

        try:
            read, picture = self._opened.read()
            at = float(self._opened.get(cv2.CAP_PROP_POS_MSEC)) / 1e3
        except cv2.error as error:
            raise CorruptFrameError(str(error).strip()) from error
        if not read:
            raise EndOfPicturesError(f"{self._file} is at its end")
        self._last = at if math.isfinite(at) and self._last < at < self._last + 1.0 else self._last + self._period
        return self._last, picture

    def _due(self, at: float) -> float:
        """Our time, s, at which a picture of the video is due."""
        return self._started + (at - self._begin) / self._speed
