"""A camera of a bag, as a driver: agents that are at work see what somebody else's camera saw, as if it were now."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar

import msgspec

from agents.ros_bridge.bags.reader import Bag, BagMessage
from agents.ros_bridge.bags.topics import cameras_of
from agents.ros_bridge.bridge.camera_source import CameraSource
from agents.ros_bridge.bridge.config import RosCameraTopics, camera_topics
from agents.ros_bridge.bridge.inbox import RosInbox
from agents.ros_bridge.bridge.tally import Tally
from agents.ros_bridge.link.link import Qos, Topic
from agents.ros_bridge.link.local import LocalLink, LocalPublisher, LocalRos
from agents.ros_bridge.messages.types import types_of
from dsr.clock import WALL_CLOCK, Clock
from dsr.errors import ConfigError
from dsr.images.blobs import Frame
from dsr.network.keys import Keys
from dsr.network.transport import Transport

_DISTRO = "jazzy"
_RELIABLE = Qos(depth=5)
_GAP = 0.1
"""s between the last image of a bag and the first one of the next round"""
_log = logging.getLogger("dsr.ros")


class BagCamera:
    """A `CameraDriver`. Stamps are moved, so that the bag begins when the driver is made.

    Args:
        bus: not used; drivers are made with it.
        keys: not used either.
        name: nor is that.
        bag: path of the bag, see `Bag`.
        color: topic of colour, see `RosCameraTopics`; without any topic, the only camera of the bag.
        depth: topic of depth.
        info: topic of CameraInfo.
        depth_info: topic of CameraInfo of depth that is not aligned with colour, see `RosCameraTopics`.
        depth_pose: `translation` and `rotation` of that depth's camera.
        begin: s since the bag's first message, where to start.
        speed: seconds of the bag a second.
        loop: begin again at the end; otherwise nothing comes any more.
        restamp: take the time at which an image was recorded for its stamp: for a bag with wrong stamps.

    Raises:
        RecordingError: if the bag cannot be read.
        ConfigError: for a topic that is not there, or if none is named and the bag has several cameras.
    """

    clock: ClassVar[Clock] = WALL_CLOCK

    def __init__(
        self, bus: Transport, keys: Keys, name: str = "bag", *, bag: str, color: str = "", depth: str = "",
        info: str = "", depth_info: str = "", depth_pose: Mapping[str, Any] | None = None, begin: float = 0.0,
        speed: float = 1.0, loop: bool = True, restamp: bool = False,
    ) -> None:  # fmt: skip
        if not (math.isfinite(speed) and speed > 0.0):
            raise ConfigError(f"speed {speed}: expected a positive number")
        types = types_of(_DISTRO)
        self._bag = Bag(Path(bag), types)
        if not 0.0 <= begin < max(self._bag.end - self._bag.begin, math.ulp(0.0)):
            raise ConfigError(f"begin {begin}: expected 0 to {self._bag.end - self._bag.begin:.1f} s, where {bag} ends")
        beside = depth_info, depth_pose
        topics = camera_topics(color, depth, info, *beside) if color or depth else _only_camera(self._bag)
        names = [name for name in (topics.color, topics.depth, topics.info, topics.depth_info) if name]
        self._names = [self._bag.topic(name).name for name in names]
        if not topics.info and topics.info_topic in self._bag.topics:
            self._names.append(self._bag.topic(topics.info_topic).name)
        self._from, self._speed, self._loop, self._restamp = self._bag.begin + begin, speed, loop, restamp
        self._started = self.clock.now()
        self._messages: Iterator[BagMessage] = iter(())
        self._next: BagMessage | None = None
        self.tally = Tally(self.clock, _log)
        """What is counted and told."""
        ros = LocalRos(self.clock)
        player, hearer = (LocalLink(ros, node, any_names=True) for node in ("/bag", "/camera"))

        def inbox(name: str, type: str, most: int, qos: Qos) -> RosInbox:
            return RosInbox(hearer, Topic(name, type, qos), most, self.clock, self.tally, (), _nothing)

        self._publishers: dict[str, LocalPublisher] = {
            name: player.publisher(Topic(name, self._bag.topics[name].type, _RELIABLE)) for name in self._names
        }
        self._source = CameraSource(topics, inbox, types, self._stamp, self.tally)
        if topics.info_topic in self._publishers:  # it may come once, at the bag's beginning
            self._publish(next(self._bag.messages([topics.info_topic]), None))
        self._rewind()

    @property
    def trouble(self) -> str:
        """What was wrong lately, in words; empty if nothing was."""
        return self.tally.trouble

    @property
    def counts(self) -> Mapping[str, int]:
        """What is counted of that, by name."""
        return self.tally.counts

    def frame(self) -> Frame | None:
        """The newest frame if it was not returned before, else None."""
        now = self.clock.now()
        if self._next is None and self._loop and now >= self._time_of(self._bag.end) + _GAP:
            self._started = now
            self._rewind()
        while self._next is not None and self._time_of(self._next.time) <= now:
            self._publish(self._next)
            self._next = next(self._messages, None)
        return self._source.frame()

    def close(self) -> None:
        """Read no more; harmless when repeated."""
        self._next, self._messages, self._loop = None, iter(()), False
        self._source.close()

    def _rewind(self) -> None:
        self._messages = self._bag.messages(self._names, self._from)
        self._next = next(self._messages, None)

    def _publish(self, message: BagMessage | None) -> None:
        if message is not None:
            self._publishers[message.topic].send(message.cdr)

    def _time_of(self, recorded: float) -> float:
        """Our time (s) at which something of the bag is due."""
        return self._started + (recorded - self._from) / self._speed

    def _stamp(self, told: float, arrival: float) -> float:
        return arrival if self._restamp or told == 0.0 else self._time_of(told)


def _only_camera(bag: Bag) -> RosCameraTopics:
    """The camera of a bag that has one. Raises `ConfigError`."""
    cameras = cameras_of(bag, types_of(_DISTRO))
    if len(cameras) != 1:
        known = ", ".join(name for topics in cameras.values() for kind, name in topics.items() if kind != "info")
        raise ConfigError(
            f"{bag.path}: which camera? Name its topics, `color` and `depth`; there are: {known or 'no images'}"
        )
    return msgspec.convert(next(iter(cameras.values())), RosCameraTopics)


def _nothing() -> None:
    """Nobody waits: drivers are asked once a tick."""
