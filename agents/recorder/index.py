"""The times of a recording: its span, and where reading must begin to know the graph at a time."""

from __future__ import annotations

import contextlib
from bisect import bisect_right
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from agents.recorder.channels import MESH, SNAPSHOT
from agents.recorder.mcap_file import RecordingError, RecordingFile
from agents.recorder.reader import read_recording
from dsr.errors import WireError
from dsr.geometry import Mesh

HISTORY = 2.0
"""s of changes that are read before the time asked for, so that frames have a past."""
_OVERLAP = 1.0
"""s of changes that are read before a snapshot: what it just missed stands there."""


class TimedRecord(NamedTuple):
    """A message with its place in time."""

    time: float
    """s since the first message; never goes back from one message to the next."""
    topic: str
    payload: bytes


class _Place(NamedTuple):
    """Where reading may begin."""

    stamp: float
    """s, the greatest before it"""
    file: int
    position: int


class RecordingIndex:
    """Reads a recording once, in pieces, and can then read it from any time on.

    Args:
        path: a file, or the folder of a run.

    Raises:
        RecordingError: if there is no recording, or nothing in it.
    """

    settings_of = ""
    """The agent whose settings say how the recording is read; none"""

    def __init__(self, path: Path | str) -> None:
        self.path = path = Path(path)
        """Of the file or folder."""
        recording = read_recording(path)
        self._files = [RecordingFile(file) for file in recording.files]
        self._places: list[_Place] = []
        self._snapshots: list[float] = []
        self.topics: Counter[str] = Counter()
        """How many messages each topic has; in the order in which they first appear."""
        self._meshes: set[tuple[int, int]] = set()
        """(file, position) of the pieces with meshes"""
        self.begin = self.end = 0.0
        """Stamps of the first and the last message, s."""
        self._scan()
        self.problems = [f"{file.path.name}: {problem}" for file in self._files for problem in file.problems]
        """What was cut off or damaged."""
        self.metadata = {name: value for file in reversed(self._files) for name, value in file.metadata.items()}
        if not self.topics:
            raise RecordingError(f"{path}: a recording without messages{''.join(f'; {p}' for p in self.problems)}")

    @property
    def duration(self) -> float:
        """Seconds from the first message to the last"""
        return self.end - self.begin

    @property
    def notes(self) -> list[str]:
        """How the recording is understood; nothing is to be said."""
        return []

    def findings(self) -> list[str]:
        """What made no sense is counted by who reads it."""
        return []

    def read_for(self, time: float) -> Iterator[TimedRecord]:
        """Read all that is needed to know the graph at `time` (s since the first message), and everything after it."""
        return self._read(self._place_for(self.begin + time))

    def skips_to(self, time: float, reached: float) -> bool:
        """Whether `read_for` begins later than `reached`: then going on from there would only take longer."""
        return self._place_for(self.begin + time).stamp > self.begin + reached

    def meshes(self) -> Iterator[Mesh]:
        """Yield the meshes of the recording, one in memory at a time; damaged ones are left out."""
        for number, position in sorted(self._meshes):
            for record in next(self._files[number].pieces(position)).records:
                if record.topic == MESH:
                    with contextlib.suppress(WireError):
                        yield Mesh.decode(record.payload)

    def _scan(self) -> None:
        latest: float | None = None
        for number, file in enumerate(self._files):
            for piece in file.pieces():
                if latest is None and piece.records:
                    latest = self.begin = piece.records[0].stamp
                self._places.append(_Place(latest or 0.0, number, piece.position))
                for record in piece.records:
                    latest = max(latest or 0.0, record.stamp)
                    self.topics[record.topic] += 1
                    if record.topic == SNAPSHOT:
                        self._snapshots.append(latest)
                    elif record.topic == MESH:
                        self._meshes.add((number, piece.position))
        self.end = latest or 0.0

    def _place_for(self, stamp: float) -> _Place:
        before = bisect_right(self._snapshots, stamp - HISTORY)
        needed = self._snapshots[before - 1] - _OVERLAP if before else self.begin
        after = bisect_right(self._places, needed, key=lambda place: place.stamp)
        return self._places[max(after - 1, 0)] if needed > self.begin else self._places[0]

    def _read(self, place: _Place) -> Iterator[TimedRecord]:
        latest = place.stamp
        for number, file in enumerate(self._files[place.file :], place.file):
            for piece in file.pieces(place.position if number == place.file else 0):
                for record in piece.records:
                    latest = max(latest, record.stamp)
                    yield TimedRecord(latest - self.begin, record.topic, record.payload)
