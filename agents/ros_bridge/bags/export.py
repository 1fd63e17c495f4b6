"""A recording as a bag that rosbag2, RViz and Foxglove read: the topics that a live bridge would have sent."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Collection, Iterable
from fnmatch import fnmatchcase
from pathlib import Path
from typing import NamedTuple

from agents.recorder.channels import SNAPSHOT
from agents.recorder.export import ExportSelection
from agents.recorder.index import TimedRecord
from agents.replay.source import ReplayedGraph
from agents.ros_bridge.bags.out_events import RecordedEventsOut
from agents.ros_bridge.bags.out_frames import BLOB, FramesOut
from agents.ros_bridge.bags.writer import BagWriter
from agents.ros_bridge.bridge.config import Send
from agents.ros_bridge.bridge.core import BridgeCore
from agents.ros_bridge.bridge.out_beliefs import BeliefsOut
from agents.ros_bridge.bridge.out_sensors import JointsOut
from agents.ros_bridge.bridge.out_status import DiagnosticsOut
from agents.ros_bridge.bridge.out_tf import TfOut
from agents.ros_bridge.bridge.tally import Tally
from agents.ros_bridge.bridge.times import TimeSource
from agents.ros_bridge.bridge.turns import Turns
from agents.ros_bridge.mapping.names import FrameNames
from agents.ros_bridge.messages.types import types_of
from dsr.clock import ManualClock
from dsr.errors import ConfigError, WireError, suggest
from dsr.graph.elements import Edge, Node
from dsr.network.keys import Keys
from dsr.network.local_transport import LocalNetwork

DISTRO = "jazzy"
"""Release whose messages are written; the definitions are in the bag"""
_STATUS = "status/"
_SEND = Send(tf_hz=math.inf, joints_hz=math.inf, beliefs_hz=math.inf)
_PERIOD = 1.0 / Send().beliefs_hz
_log = logging.getLogger("dsr.ros.export")
_log.addHandler(logging.NullHandler())  # what is told is returned


class ExportedBag(NamedTuple):
    """What an export has written."""

    messages: dict[str, int]
    """Number of messages of each topic."""
    problems: list[str]
    """What of the recording could not be read."""
    malformed: int
    """Messages that could not be decoded, or that ROS cannot express."""
    told: list[str]
    """Why, each kind once."""


class _RecordedCore(BridgeCore):
    """Sends all that was recorded, also what had come from ROS."""

    def came_from_ros(self, element: Node | Edge, attribute: str) -> bool:
        return False


def export_bag(
    source: ReplayedGraph,
    path: Path,
    wanted: ExportSelection,
    topics: Collection[str] = (),
    *,
    raw_images: bool = False,
    on_progress: Callable[[float, float], None] | None = None,
) -> ExportedBag:
    """Write what is wanted of a recording to a bag; if that fails or is interrupted, nothing is left there.

    Each message has the time at which it arrived in the recording, and in its header the stamp of who measured it.

    Args:
        source: the recording.
        path: a file that ends with `.mcap`, or a folder, which gets `metadata.yaml`, too; it must not exist.
        wanted: which nodes, and from when to when; tables have no meaning here.
        topics: names or patterns such as `/dsr/*`; all if none.
        raw_images: colour as plain images; by default it stays compressed as it was recorded.
        on_progress: called with the time reached and that of the end, s.

    Raises:
        ConfigError: if something is there already, or the selection fits nothing.
    """
    wanted.check_begin(source.duration)
    clock = ManualClock(source.index.begin)
    bag = BagWriter(path, types_of(DISTRO), clock, lambda name: _fits(name, topics))
    try:
        exported = _Export(source, bag, clock, wanted, raw_images).run(on_progress)
        _check_topics(bag, topics)
        wanted.check_found()
        bag.finish()
        return exported
    finally:
        bag.close()


def _fits(name: str, topics: Collection[str]) -> bool:
    return not topics or any(fnmatchcase(name, pattern) for pattern in topics)


def _check_topics(bag: BagWriter, topics: Iterable[str]) -> None:
    for pattern in topics:
        if not any(fnmatchcase(name, pattern) for name in bag.topics):
            raise ConfigError(f"--topic {pattern}: no such topic; {suggest(pattern, bag.topics)}")


class _Export:
    """Walks through a recording, and lets each part of a bridge do its step after each message."""

    def __init__(
        self, source: ReplayedGraph, bag: BagWriter, clock: ManualClock, wanted: ExportSelection, raw: bool
    ) -> None:
        self._source, self._bag, self._clock, self._wanted, self._raw = source, bag, clock, wanted, raw
        self._tally = Tally(clock, _log)
        network = LocalNetwork(clock)
        self._network, self._bus, self._board = network, network.connect("recording"), network.connect("board")
        self._malformed = 0

    def run(self, on_progress: Callable[[float, float], None] | None) -> ExportedBag:
        """Write everything."""
        source, wanted = self._source, self._wanted
        source.restart()
        source.leap(wanted.since)
        while source.next_time < wanted.since:
            source.next()
        self._begin()
        end = min(wanted.until, source.duration)
        while source.next_time <= end:
            self._tell_beliefs(source.index.begin + source.next_time)
            record = source.next()
            assert record is not None
            self._clock.advance_to(max(self._clock.now(), source.index.begin + record.time))
            self._take(record)
            self._update(record.topic)
            if on_progress is not None:
                on_progress(record.time, end)
        self._tell_beliefs(source.index.begin + max(end, wanted.since) + _PERIOD)
        self._core.close()
        malformed = self._malformed + source.malformed + self._tally.counts["not sent"]
        return ExportedBag(dict(sorted(self._bag.counts.items())), source.problems, malformed, self._tally.told)

    def _begin(self) -> None:
        """Make the parts: they find in the graph all that is known at the beginning."""
        source, clock, tally = self._source, self._clock, self._tally
        clock.advance_to(max(clock.now(), source.index.begin + self._wanted.since))
        self._keys = Keys(source.memory.graph_name)
        self._core = core = _RecordedCore(
            source.memory, self._bag, types_of(DISTRO), FrameNames(), TimeSource(clock, "wall", tally), tally, clock,
            "", Turns(clock, _nothing), self._wanted.fits,
        )  # fmt: skip
        self._tf, self._joints, self._beliefs = TfOut(core, _SEND), JointsOut(core, _SEND), BeliefsOut(core, _SEND)
        self._events, self._frames = RecordedEventsOut(core, _SEND), FramesOut(core, raw=self._raw)
        self._diagnostics: DiagnosticsOut | None = None
        self._has_news, self._due = True, clock.now()
        self._tell_graph(clock.now())

    def _take(self, record: TimedRecord) -> None:
        try:
            if record.topic.startswith(BLOB):
                self._frames.send(record.topic, record.payload)
            elif record.topic.startswith(_STATUS):
                if self._diagnostics is None:
                    self._diagnostics = DiagnosticsOut(self._core, _SEND, self._board, self._keys)
                self._bus.publish(f"{self._keys.root}/{record.topic}", record.payload)
                self._network.deliver()
                self._events.note_status(record.payload, self._clock.now())
        except WireError:
            self._malformed += 1

    def _update(self, topic: str) -> None:
        now = self._clock.now()
        if topic == SNAPSHOT or topic.startswith(("d/", "rt/")):
            self._tell_graph(now)
            self._has_news = True
        if self._diagnostics is not None:
            self._diagnostics.update()

    def _tell_graph(self, now: float) -> None:
        self._tf.update()
        self._joints.update()
        self._events.update(now)

    def _tell_beliefs(self, now: float) -> None:
        """Send what is believed, if that is due until now (s) and there is any news."""
        if self._has_news and self._due <= now:
            self._clock.advance_to(max(self._clock.now(), self._due))
            self._beliefs.update()
            self._has_news, self._due = False, self._clock.now() + _PERIOD


def _nothing() -> None:
    """Nobody waits for a tick."""
