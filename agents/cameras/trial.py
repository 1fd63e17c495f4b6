"""What somebody wants to know of a camera before agents use it: rate, delay, depth, intrinsics, what is missing."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from typing import Any

import msgspec
import numpy as np

from agents.cameras.errors import CorruptFrameError
from agents.checked_frames import CheckedFrames
from agents.drivers import CameraDriver
from agents.frame_images import images
from agents.recorder.images import is_color
from dsr.clock import WALL_CLOCK
from dsr.errors import WireError
from dsr.images.blobs import Frame
from dsr.vocabulary.intrinsics import Intrinsics

_log = logging.getLogger("dsr.camera")
_QUANTILES = (0.05, 0.5, 0.95)
_AHEAD = 0.05
"""s by which a stamp may be ahead of our clock: what clocks of one machine never are"""
_LOOKS = 25
"""Rows and columns of a picture at which the model of its lens is looked at"""
_LATE = 0.5
"""s by which pictures may be late: no driver needs as long, so that it is rather a clock that is behind"""


class CameraFindings(msgspec.Struct, frozen=True):
    """What was seen of a camera."""

    frames: int
    """Pictures that came"""
    rate_hz: float | None
    """Pictures a second, by their stamps, with those that were passed over; None of less than two"""
    width: int
    height: int
    """px"""
    delay_s: float | None
    """s from the stamp of a picture until it was there, the median"""
    depth_known: float | None
    """Share of the last picture's pixels of which the depth is known; None without depth"""
    depth_m: tuple[float, float, float] | None
    """m, 5 %, 50 % and 95 % of the known depths"""
    intrinsics: Intrinsics | None
    fov_deg: float | None
    """deg, horizontal field of view"""
    counts: dict[str, int]
    """What the driver counted"""
    trouble: str
    """What the driver says is wrong; empty if nothing is"""
    missing: list[str]
    """What agents will lack, and what to do"""


class Trial:
    """Takes the frames of a camera.

    Args:
        driver: of the camera.
    """

    def __init__(self, driver: CameraDriver) -> None:
        self._taken = CheckedFrames(driver, WALL_CLOCK, _log, "that is tried")
        self.last: Frame | None = None
        """The newest frame"""
        self._frames = 0
        self._stamps: list[float] = []
        self._delays: list[float] = []

    def look(self, now: float) -> Frame | None:
        """The newest frame at `now` (s), if there is a new one."""
        frame = self._taken.frame()
        if frame is not None:
            self._frames += 1
            self._stamps.append(frame.stamp)
            self._delays.append(now - frame.stamp)
            self.last = frame
        return frame

    def findings(self) -> CameraFindings:
        """What was seen until now."""
        counts = dict(self._taken.counts)
        delay = float(np.median(self._delays)) if self._delays else None
        color, depth, intrinsics, missing = _content(self.last)
        if delay is not None and not -_AHEAD <= delay <= _LATE:
            missing.append(_of_clock(delay))
        return CameraFindings(
            frames=self._frames, rate_hz=self._rate(counts), width=color[1], height=color[0], delay_s=delay,
            depth_known=None if depth is None else float((depth > 0.0).mean()), depth_m=_spread(depth),
            intrinsics=intrinsics, fov_deg=None if intrinsics is None else _fov(intrinsics), counts=counts,
            trouble=self._taken.trouble, missing=missing,
        )  # fmt: skip

    def _rate(self, counts: Mapping[str, int]) -> float | None:
        if len(self._stamps) < 2 or self._stamps[-1] <= self._stamps[0]:
            return None
        passed = counts.get("passed over", 0)
        return (len(self._stamps) - 1 + passed) / (self._stamps[-1] - self._stamps[0])


def picture_of(frame: Frame) -> Any:
    """A picture (h, w, 3) uint8, blue first, of colour and beside it depth if there is any, near in red, far in blue.

    Raises `CorruptFrameError` if there is neither.
    """
    import cv2

    shown = []
    color, depth = frame.arrays.get("color"), frame.arrays.get("depth")
    if color is not None and is_color(color):
        shown.append(cv2.cvtColor(color, cv2.COLOR_RGB2BGR))
    spread = _spread(depth)
    if depth is not None and depth.ndim == 2 and spread is not None:
        near, _, far = spread
        inverse = np.clip((far - depth) / max(far - near, 1e-3), 0.0, 1.0)
        false = cv2.applyColorMap((255.0 * inverse).astype(np.uint8), cv2.COLORMAP_TURBO)
        shown.append(np.where((depth > 0.0)[..., None], false, 0).astype(np.uint8))
    if not shown or len({image.shape[0] for image in shown}) != 1:
        raise CorruptFrameError("a frame without a picture")
    return np.concatenate(shown, axis=1)


def _content(frame: Frame | None) -> tuple[tuple[int, ...], Any, Intrinsics | None, list[str]]:
    """Size, depth and intrinsics of a frame, and what is wrong with them."""
    if frame is None:
        return (0, 0), None, None, []
    color, depth = frame.arrays.get("color"), frame.arrays.get("depth")
    first = color if color is not None else depth
    shape = first.shape[:2] if first is not None and first.ndim >= 2 else (0, 0)
    missing, intrinsics = [], None
    try:
        _, depth, intrinsics = images(frame)
    except WireError as error:
        missing.append(f"no agent can measure in these pictures: {error}")
    if depth is None:
        missing.append("no depth: objects are found by their tags only, and hands not by skin colour")
    elif _spread(depth) is None:
        missing.append("depth is known nowhere: is something too near, or the emitter off?")
    if intrinsics is not None and not (0.0 <= intrinsics.cx < shape[1] and 0.0 <= intrinsics.cy < shape[0]):
        missing.append("the optical axis is not in the picture: are these the intrinsics of another camera or size?")
    if intrinsics is not None and (blind := _blind(intrinsics)) > 0.0:
        missing.append(f"by its distortion the lens shows nothing in {blind:.0%} of the picture: is that of another?")
    return shape, depth, intrinsics, missing


def _of_clock(delay: float) -> str:
    if delay < 0.0:
        return f"stamps are {-delay:.2f} s ahead of this machine's clock: poses of what moves will be wrong"
    return f"pictures come {delay:.2f} s after their stamps: the camera is slow, or its clock is behind this machine's"


def _spread(depth: Any) -> tuple[float, float, float] | None:
    """Quantiles of the known depths, m."""
    if depth is None:
        return None
    known = depth[np.isfinite(depth) & (depth > 0.0)]
    if not known.size:
        return None
    low, middle, high = (float(value) for value in np.quantile(known, _QUANTILES))
    return low, middle, high


def _blind(intrinsics: Intrinsics) -> float:
    """Share of the pixels through which no ray comes, by the model of the lens."""
    columns, rows = (np.linspace(0.0, most - 1.0, _LOOKS) for most in (intrinsics.width, intrinsics.height))
    rays = intrinsics.rays(np.stack(np.meshgrid(columns, rows), axis=-1))
    return float(1.0 - np.isfinite(rays).all(axis=-1).mean())


def _fov(intrinsics: Intrinsics) -> float | None:
    """Angle between the rays through the middles of left and right edge, deg; None if the lens sees nothing there."""
    row = 0.5 * (intrinsics.height - 1)
    rays = intrinsics.rays(np.array([[0.0, row], [intrinsics.width - 1.0, row]]))
    cosine = float(rays[0] @ rays[1] / np.linalg.norm(rays[0]) / np.linalg.norm(rays[1]))
    return math.degrees(math.acos(min(1.0, cosine))) if math.isfinite(cosine) else None
