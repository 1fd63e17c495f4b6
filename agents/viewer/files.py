"""The files of a recorded view: which comes next, when one is full, and the oldest, which go where a limit says so."""

from __future__ import annotations

import contextlib
import math
from pathlib import Path

from agents.segments import KEPT_PARTS, next_segment, segments, total_size

FILE_NAME = "recording.rrd"
_MB = 1e6  # bytes
_BEGINNING = 2.0
"""s in which a file has got all that was there already: it is written once a second, as some views draw"""


class ViewFiles:
    """Names the files of a view in a folder, and keeps their size within a limit.

    Args:
        folder: of the files.
        keep_mb: MB that all of them may take together; 0 for any.
    """

    def __init__(self, folder: Path, keep_mb: float) -> None:
        self._folder = folder
        self._keep = keep_mb * _MB or math.inf
        self._path: Path | None = None
        self._begun: float | None = None
        self._beginning: int | None = None  # bytes

    def is_full(self, now: float) -> bool:
        """Whether the present file is so large at `now` (s) that the next one shall begin.

        However large the scene is, a file holds as much again as its beginning.
        """
        if self._path is None or math.isinf(self._keep):
            return False
        self._begun = now if self._begun is None else self._begun
        if now < self._begun + _BEGINNING:
            return False
        size = total_size([self._path])
        self._beginning = size if self._beginning is None else self._beginning
        return size >= max(self._part, 2 * self._beginning)

    def begin(self) -> Path:
        """The next file, which does not exist yet; the oldest are removed, so that there is room for it."""
        self._path = next_segment(self._folder, FILE_NAME)
        self._begun = self._beginning = None
        before = segments(self._folder, FILE_NAME)
        while before and total_size(before) > self._keep - self._part:
            with contextlib.suppress(OSError):  # somebody else removed it, or holds it: then it is his
                before[0].unlink()
            del before[0]
        return self._path

    @property
    def _part(self) -> float:
        return self._keep / KEPT_PARTS if math.isfinite(self._keep) else 0.0
