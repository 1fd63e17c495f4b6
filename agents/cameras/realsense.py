"""A RealSense, or a recording of one, as a driver: colour, and depth in the image of colour, by librealsense."""

from __future__ import annotations

import logging
from collections import Counter
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np

from agents.cameras.condition import FROZEN
from agents.cameras.device_clock import DeviceClock, RecordingClock
from agents.cameras.errors import CorruptFrameError, DeviceError, EndOfPicturesError
from agents.cameras.reader import FIRST_PAUSE, CameraReader, Wait
from agents.cameras.realsense_lens import intrinsics_of, pose_of
from agents.depth_alignment import DepthAlignment
from agents.drivers import SILENCE
from agents.frame_images import Color, Depth
from agents.pairing import Pairing
from dsr.clock import WALL_CLOCK, Clock
from dsr.config.extras import MissingExtraError, missing_extra
from dsr.errors import ConfigError
from dsr.images.blobs import Frame
from dsr.network.keys import Keys
from dsr.network.transport import Transport
from dsr.vocabulary.intrinsics import Intrinsics

_MOMENT = 200
"""ms to wait for pictures at a time: at the end nobody waits longer"""
_WORST_FIT = 0.5
"""px by which fitted intrinsics may be off; beyond, that is told"""
_RECORDED_FPS = 30.0
"""Hz, of most recordings: so long after its last picture one begins again"""
_ACCESS = ("ACCESS", "access denied", "ermission")
"""In the messages of librealsense about devices that somebody may not use"""
_NO_DEVICE = "no RealSense is connected"
_log = logging.getLogger("dsr.camera")


class RealSense(CameraReader):
    """A `CameraDriver`.

    Args:
        bus: not used; drivers are made with it.
        keys: not used either.
        name: of the camera, for people.
        serial: serial number of the camera; empty for the only one, or any.
        file: path of a recording instead of a camera, `.bag` or `.db3`, as `realsense-viewer` makes them.
        width: px of colour; of a recording, as it was recorded.
        height: px, likewise.
        fps: pictures a second, likewise.
        depth: whether depth is wanted.
        loop: begin a recording again at its end; otherwise nothing comes any more.
        silence: s without a usable picture after which the camera is opened again.
        frozen: s of one and the same picture after which it is opened again; 0 for never.
        first_pause: s until it is opened again for the first time.

    Raises:
        MissingExtraError: without pyrealsense2, or if it cannot be loaded.
        ConfigError: for a recording that is not there, or options that no camera has.
    """

    clock: ClassVar[Clock] = WALL_CLOCK

    def __init__(
        self, bus: Transport, keys: Keys, name: str = "realsense", *, serial: str | int = "", file: str = "",
        width: int = 640, height: int = 480, fps: int = 30, depth: bool = True, loop: bool = True,
        silence: float = SILENCE, frozen: float = FROZEN, first_pause: float = FIRST_PAUSE,
    ) -> None:  # fmt: skip
        library = load_library()
        if file and not Path(file).is_file():
            raise ConfigError(f"{file}: there is no such file")
        if min(width, height, fps) < 1:
            raise ConfigError("driver realsense: width, height and fps are positive")
        kind = type(self)
        counts: Counter[str] = Counter()
        device = RealSenseDevice(
            library, str(serial), file, (width, height, fps), counts, depth=depth, loop=loop, clock=kind.clock
        )
        super().__init__(
            name, device, silence=silence, frozen=0.0 if file else frozen, first_pause=first_pause, counts=counts,
            clock=kind.clock,
        )  # fmt: skip


class _Picture(NamedTuple):
    """A picture of colour or of depth, copied from the device's memory."""

    pixels: Any
    told: float
    """s, its stamp"""
    is_ours: bool
    """Whether that is on this machine's clock, not on the device's or of a recording"""


class RealSenseDevice:
    """A `CameraDevice` on a pipeline of librealsense; see `RealSense`.

    Colour and depth are paired by stamps: sets of frames may mix a new colour with an old depth.

    Args:
        library: pyrealsense2.
        serial: see `RealSense`.
        file: likewise.
        wanted: width and height of colour in px, and pictures a second.
        counts: gets how many pictures were `unpaired`, and how many pairs `passed over`.
        depth: whether depth is wanted.
        loop: see `RealSense`.
        clock: of stamps.
    """

    def __init__(
        self, library: Any, serial: str, file: str, wanted: tuple[int, int, int], counts: Counter[str], *,
        depth: bool, loop: bool, clock: Clock,
    ) -> None:  # fmt: skip
        self._rs, self._serial, self._file, self._wanted = library, serial, file, wanted
        self._with_depth, self._loop, self._clock, self._counts = depth, loop, clock, counts
        self._pipeline: Any = None
        self._playback: Any = None

    def open(self) -> None:
        """Start the streams. Raises `DeviceError`, which says why that cannot be."""
        rs = self._rs
        try:
            pipeline = rs.pipeline()
            profile = pipeline.start(self._config())
            self._pipeline = pipeline
            self._describe(profile)
        except RuntimeError as error:
            raise DeviceError(_explained(str(error), self._file)) from error
        self._pairing: Pairing[_Picture] = Pairing()
        self._stamps = RecordingClock(1.0 / _RECORDED_FPS) if self._file else DeviceClock()
        self._numbers: dict[str, int] = {}
        self._counted = 0, 0

    def read(self, wait: Wait) -> Frame | None:
        """The next colour with its depth. Raises `CorruptFrameError`, and `EndOfPicturesError` after a recording."""
        try:
            came, frames = self._pipeline.try_wait_for_frames(_MOMENT)
        except RuntimeError as error:
            raise DeviceError(_explained(str(error), self._file)) from error
        if not came:
            self._check_end(wait)
            return None
        arrived = self._clock.monotonic()
        color, depth = frames.get_color_frame(), frames.get_depth_frame()
        if self._aligner is None:
            picture = self._new(color, "color")
            return None if picture is None else self._frame(picture, None, wait)
        if (new := self._new(color, "color")) is not None:
            self._pairing.add_color(new, new.told, arrived)
        if (new := self._new(depth, "depth")) is not None:
            self._pairing.add_depth(new, new.told, arrived)
        pair = self._pairing.take()
        self._count()
        return None if pair is None else self._frame(*pair, wait)

    def close(self) -> None:
        """Stop the streams."""
        pipeline, self._pipeline, self._playback = self._pipeline, None, None
        if pipeline is not None:
            pipeline.stop()

    def _config(self) -> Any:
        rs, config = self._rs, self._rs.config()
        if self._file:
            config.enable_device_from_file(self._file, repeat_playback=self._loop)
            config.enable_stream(rs.stream.color)
            if self._with_depth:
                config.enable_stream(rs.stream.depth)
            return config
        config.enable_device(self._found())
        width, height, fps = self._wanted
        config.enable_stream(rs.stream.color, width, height, rs.format.rgb8, fps)
        if self._with_depth:
            config.enable_stream(rs.stream.depth, rs.format.z16, fps)
        return config

    def _found(self) -> str:
        """Serial number of the wanted camera. Raises `DeviceError` if it is not there."""
        serials = connected(self._rs)
        if not serials:
            raise DeviceError(_NO_DEVICE)
        if self._serial and self._serial not in serials:
            raise DeviceError(f"no RealSense {self._serial} is connected; there are: {', '.join(serials)}")
        return self._serial or serials[0]

    def _describe(self, profile: Any) -> None:
        """Take down what the device tells of its streams."""
        rs, device = self._rs, profile.get_device()
        if self._file:
            self._playback = device.as_playback()
            self._playback.set_real_time(False)  # it waits for us, and loses nothing
        color = profile.get_stream(rs.stream.color).as_video_stream_profile()
        self._color = self._intrinsics(color, "colour")
        self._aligner: DepthAlignment | None = None
        if self._with_depth:
            depth = profile.get_stream(rs.stream.depth).as_video_stream_profile()
            self._scale = np.float32(device.first_depth_sensor().get_depth_scale())
            self._aligner = DepthAlignment(
                self._intrinsics(depth, "depth"), self._color, pose_of(depth.get_extrinsics_to(color))
            )

    def _intrinsics(self, stream: Any, what: str) -> Intrinsics:
        found, off = intrinsics_of(self._rs, stream.get_intrinsics())
        if off > _WORST_FIT:
            _log.warning("intrinsics of %s are off by up to %.1f px: its lens has another model than ours", what, off)
        return found

    def _new(self, frame: Any, kind: str) -> _Picture | None:
        """The copy of a frame that did not come before. Raises `CorruptFrameError` for pixels that make no sense."""
        if not frame or self._numbers.get(kind) == frame.get_frame_number():
            return None
        self._numbers[kind] = frame.get_frame_number()
        pixels = np.asarray(frame.get_data())
        read = self._read_color if kind == "color" else self._read_depth
        domain, domains = frame.get_frame_timestamp_domain(), self._rs.timestamp_domain
        is_ours = not self._file and domain in (domains.global_time, domains.system_time)
        return _Picture(read(frame.get_profile().format(), pixels), float(frame.get_timestamp()) / 1e3, is_ours)

    def _read_color(self, format: Any, pixels: Any) -> Color:
        rs, shape = self._rs, (self._color.height, self._color.width, 3)
        if pixels.shape != shape or pixels.dtype != np.uint8 or format not in (rs.format.rgb8, rs.format.bgr8):
            raise CorruptFrameError(
                f"colour {pixels.shape} {pixels.dtype} {format}; expected {shape} uint8, rgb8 or bgr8"
            )
        return np.array(pixels if format == rs.format.rgb8 else pixels[..., ::-1])

    def _read_depth(self, format: Any, pixels: Any) -> Depth:
        if pixels.ndim != 2 or pixels.dtype != np.uint16 or format != self._rs.format.z16:
            raise CorruptFrameError(f"depth {pixels.shape} {pixels.dtype} {format}; expected z16")
        return np.asarray(pixels * self._scale, np.float32)

    def _frame(self, color: _Picture, depth: _Picture | None, wait: Wait) -> Frame | None:
        """A frame on our clock, of a recording when it is due; None if it is to be closed meanwhile."""
        arrays: dict[str, Any] = {"color": color.pixels}
        if depth is not None and self._aligner is not None:
            try:
                arrays["depth"] = self._aligner.align(depth.pixels)
            except ValueError as error:
                raise CorruptFrameError(str(error)) from error
        stamp = color.told if color.is_ours else self._stamps.ours(color.told, self._clock.now())
        if self._file and wait(stamp - self._clock.now()):
            return None
        return Frame(stamp, arrays, self._color.meta())

    def _count(self) -> None:
        """Tell what of the pairing was not counted yet."""
        now = self._pairing.unpaired, self._pairing.passed_over
        for what, new, old in zip(("unpaired", "passed over"), now, self._counted, strict=True):
            if new > old:
                self._counts[what] += new - old
        self._counted = now

    def _check_end(self, wait: Wait) -> None:
        """Raise `EndOfPicturesError` if a recording came to its end."""
        stopped = self._playback is not None and self._playback.current_status() == self._rs.playback_status.stopped
        if stopped and not self._loop:
            raise EndOfPicturesError(f"{self._file} is at its end")


def load_library() -> Any:
    """Import pyrealsense2. Raises `MissingExtraError`, with the remedy, if that cannot be."""
    try:
        import pyrealsense2
    except ImportError as error:
        absent = missing_extra(error)
        said = absent or f"pyrealsense2 cannot be loaded ({error}); Debian, Ubuntu: apt install libusb-1.0-0"
        raise MissingExtraError(f"driver realsense: {said}") from error
    return pyrealsense2


def connected(library: Any) -> list[str]:
    """Serial numbers of the cameras that are connected."""
    info = library.camera_info.serial_number
    return [device.get_info(info) for device in library.context().query_devices() if device.supports(info)]


def what_is_missing() -> list[str]:
    """What `dsr drivers list` says is missing of a RealSense."""
    try:
        serials = connected(load_library())
    except MissingExtraError as error:
        return [str(error).removeprefix("driver realsense: ")]
    except RuntimeError as error:
        return [_explained(str(error), "")]
    return [] if serials else [_NO_DEVICE]


def _explained(said: str, file: str) -> str:
    """What librealsense says, with the remedy where it is known."""
    if file:
        return f"{file}: no recording of a RealSense with such streams ({said})"
    if any(word in said for word in _ACCESS):
        return f"no permission for the camera ({said}): install the udev rules of librealsense, then plug it in again"
    return said
