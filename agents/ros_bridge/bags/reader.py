"""Reads bags: rosbag2 as MCAP or SQLite, a file or a folder, also cut ones, and bags of ROS 1; messages as CDR."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag2 import Reader as Ros2Reader

from agents.recorder.mcap_file import RecordingError, RecordingFile
from agents.ros_bridge.bags.definitions import complaint
from agents.ros_bridge.bags.unpacking import bound_rosbags
from agents.ros_bridge.bridge.topics import topic_node
from agents.ros_bridge.errors import RosMessageError
from agents.ros_bridge.messages.transforms import TF_MESSAGE
from agents.ros_bridge.messages.types import RosTypes
from dsr.errors import ConfigError

bound_rosbags()
PROFILE = "ros2"
"""Of MCAP files that are bags"""
_ROS1 = ".bag"
_STORED = (".mcap", ".db3")
_RENAMED = {"tf/msg/tfMessage": TF_MESSAGE}
"""Types of ROS 1 that go by another name in ROS 2, with the same fields"""


class BagTopic(NamedTuple):
    """One topic of a bag."""

    name: str
    type: str
    messages: int
    complaint: str
    """Why its messages cannot be read; empty if they can"""


class BagMessage(NamedTuple):
    """One message of a bag."""

    time: float
    """s since the Unix epoch, when it was recorded"""
    topic: str
    cdr: bytes


class _Raw(NamedTuple):
    """A message as it is stored."""

    time: float
    topic: str
    data: bytes


class _Part(NamedTuple):
    """One file of a bag, or a folder with all of them."""

    topics: list[tuple[str, str, int, MessageDefinition]]
    """Name, type, messages, definition"""
    begin: float
    end: float
    problems: list[str]
    read: Callable[[Collection[str], float], Iterator[_Raw]]
    """Yields the messages of topics from a time (s) on."""
    is_ros1: bool
    files: tuple[Path, ...] = ()
    """MCAP files, of which a damaged piece can be left out"""


class Bag:
    """A bag. What cannot be read is told, and the rest is read.

    Args:
        path: a file (`.mcap`, `.db3`, `.bag`), or a folder of rosbag2.
        types: those as which messages are read.

    Raises:
        RecordingError: if there is no bag, nothing in it, or nothing that can be read.
    """

    def __init__(self, path: Path | str, types: RosTypes) -> None:
        self.path = Path(path)
        self._types = types
        parts = _parts(self.path)
        self._parts = [part for part in parts if any(count for _, _, count, _ in part.topics)]
        self.problems = [problem for part in parts for problem in part.problems]
        """What of it is cut off or damaged"""
        self.malformed = 0
        """Messages of ROS 1 that were dropped because they are none of their type"""
        if not self._parts:
            raise RecordingError("; ".join([f"{path}: a bag without messages", *self.problems]))
        self.begin, self.end = min(part.begin for part in self._parts), max(part.end for part in self._parts)
        """s since the Unix epoch, times of the first and the last message"""
        self.topics: dict[str, BagTopic] = {}
        """All topics, by name"""
        for part in self._parts:
            for name, stored, count, definition in part.topics:
                type = _RENAMED.get(stored, stored)
                before = self.topics[name].messages if name in self.topics else 0
                told = self.topics[name].complaint if before else self._complaint(name, type, definition)
                self.topics[name] = BagTopic(name, type, before + count, told)

    def topic(self, name: str) -> BagTopic:
        """A topic that can be read. Raises `ConfigError` if there is none of this name, or its type is not known."""
        if name not in self.topics:
            raise ConfigError(f"{self.path}: no topic {name}; there are {', '.join(sorted(self.topics))}")
        topic = self.topics[name]
        if topic.complaint:
            raise ConfigError(f"{self.path}: {name} ({topic.type}) cannot be read: {topic.complaint}")
        return topic

    def messages(self, topics: Collection[str], since: float = 0.0) -> Iterator[BagMessage]:
        """Yield the messages of these topics from a time (s) on, in the order of their times.

        A damaged piece of an MCAP file is left out, and `problems` says so. Other bags end where they are damaged.
        """
        for part in self._parts:
            for raw in self._raw(part, topics, since):
                cdr = self._from_ros1(raw) if part.is_ros1 else raw.data
                if cdr is not None:
                    yield BagMessage(raw.time, raw.topic, cdr)

    def _raw(self, part: _Part, topics: Collection[str], since: float) -> Iterator[_Raw]:
        reached = since
        try:
            for raw in part.read(topics, since):
                reached = raw.time
                yield raw
            return
        except Exception as error:  # whatever the libraries raise for damaged files
            if not part.files:
                self._note(f"{self.path.name}: damaged, and not read on from there ({_said(error)})")
        for file in part.files:
            rest = _cut(file)
            for problem in rest.problems:
                self._note(problem)
            yield from (raw for raw in rest.read(topics, reached) if raw.time > reached)

    def _from_ros1(self, raw: _Raw) -> bytes | None:
        try:
            return self._types.from_ros1(self.topics[raw.topic].type, raw.data)
        except RosMessageError:
            self.malformed += 1
            return None

    def _complaint(self, name: str, type: str, definition: MessageDefinition) -> str:
        """Why a topic cannot be read; empty if it can. Names of ROS 1 and of other writers may be odd."""
        try:
            topic_node(name)
        except RosMessageError:
            return "its name is none that a topic can have"
        return complaint(self._types, type, definition)

    def _note(self, problem: str) -> None:
        if problem not in self.problems:
            self.problems.append(problem)


def _parts(path: Path) -> list[_Part]:
    """What a bag consists of. Raises `RecordingError`."""
    if not path.exists():
        raise RecordingError(f"{path}: no such file or folder")
    try:
        return [_whole(path)]
    except Exception as error:  # whatever the libraries raise for damaged files
        files = sorted(file for file in path.iterdir() if file.suffix in _STORED) if path.is_dir() else [path]
        if not files or not any(file.suffix == ".mcap" for file in files):
            hint = "; `rosbag reindex` repairs a bag that was never closed" if path.suffix == _ROS1 else ""
            raise RecordingError(f"{path}: cannot be read as a bag ({_said(error)}){hint}") from error
        return [_whole(file) if file.suffix != ".mcap" else _mcap(file) for file in files]


def _mcap(path: Path) -> _Part:
    """An MCAP file, also one that was never closed."""
    try:
        return _whole(path)
    except Exception:  # as above
        return _cut(path)


def _whole(path: Path) -> _Part:
    """A bag with its index, as `rosbags` reads it."""
    ros1 = path.suffix == _ROS1

    def opened() -> Any:
        return Ros1Reader(path) if ros1 else Ros2Reader(path)

    def read(topics: Collection[str], since: float) -> Iterator[_Raw]:
        with opened() as reader:
            wanted = [one for one in reader.connections if one.topic in topics]
            start = round(since * 1e9) if since > 0.0 else None
            if wanted:
                for one, time, data in reader.messages(wanted, start=start):
                    yield _Raw(time / 1e9, one.topic, bytes(data))

    with opened() as reader:
        topics = [(one.topic, one.msgtype, one.msgcount, one.msgdef) for one in reader.connections]
        files = (path,) if path.suffix == ".mcap" else tuple(sorted(path.glob("*.mcap"))) if path.is_dir() else ()
        return _Part(topics, reader.start_time / 1e9, (reader.end_time - 1) / 1e9, [], read, ros1, files)


def _cut(path: Path) -> _Part:
    """An MCAP file without index, as far as it goes; each piece in the order of its times."""
    file = RecordingFile(path, PROFILE)
    counts: dict[str, int] = {}
    begin, end = float("inf"), 0.0
    for message in file:
        counts[message.topic] = counts.get(message.topic, 0) + 1
        begin, end = min(begin, message.stamp), max(end, message.stamp)

    def read(topics: Collection[str], since: float) -> Iterator[_Raw]:
        for piece in RecordingFile(path, PROFILE).pieces():
            for message in sorted(piece.records, key=lambda message: message.stamp):
                if message.topic in topics and message.stamp >= since:
                    yield _Raw(message.stamp, message.topic, message.payload)

    found = []
    for name, count in counts.items():
        schema = file.schemas.get(name)
        is_known = schema is not None and schema.encoding == "ros2msg"
        text = schema.data.decode(errors="replace") if schema is not None and is_known else ""
        kind = MessageDefinitionFormat.MSG if is_known else MessageDefinitionFormat.NONE
        found.append((name, "" if schema is None else schema.name, count, MessageDefinition(kind, text)))
    problems = [f"{path.name}: {problem}" for problem in file.problems]
    return _Part(found, begin, end, problems, read, is_ros1=False)


def _said(error: Exception) -> str:
    return str(error) or type(error).__name__
