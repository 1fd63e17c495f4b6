"""Camera images with the detected objects in them."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable
from typing import Any

import cv2
import numpy as np
import rerun as rr
from numpy.typing import NDArray

from agents.viewer import palette
from agents.viewer.model import DrawnCamera
from agents.viewer.places import Places
from agents.viewer.scene import camera_entity
from dsr import Frame, FrameReader, Memory
from dsr.network.keys import is_key
from dsr.vocabulary.perceived import MOST_CAMERAS
from dsr.vocabulary.tags import COUNT

_LABEL_BELOW = 8.0  # px
_LONGEST_SIDE = 65_500  # px, that a JPEG can have


class ImageView:
    """Logs the newest image of each camera as a JPEG, if it is another one, and its detections as outlines.

    Args:
        recording: where to.
        memory: whose streams of frames.
        rate_hz: images a second and camera, at most.
        quality: of the JPEG, 1 to 100.
    """

    def __init__(
        self, recording: rr.RecordingStream, memory: Memory, rate_hz: float, quality: int, log: logging.Logger
    ) -> None:
        self.unusable = 0
        """Frames that were left out because their arrays are not as expected."""
        self._recording = recording
        self._memory = memory
        self._period = 1.0 / rate_hz
        self._quality = quality
        self._log = log
        self._readers: dict[str, FrameReader] = {}
        self._drawn: dict[str, float] = {}
        """When (s) an image of a stream was drawn last"""
        self._shown: dict[str, tuple[NDArray[np.uint8], rr.EncodedImage]] = {}
        self._places = Places(MOST_CAMERAS)

    @property
    def cameras(self) -> list[str]:
        """Cameras that have a place, and have sent an image."""
        return sorted(self._shown)

    def draw(self, cameras: Iterable[DrawnCamera], now: float) -> None:
        """Log what is new at time `now` (s)."""
        for stream, names in self._in_turn({camera.name: camera for camera in cameras}, now).items():
            if is_key(stream):
                self._draw_stream(stream, names, now)
            else:
                self._skip(names[0], f"stream {stream!r}", "a name such as 'camera_overhead'")

    def begin_anew(self) -> None:
        """Log the newest images once more."""
        for camera, (_, image) in self._shown.items():
            self._recording.log(camera_entity(camera), image)

    def close(self) -> None:
        """Stop receiving frames."""
        for reader in self._readers.values():
            reader.close()

    def _in_turn(self, cameras: dict[str, DrawnCamera], now: float) -> dict[str, list[str]]:
        """Those that have a place, by stream. What was known of the others is dropped."""
        given = self._places.given({name: camera.makers for name, camera in cameras.items()}, now)
        chosen: dict[str, list[str]] = {}
        for name in given:
            chosen.setdefault(cameras[name].stream, []).append(name)
        self._drawn = {stream: time for stream, time in self._drawn.items() if stream in chosen}
        self._shown = {name: shown for name, shown in self._shown.items() if name in given}
        streams = {each for stream in chosen for each in (stream, f"{stream}/detections")}
        for stream in self._readers.keys() - streams:
            self._readers.pop(stream).close()
        return chosen

    def _draw_stream(self, stream: str, cameras: list[str], now: float) -> None:
        """Log what is new in a stream for all its cameras: a reader gives each frame once."""
        if now - self._drawn.get(stream, -math.inf) >= self._period - 1e-6:
            frame = self._reader(stream).latest()
            if frame is not None and self._draw_image(cameras, frame):
                self._drawn[stream] = now
                for camera in cameras:
                    self._places.note(camera, now)
        detections = self._reader(f"{stream}/detections").latest()
        if detections is not None:
            self._draw_detections(cameras, detections)

    def _reader(self, stream: str) -> FrameReader:
        if stream not in self._readers:
            self._readers[stream] = self._memory.frames(stream)
        return self._readers[stream]

    def _draw_image(self, cameras: list[str], frame: Frame) -> bool:
        color = frame.arrays.get("color")
        if color is None or not _is_image(color):
            self._skip(cameras[0], "color", "a (height, width, 3) uint8 image")
            return False
        others = [one for one in cameras if one not in self._shown or not np.array_equal(self._shown[one][0], color)]
        if others:
            bgr = cv2.cvtColor(color, cv2.COLOR_RGB2BGR)
            _, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, self._quality])
            shown = color.copy(), rr.EncodedImage(contents=data.tobytes(), media_type="image/jpeg")
            for camera in others:
                self._shown[camera] = shown
                self._recording.log(camera_entity(camera), shown[1])
        return True

    def _draw_detections(self, cameras: list[str], frame: Frame) -> None:
        corners, ids = frame.arrays.get("corners"), frame.arrays.get("ids")
        if corners is None or ids is None or not _are_detections(corners, ids):
            self._skip(cameras[0], "corners and ids", f"finite (n, 4, 2) px, and (n,), of at most {COUNT} tags")
            return
        colors = [palette.PERCEPT] * ids.size
        outlines = np.concatenate([corners, corners[:, :1]], axis=1)
        lines = rr.LineStrips2D(outlines, colors=colors, radii=[1.5] * ids.size)
        below = np.column_stack([corners[:, :, 0].mean(axis=1), corners[:, :, 1].max(axis=1) + _LABEL_BELOW])
        labels = [f"tag {number}" for number in ids.ravel()]
        names = rr.Points2D(below, labels=labels, show_labels=True, colors=colors, radii=[0.1] * ids.size)
        for camera in cameras:
            entity = f"{camera_entity(camera)}/detections"
            self._recording.log(entity, lines)
            self._recording.log(f"{entity}/names", names)

    def _skip(self, camera: str, arrays: str, expected: str) -> None:
        self.unusable += 1
        if self.unusable == 1:
            self._log.warning("camera %r: %s cannot be drawn, expected %s (logged once)", camera, arrays, expected)


def _are_detections(corners: NDArray[Any], ids: NDArray[Any]) -> bool:
    """Whether they are corners of tags, no more than there are: each gets a label."""
    return ids.size <= COUNT and corners.shape == (ids.size, 4, 2) and bool(np.isfinite(corners).all())


def _is_image(array: NDArray[Any]) -> bool:
    """Whether it is an RGB image that a JPEG can hold."""
    has_layout = array.dtype == np.uint8 and array.ndim == 3 and array.shape[2] == 3
    return has_layout and array.size > 0 and max(array.shape) <= _LONGEST_SIDE
