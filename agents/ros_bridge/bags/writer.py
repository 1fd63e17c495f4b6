"""Writes a rosbag2 bag in MCAP: one file, or a folder with `metadata.yaml`; it looks like a connection to ROS."""

from __future__ import annotations

import shutil
import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Literal

from rosbags.interfaces import Connection, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.interfaces import Qos as BagQos
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from agents.ros_bridge.errors import RosLinkError
from agents.ros_bridge.link.link import Endpoint, Publisher, Qos, Received, RosSubscription, Served, Topic
from agents.ros_bridge.messages.types import RosTypes
from dsr.clock import Clock
from dsr.errors import ConfigError

SUFFIX = ".mcap"
"""Of bags that are one file"""
_VERSION: Literal[8] = 8
"""Of the format: that of Iron and Jazzy, which later releases read"""
_UNLIMITED = QosTime(9223372036, 854775807)
"""2^63 - 1 ns: as rosbag2 writes a deadline or lease that there is not"""


class BagWriter:
    """Writes messages with the time of a clock. Implements `agents.ros_bridge.link.link.RosLink`, and nobody answers.

    `finish` puts the bag in its place; without it, `close` leaves nothing behind.

    Args:
        path: a file that ends with `.mcap`, or a folder; it must not exist.
        types: of the messages.
        clock: tells when a message arrives.
        wants: whether a topic of this name is wanted.

    Raises:
        ConfigError: if something is there already, or cannot be written.
    """

    def __init__(self, path: Path, types: RosTypes, clock: Clock, wants: Callable[[str], bool]) -> None:
        if path.exists() and not (path.is_dir() and path.suffix != SUFFIX and not any(path.iterdir())):
            raise ConfigError(f"{path}: expected a file or folder that does not exist")
        self._path, self._types, self._clock, self._wants = path, types, clock, wants
        self.counts: Counter[str] = Counter()
        """Messages by topic"""
        self.topics: dict[str, None] = {}
        """All topics that there would be, wanted or not"""
        path.parent.mkdir(parents=True, exist_ok=True)
        self._under_way = Path(tempfile.mkdtemp(prefix=f".{path.name}-", dir=path.parent))
        self._writer: Writer | None = None
        self._connections: dict[Topic, Connection] = {}

    def publisher(self, topic: Topic) -> Publisher:
        """Announce a topic, which is in the bag if a message comes. Raises `RosMessageError` for an unknown type."""
        self._types.definition(topic.type)
        self.topics[topic.name] = None
        return _BagPublisher(self, topic, self._wants(topic.name))

    def write(self, topic: Topic, cdr: bytes) -> None:
        """Add a message."""
        if self._writer is None:
            folder = self._under_way / self._path.name.removesuffix(SUFFIX)
            self._writer = Writer(folder, version=_VERSION, storage_plugin=StoragePlugin.MCAP)
            self._writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
            self._writer.open()
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(
                topic.name, topic.type, msgdef=self._types.definition(topic.type), rihs01=self._types.hash(topic.type),
                offered_qos_profiles=[_bag_qos(topic.qos)],
            )  # fmt: skip
        self._writer.write(self._connections[topic], round(self._clock.now() * 1e9), cdr)
        self.counts[topic.name] += 1

    def finish(self) -> None:
        """Write the index, and put the bag in its place. Raises `ConfigError` for a bag without messages."""
        if self._writer is None:
            raise ConfigError("nothing to export: the recording has none of what is wanted")
        writer, self._writer = self._writer, None
        writer.close()
        folder = writer.path
        if self._path.suffix == SUFFIX:
            (folder / f"{folder.name}{SUFFIX}").replace(self._path)
        else:
            folder.replace(self._path)
        self.close()

    def close(self) -> None:
        """Remove what is not finished; harmless when repeated."""
        if self._writer is not None:
            self._writer.abort()
            self._writer = None
        shutil.rmtree(self._under_way, ignore_errors=True)

    # ---- nobody else is there

    def subscribe(self, topic: Topic, receive: Callable[[Received], None]) -> RosSubscription:
        """Refuse: nobody is heard."""
        raise RosLinkError("nobody is heard in a bag that is being written")

    def endpoints(self) -> list[Endpoint]:
        """Nobody is visible."""
        return []

    def serve(self, name: str, type: str, answer: Callable[[bytes], bytes]) -> Served:
        """Refuse: nobody asks."""
        raise RosLinkError("nobody asks in a bag that is being written")

    def prepare(self, name: str, type: str) -> None:
        """Nothing: nobody answers in a bag."""

    def call(self, name: str, type: str, request: bytes, timeout: float) -> bytes:
        """Refuse: nobody answers."""
        raise RosLinkError("nobody answers in a bag that is being written")

    def problems(self) -> list[str]:
        """Nothing: all that is sent is written."""
        return []

    def lost(self) -> dict[str, int]:
        """Nothing."""
        return {}

    def unauthenticated(self) -> list[str]:
        """Nobody: nobody speaks to a bag."""
        return []


class _BagPublisher:
    """Writes the messages of one topic."""

    writer = b""

    def __init__(self, bag: BagWriter, topic: Topic, wanted: bool) -> None:
        self._bag, self._topic, self._wanted = bag, topic, wanted

    def send(self, cdr: bytes) -> None:
        """Add a message, if its topic is wanted."""
        if self._wanted:
            self._bag.write(self._topic, cdr)

    def subscribers(self) -> int:
        """One, the bag, if the topic is wanted."""
        return int(self._wanted)

    def close(self) -> None:
        """Nothing is to be taken back."""


def _bag_qos(qos: Qos) -> BagQos:
    """As rosbag2 writes what publishers offer, so that `ros2 bag play` offers the same."""
    return BagQos(
        QosHistory.KEEP_LAST, qos.depth,
        QosReliability.RELIABLE if qos.reliable else QosReliability.BEST_EFFORT,
        QosDurability.TRANSIENT_LOCAL if qos.transient_local else QosDurability.VOLATILE,
        _UNLIMITED, _UNLIMITED, QosLiveliness.AUTOMATIC, _UNLIMITED, False,
    )  # fmt: skip
