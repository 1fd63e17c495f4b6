"""Reads recordings: one file, or all segments in a run's folder; cut or damaged ones as far as they go."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import msgspec

from agents.recorder.mcap_file import RecordedMessage, RecordingError, RecordingFile
from agents.segments import segments

__all__ = ["FILE_NAME", "RecordedMessage", "Recording", "RecordingError", "SegmentReport", "read_recording"]

FILE_NAME = "recording.mcap"


class SegmentReport(msgspec.Struct, frozen=True):
    """The state of one file of a recording."""

    path: Path
    messages: int
    seconds: float
    """s, from the first message to the last"""
    complete: bool
    """The file was closed in an orderly way and nothing in it is damaged."""
    problems: tuple[str, ...]

    def __str__(self) -> str:
        found = f"{self.path.name}: {self.messages} message{'' if self.messages == 1 else 's'} in {self.seconds:.1f} s"
        return found if self.complete else f"{found}, recovered; {'; '.join(self.problems)}"


class Recording:
    """The messages of a recording in the order they arrived; iterate over it, as often as wanted.

    `reports` tells about each file how much of it could be read, after an iteration came to its end.
    """

    def __init__(self, files: list[Path]) -> None:
        self.files = files
        self.metadata: dict[str, str] = RecordingFile(files[0]).metadata
        self.reports: list[SegmentReport] = []

    def __iter__(self) -> Iterator[RecordedMessage]:
        """Raises `RecordingError` for a file of something else."""
        self.reports = []
        for path in self.files:
            yield from self._read(RecordingFile(path))

    def _read(self, file: RecordingFile) -> Iterator[RecordedMessage]:
        count, first, last = 0, 0.0, 0.0
        for record in file:
            first, last = (first, last) if count else (record.stamp, record.stamp)
            first, last = min(first, record.stamp), max(last, record.stamp)
            count += 1
            yield record
        self.metadata = self.metadata or file.metadata
        complete = file.complete and not file.problems
        self.reports.append(SegmentReport(file.path, count, last - first, complete, tuple(file.problems)))


def read_recording(path: Path | str) -> Recording:
    """The recording in a file, or in the folder of a run.

    Raises:
        RecordingError: if there is none, or the first file is something else.
    """
    path = Path(path)
    files = segments(path, FILE_NAME) if path.is_dir() else [path]
    if not files:
        raise RecordingError(f"{path}: no recording in this folder, expected {FILE_NAME}")
    return Recording(files)
