"""What a recording consists of: messages and bytes by channel, how long it is, whether it was cut."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import msgspec
import zstandard

from agents.recorder.config import MB
from agents.recorder.mcap_file import RecordingError, RecordingFile
from agents.recorder.reader import SegmentReport, read_recording
from dsr.network.keys import agent_of

_FAST = 1  # level of zstd: only how the channels compare is asked


class ChannelContents(msgspec.Struct, frozen=True):
    """One channel of a recording; those of one agent's replicas count as one."""

    channel: str
    messages: int
    bytes: int
    """Of its messages, not compressed"""
    packed: int
    """Bytes of the files that it takes, about: messages of all channels are compressed together."""


class RecordingContents(msgspec.Struct, frozen=True):
    """A summary of a recording."""

    files: list[SegmentReport]
    channels: list[ChannelContents]
    """The largest first."""
    size: int
    """Bytes of all files"""
    seconds: float
    """s, from the first message to the last"""
    metadata: dict[str, str]

    @property
    def mb_per_minute(self) -> float:
        """How fast its files grew, MB a minute; 0 for a recording of one instant."""
        return self.size / MB / (self.seconds / 60.0) if self.seconds > 0.0 else 0.0


def contents_of(path: Path | str) -> RecordingContents:
    """Read a recording, a file or the folder of a run, and sum it up. Raises `RecordingError` if there is none."""
    sums = _Sums()
    for file in read_recording(path).files:
        sums.add(RecordingFile(file))
    if not sums.messages:
        raise RecordingError(f"{path}: a recording without messages")
    channels = [
        ChannelContents(name, count, sums.bytes[name], round(sums.packed[name]))
        for name, count in sums.messages.items()
    ]
    channels.sort(key=lambda channel: channel.packed, reverse=True)
    return RecordingContents(sums.files, channels, sums.size, sums.last - sums.first, sums.metadata)


class _Sums:
    """Sums by channel, of one file after the other."""

    def __init__(self) -> None:
        self.messages: Counter[str] = Counter()
        self.bytes: Counter[str] = Counter()
        self.packed: dict[str, float] = {}
        self.files: list[SegmentReport] = []
        self.metadata: dict[str, str] = {}
        self.size = 0
        self.first = self.last = 0.0

    def add(self, file: RecordingFile) -> None:
        """Add one file."""
        count, first, last = 0, 0.0, 0.0
        for piece in file.pieces():
            parts: dict[str, list[bytes]] = {}
            for record in piece.records:
                parts.setdefault(_channel(record.topic), []).append(record.payload)
            self._add_piece(parts, piece.packed)
            stamps = [record.stamp for record in piece.records]
            first = min([first if count else stamps[0], *stamps]) if stamps else first
            last = max([last, *stamps])
            count += len(stamps)
        if count:
            self.first = min(self.first, first) if any(report.messages for report in self.files) else first
            self.last = max(self.last, last)
        complete = file.complete and not file.problems
        self.files.append(SegmentReport(file.path, count, last - first, complete, tuple(file.problems)))
        self.metadata = file.metadata | self.metadata
        self.size += file.size

    def _add_piece(self, parts: dict[str, list[bytes]], packed: int) -> None:
        """Share the bytes of a piece out among its channels, as each would be compressed alone."""
        alone = {name: len(zstandard.compress(b"".join(payloads), _FAST)) for name, payloads in parts.items()}
        for name, payloads in parts.items():
            self.messages[name] += len(payloads)
            self.bytes[name] += sum(map(len, payloads))
            self.packed[name] = self.packed.get(name, 0.0) + packed * alone[name] / sum(alone.values())


def _channel(topic: str) -> str:
    """The topic, without what differs from one start of an agent to the next."""
    kind, _, name = topic.partition("/")
    return f"{kind}/{agent_of(name) or name}" if kind in ("d", "rt") else topic
