"""Opens recordings: ours, and bags of ROS, which look like ours to all who read them."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Protocol, cast

from agents.recorder.index import RecordingIndex, TimedRecord
from agents.recorder.reader import FILE_NAME
from agents.segments import segments
from dsr.config.plugins import RECORDINGS, load
from dsr.geometry import Mesh

_MCAP = b"\x89MCAP0\r\n\x01"
_ROS1, _SQLITE = b"#ROSBAG V", b"SQLite format 3\0"
_PROFILE = struct.Struct("<9xQI")
"""Beginning of an MCAP file: magic, opcode, length of the header, length of the profile"""
_BAG_METADATA = "metadata.yaml"
_STORED = (".mcap", ".db3")

Settings = Mapping[str, Mapping[str, Any]]
"""Fields of configurations, by agent"""


class RecordingSource(Protocol):
    """What a recording gives to those who read it: see `RecordingIndex`, which is one."""

    path: Path
    begin: float
    end: float
    topics: Counter[str]
    problems: list[str]
    metadata: dict[str, str]

    @property
    def settings_of(self) -> str:
        """The agent whose settings say how the recording is read; empty if there is nothing to say."""

    @property
    def duration(self) -> float:
        """Seconds from the first message to the last"""

    @property
    def notes(self) -> list[str]:
        """How the recording is understood, for people."""

    def findings(self) -> list[str]:
        """What of the messages that were read made no sense, for people."""

    def read_for(self, time: float) -> Iterator[TimedRecord]:
        """Read all that is needed to know the graph at `time` (s since the first message), and everything after it."""

    def skips_to(self, time: float, reached: float) -> bool:
        """Whether `read_for` is faster than going on from `reached` (s)."""

    def meshes(self) -> Iterator[Mesh]:
        """Yield the meshes of the recording."""


def open_source(path: Path | str, settings: Settings | None = None, system: str | None = None) -> RecordingSource:
    """Open a recording of ours, or a bag of ROS.

    Args:
        path: a file, the folder of a run, or that of a bag.
        settings: of the bridge that reads a bag, as those of the agent `ros_bridge`; of no meaning for ours.
        system: name or file of a system whose bridge reads a bag; likewise.

    Raises:
        RecordingError: if there is no recording, or nothing in it.
        ConfigError: for wrong settings, or a bag without the extra that reads it.
    """
    if not is_bag(Path(path)):
        return RecordingIndex(path)
    source = load(RECORDINGS, "ros")
    own = dict((settings or {}).get(source.settings_of, {}))
    return cast(RecordingSource, source(path, own, system))


def is_bag(path: Path) -> bool:
    """Whether a file or folder is a bag of ROS 1 or 2, by its first bytes; also a damaged one."""
    if path.is_dir():
        if segments(path, FILE_NAME):
            return False
        stored = (file for file in sorted(path.iterdir()) if file.suffix in _STORED)
        return (path / _BAG_METADATA).is_file() or any(map(is_bag, stored))
    try:
        with path.open("rb") as file:
            start = file.read(64)
    except OSError:
        return False
    if start.startswith((_ROS1, _SQLITE)):
        return True
    if not start.startswith(_MCAP) or len(start) < _PROFILE.size:
        return False
    length = _PROFILE.unpack_from(start)[1]
    return start[_PROFILE.size :][:length] == b"ros2"
