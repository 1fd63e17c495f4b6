"""A camera of a recording, as a driver: agents that are at work see what was recorded, as if it were now."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

from msgspec.structs import replace

from agents.cameras.device_clock import RecordingClock
from agents.cameras.errors import CorruptFrameError, EndOfPicturesError
from agents.cameras.reader import CameraReader, Wait
from agents.packed_images import check_opencv
from agents.recorder.images import is_color, unpack
from agents.recorder.index import RecordingIndex, TimedRecord
from agents.recorder.opening import is_bag
from dsr.clock import WALL_CLOCK, Clock
from dsr.errors import ConfigError, WireError, suggest
from dsr.images.blobs import Frame, decode_frame
from dsr.network.keys import Keys
from dsr.network.transport import Transport

_STREAMS = "blob/"
"""What topics of streams begin with"""
_GAP = 0.1
"""s between the last picture and the first one of the next round"""


class RecordedCamera(CameraReader):
    """A `CameraDriver`. Stamps are moved, so that the recording begins when the driver is made.

    Args:
        bus: not used; drivers are made with it.
        keys: not used either.
        name: of the camera, for people.
        recording: path of a recording of ours, or of the folder of a run.
        camera: whose stream; empty for the only one.
        begin: s since the recording's first message, where to start.
        speed: seconds of the recording a second.
        loop: begin again at the end; otherwise nothing comes any more.

    Raises:
        RecordingError: if there is no recording.
        ConfigError: for a bag of ROS, a camera that is not there, or options that make no sense.
        MissingExtraError: without OpenCV, which unpacks images.
    """

    clock: ClassVar[Clock] = WALL_CLOCK

    def __init__(
        self, bus: Transport, keys: Keys, name: str = "recording", *, recording: str, camera: str = "",
        begin: float = 0.0, speed: float = 1.0, loop: bool = True,
    ) -> None:  # fmt: skip
        check_opencv()
        if not (math.isfinite(speed) and speed > 0.0):
            raise ConfigError(f"speed {speed}: expected a positive number")
        if is_bag(Path(recording)):
            raise ConfigError(f"{recording} is a bag of ROS: use the driver `bag`")
        index = RecordingIndex(recording)
        if not 0.0 <= begin < max(index.duration, math.ulp(0.0)):
            raise ConfigError(f"begin {begin}: expected 0 to {index.duration:.1f} s, where {recording} ends")
        kind = type(self)
        topic = f"{_STREAMS}{_checked(index, camera)}"
        super().__init__(
            name, RecordedDevice(index, topic, begin, speed, loop, kind.clock), frozen=0.0, clock=kind.clock
        )


class RecordedDevice:
    """A `CameraDevice` on a recording; see `RecordedCamera`.

    Args:
        index: of the recording.
        topic: of the camera's stream.
        begin: s since the recording's first message, where to start.
        speed: seconds of the recording a second.
        loop: begin again at the end.
        clock: by which pictures are due.
    """

    def __init__(self, index: RecordingIndex, topic: str, begin: float, speed: float, loop: bool, clock: Clock) -> None:
        self._index, self._topic = index, topic
        self._begin, self._speed, self._loop, self._clock = begin, speed, loop, clock
        self._stamps = RecordingClock(_GAP)
        self._records: Iterator[TimedRecord] = iter(())
        self._found = False
        """Whether there was a picture in this round"""

    def open(self) -> None:
        """Go to the beginning."""
        self._records, self._found = self._index.read_for(self._begin), False

    def read(self, wait: Wait) -> Frame | None:
        """The next picture when it is due. Raises `CorruptFrameError`, and `EndOfPicturesError` at the end."""
        for record in self._records:
            if record.topic == self._topic and record.time >= self._begin:
                self._found = True
                return self._due(_frame(record), wait)
        if not (self._loop and self._found):
            raise EndOfPicturesError(f"{self._index.path} is at its end")
        wait(_GAP)  # also if no picture could be used, and thus none was waited for
        self.open()
        return None

    def close(self) -> None:
        """Read no more."""
        self._records = iter(())

    def _due(self, frame: Frame, wait: Wait) -> Frame | None:
        now = self._clock.now()
        stamp = self._stamps.ours(frame.stamp / self._speed, now)
        return None if wait(stamp - now) else replace(frame, stamp=stamp)


def _frame(record: TimedRecord) -> Frame:
    try:
        frame = unpack(decode_frame(record.payload))
    except WireError as error:
        raise CorruptFrameError(str(error)) from error
    color = frame.arrays.get("color")
    if color is None or not is_color(color):
        raise CorruptFrameError("a frame without a colour image")
    return frame


def _checked(index: RecordingIndex, camera: str) -> str:
    """The stream of a camera, or the only one. Raises `ConfigError`, which names all, if there is none such."""
    named = [topic.removeprefix(_STREAMS) for topic in index.topics if topic.startswith(_STREAMS)]
    streams = [stream for stream in named if "/" not in stream]
    if camera and camera not in streams:
        raise ConfigError(f"{index.path}: no camera {camera!r}; {suggest(camera, streams)}")
    if not camera and len(streams) != 1:
        raise ConfigError(f"{index.path}: which `camera`? There are: {', '.join(sorted(streams)) or 'none'}")
    return camera or streams[0]
