"""The files of one recording: begins one after the other, and removes the oldest where limits say so."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from agents.recorder.config import MB, RecorderConfig
from agents.recorder.mcap_file import RecordingFile, RecordingWriter
from agents.recorder.reader import FILE_NAME
from agents.segments import KEPT_PARTS, next_segment, segments, total_size
from dsr.errors import ConfigError

LIMITED = "limited"
"""Name in the metadata of files that may be removed by who writes further ones: they were written within limits."""


class FileLimits(NamedTuple):
    """When a file ends, and how much is kept."""

    bytes: float = math.inf
    """Size after which the next file begins"""
    period: float = math.inf
    """s, after which the next file begins"""
    keep_files: float = math.inf
    keep_bytes: float = math.inf
    """Of all files together"""

    @classmethod
    def of(cls, config: RecorderConfig) -> FileLimits:
        """The limits that a configuration asks for."""
        keep = config.keep_mb * MB or math.inf
        size = config.rotate_mb * MB or keep / KEPT_PARTS
        return cls(size, config.rotate_period or math.inf, config.keep_files or math.inf, keep)

    @property
    def keeps_all(self) -> bool:
        """Whether nothing is ever removed."""
        return self.keep_files == self.keep_bytes == math.inf

    def __str__(self) -> str:
        files = "" if math.isinf(self.keep_files) else f"{self.keep_files:g} files"
        return ", ".join(filter(None, (files, "" if math.isinf(self.keep_bytes) else f"{self.keep_bytes / MB:g} MB")))


class RecordingFiles:
    """Begins the files of a recording in a folder, and keeps their number and size within limits.

    Only files that were themselves written within limits are removed, never those of an unlimited recording.
    """

    def __init__(self, folder: Path, limits: FileLimits, about: Mapping[str, str]) -> None:
        self.removed = 0
        """Number of files that were removed."""
        self._folder = folder
        self.limits = limits
        self._about = dict(about) | ({} if limits.keeps_all else {LIMITED: str(limits)})
        self._writer: RecordingWriter | None = None
        self._begun = -math.inf
        self._beginning = 0  # bytes
        self._removable = [] if limits.keeps_all else list(filter(_is_limited, segments(folder, FILE_NAME)))

    def begin(self, now: float) -> RecordingWriter:
        """Open the next file at `now` (s), after removing what is too much for it. Raises `OSError`."""
        path = next_segment(self._folder, FILE_NAME)
        self._writer = RecordingWriter(path, self._about | {"segment": path.name})
        self._begun, self._beginning = now, 0
        if not self.limits.keeps_all:
            self._removable.append(path)
        self.keep_limits()
        return self._writer

    def is_full(self, now: float) -> bool:
        """Whether the present file is so large or old at `now` (s) that the next one shall begin.

        However large the graph is, a file holds as much again as its beginning; before that is written it is not full.
        """
        if self._writer is None or not self._beginning:
            return False
        is_large = self._writer.size >= max(self.limits.bytes, 2 * self._beginning)
        return is_large or now - self._begun >= self.limits.period

    def note_beginning(self) -> None:
        """The present file holds all that it has to begin with, and that is flushed."""
        if self._writer is not None and not self._beginning:
            self._beginning = self._writer.size

    def keep_limits(self) -> None:
        """Remove the oldest files, as far as they are too many or too large together; never the present one."""
        self._removable = [path for path in self._removable if path.exists()]
        while len(self._removable) > self.limits.keep_files and self.drop_oldest():
            pass
        while total_size(self._removable) > self.limits.keep_bytes and self.drop_oldest():
            pass

    def drop_oldest(self) -> bool:
        """Remove the oldest file that may be, for want of room; false if there is none beside the present one."""
        current = None if self._writer is None else self._writer.path
        oldest = next((path for path in self._removable if path != current), None)
        if oldest is None:
            return False
        self._removable.remove(oldest)
        with contextlib.suppress(OSError):  # somebody else removed it, or holds it: then it is his
            oldest.unlink()
            self.removed += 1
        return True


def _is_limited(path: Path) -> bool:
    """Whether a file was written within limits."""
    try:
        file = RecordingFile(path)
        next(file.pieces(), None)
    except ConfigError:
        return False
    return LIMITED in file.metadata
