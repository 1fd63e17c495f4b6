"""The configuration of the recorder: what is recorded, how often, where, and how much of it is kept."""

from __future__ import annotations

import math

import msgspec

from agents.recorder.selection import RecordSelection

MB = 1e6
"""bytes"""


class RecorderConfig(msgspec.Struct, frozen=True):
    """Which data are recorded, where, and how much is kept."""

    folder: str = "runs/recorder"
    """Gets `recording.mcap`, or `recording-2.mcap` if that exists, and so on."""
    only: tuple[str, ...] = ()
    """Record nothing else than these parts (`agents.recorder.selection.PARTS`, or `PART/PATTERN`); empty: all."""
    without: tuple[str, ...] = ()
    """Parts that are left out, likewise."""
    frames_hz: float = 2.0
    """Camera frames a second and camera that are kept while something moves in the picture; 0 for none."""
    still_hz: float = 0.2
    """The same while nothing moves in the picture; 0 for none. More than `frames_hz` counts as that."""
    jpeg_quality: int = 90
    """JPEG quality of recorded colour images, 1 to 100."""
    lossless: bool = False
    """Keep images as they are, in every bit: three times as large."""
    flush_period: float = 1.0
    """s, at most so much is lost when the recorder is killed"""
    snapshot_period: float = 30.0
    """s between two messages that hold the whole graph, from which reading may begin"""
    rotate_mb: float = 0.0
    """MB after which the next file begins; 0 for never"""
    rotate_period: float = 0.0
    """s after which the next file begins; 0 for never"""
    keep_files: int = 0
    """Number of files that are kept: the oldest goes when another one begins; 0 for all."""
    keep_mb: float = 0.0
    """MB that all files may take together: the oldest go; 0 for any. Without `rotate_mb`, an eighth of it is that."""
    about: dict[str, str] = {}
    """Facts about the recording that its file shall tell, such as the run's seed."""

    def __post_init__(self) -> None:
        for name in ("frames_hz", "still_hz", "rotate_mb", "rotate_period", "keep_mb"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) >= 0):
                raise ValueError(f"{name} {getattr(self, name)}: expected a finite number, 0 or more")
        for name in ("flush_period", "snapshot_period"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise ValueError(f"{name} {getattr(self, name)}: expected more than 0 s")
        if not 1 <= self.jpeg_quality <= 100:
            raise ValueError(f"jpeg_quality {self.jpeg_quality}: expected 1 to 100")
        if self.keep_files < 0:
            raise ValueError(f"keep_files {self.keep_files}: expected 0 or more")
        if self.keep_files and not (self.rotate_mb or self.rotate_period or self.keep_mb):
            raise ValueError(f"keep_files {self.keep_files}: expected rotate_mb or rotate_period too, when a file ends")
        if self.keep_mb and self.rotate_mb > self.keep_mb:
            raise ValueError(f"rotate_mb {self.rotate_mb:g}: expected no more than keep_mb, {self.keep_mb:g}")
        RecordSelection(self.only, self.without)
