"""Reads a device that may block in a thread of its own: keeps its newest frame, and opens it again when it went."""

from __future__ import annotations

import logging
import math
import threading
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Protocol

from msgspec.structs import replace

from agents.cameras.condition import FROZEN, CameraCondition
from agents.cameras.errors import CorruptFrameError, DeviceError, EndOfPicturesError
from agents.cameras.given_intrinsics import GivenIntrinsics, SizeError
from agents.drivers import SILENCE
from dsr.clock import WALL_CLOCK, Clock
from dsr.errors import ConfigError
from dsr.images.blobs import Frame
from dsr.threads import new_thread

FIRST_PAUSE = 0.5
"""s until a camera that went is tried again for the first time; then twice as long each time"""
_LONGEST_PAUSE = 8.0
"""s, the longest pause: who plugs a camera in again does not wait longer"""
_STEADY = 10.0
"""s of pictures after which a camera counts as well again, and the pauses begin anew"""
_PATIENCE = 2.0
"""s to wait for the thread at the end; one that hangs in its device's library is left to the end of the process"""

Wait = Callable[[float], bool]
"""Waits so many s; true if the camera is to be closed"""


class CameraDevice(Protocol):
    """What a reader reads. Its methods are called in one thread, and may block."""

    def open(self) -> None:
        """Make it ready. Raises `DeviceError`, which says why that cannot be."""

    def read(self, wait: Wait) -> Frame | None:
        """The next picture, stamped, with intrinsics if the device tells them; None if none came in a moment.

        Raises:
            CorruptFrameError: for a picture that cannot be used.
            DeviceError: if the device is gone.
            EndOfPicturesError: if nothing comes any more.
        """

    def close(self) -> None:
        """Release it; harmless when repeated, or when it was never opened."""


class CameraReader:
    """A `CameraDriver` on a device that may block; it is `Diagnosed`. Devices that are not there yet are waited for.

    Args:
        name: of the camera, for people.
        device: which it reads.
        intrinsics: those of a device that tells none.
        silence: s without a usable picture after which the device is opened again.
        frozen: s of one and the same picture after which it is opened again; 0 where pictures may be the same.
        first_pause: s until it is opened again for the first time.
        counts: where the device counts too; those of the reader are added.
        clock: of stamps and pauses.
        log: where it is told that the camera is gone, or back.

    Raises:
        ConfigError: for times that cannot be waited.
    """

    def __init__(
        self, name: str, device: CameraDevice, intrinsics: GivenIntrinsics | None = None, *,
        silence: float = SILENCE, frozen: float = FROZEN, first_pause: float = FIRST_PAUSE,
        counts: Counter[str] | None = None, clock: Clock = WALL_CLOCK, log: logging.Logger | None = None,
    ) -> None:  # fmt: skip
        if not (0.0 < silence < math.inf and 0.0 < first_pause <= _LONGEST_PAUSE and 0.0 <= frozen < math.inf):
            raise ConfigError(
                f"silence {silence}, frozen {frozen}, first_pause {first_pause}: expected s, the first positive, the "
                f"second not negative, the last between 0 and {_LONGEST_PAUSE:g}"
            )
        self._device, self._intrinsics, self._clock = device, intrinsics, clock
        self._log = log or logging.getLogger("dsr.camera")
        self._condition = CameraCondition(name, self._log, silence, frozen, counts)
        self._first_pause = first_pause
        self._newest: Frame | None = None
        self.ended = False
        """Whether nothing comes any more."""
        self._stop = threading.Event()
        self._lock = threading.Lock()
        self._condition.begin(clock.monotonic())
        self._thread = new_thread(self._run, f"camera {name}")
        self._thread.start()

    def frame(self) -> Frame | None:
        """The newest frame if it was not returned before, else None."""
        with self._lock:
            frame, self._newest = self._newest, None
        return frame

    @property
    def trouble(self) -> str:
        """What is wrong now, in words; empty if nothing is."""
        return "" if self.ended else self._condition.trouble(self._clock.monotonic())

    @property
    def counts(self) -> Mapping[str, int]:
        """By name: pictures `passed over`, `black`, `frozen`, `corrupt`, of `another size`; how often it was `lost`."""
        return dict(self._condition.counts)

    def close(self) -> None:
        """Release the device; harmless when repeated."""
        self._stop.set()
        self._thread.join(_PATIENCE)

    def _run(self) -> None:
        pause = self._first_pause
        while not self._stop.is_set():
            opened = self._clock.monotonic()
            try:
                self._device.open()
                self._read_on()
            except EndOfPicturesError as error:
                self._log.info("%s", error)
                self.ended = True
                return
            except DeviceError as error:
                self._condition.lost(str(error), self._clock.monotonic())
            except Exception as error:  # of a library: the agent lives on
                self._log.debug("unexpected", exc_info=True)
                self._condition.lost(f"{type(error).__name__}: {error}", self._clock.monotonic())
            finally:
                self._close_device()
            if self._clock.monotonic() - opened > _STEADY:
                pause = self._first_pause
            self._wait(pause)
            pause = min(2.0 * pause, _LONGEST_PAUSE)

    def _read_on(self) -> None:
        """Take pictures until the end, or until the device is gone."""
        self._condition.begin(self._clock.monotonic())
        while not self._stop.is_set():
            try:
                frame = self._device.read(self._wait)
            except CorruptFrameError as error:
                self._condition.corrupt(str(error))
                frame = None
            now = self._clock.monotonic()
            if frame is not None and self._condition.takes(frame, now):
                self._keep(self._with_intrinsics(frame))
            elif frozen := self._condition.frozen_for(now):
                raise DeviceError(f"it is frozen: the same picture for {frozen:.1f} s")
            elif self._condition.is_silent(now):
                raise DeviceError(f"no usable picture for {self._condition.silence:g} s")

    def _keep(self, frame: Frame) -> None:
        with self._lock:
            if self._newest is not None:
                self._condition.counts["passed over"] += 1
            self._newest = frame

    def _with_intrinsics(self, frame: Frame) -> Frame:
        """A frame with the intrinsics that were given for it; without any, and told, if they are of another size."""
        if self._intrinsics is None:
            return frame
        try:
            meta = self._intrinsics.meta(frame.arrays["color"].shape)
        except SizeError as error:
            self._condition.tell("another size", str(error))
            self._condition.counts["another size"] += 1
            return frame
        self._condition.well("another size")
        return replace(frame, meta={**frame.meta, **meta})

    def _wait(self, seconds: float) -> bool:
        return self._clock.wait(self._stop, seconds)

    def _close_device(self) -> None:
        try:
            self._device.close()
        except Exception as error:  # it is gone already
            self._log.debug("camera %s: closing failed: %s", self._thread.name, error)
