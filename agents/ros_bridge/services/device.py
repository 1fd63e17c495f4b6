"""What drivers of devices behind ROS have in common: a connection of their own, inboxes, counts, stamps."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

from agents.ros_bridge.bridge.inbox import RosInbox
from agents.ros_bridge.bridge.tally import Tally
from agents.ros_bridge.bridge.times import MOST_AHEAD, MOST_BEHIND
from agents.ros_bridge.link.link import LinkConfig, Qos, RosLink, Topic
from agents.ros_bridge.link.opening import open_link
from agents.ros_bridge.messages.types import RosTypes, types_of
from dsr.clock import WALL_CLOCK, Clock
from dsr.config.toml import convert

_log = logging.getLogger("dsr.ros")


class RosDevice:
    """Base of the drivers; the options `link` and `restamp` are those of the bridge.

    Args:
        node: full name of the driver's node in ROS.
        link: options of `LinkConfig`.
        restamp: take the time of arrival for the stamps of ROS.
    """

    connect: ClassVar[Callable[[LinkConfig, str], RosLink]] = staticmethod(open_link)
    """Opens the connection to ROS."""
    clock: ClassVar[Clock] = WALL_CLOCK

    def __init__(self, node: str, link: Mapping[str, Any], restamp: bool) -> None:
        config = convert(dict(link), LinkConfig, f"connection of {node}")
        self.types: RosTypes = types_of(config.distro)
        self.tally = Tally(self.clock, _log)
        """What is counted and told."""
        self.link: RosLink = type(self).connect(config, node)
        self._restamp = restamp

    def inbox(self, name: str, type: str, most: int, qos: Qos) -> RosInbox:
        """Listen to a topic."""
        return RosInbox(self.link, Topic(name, type, qos), most, self.clock, self.tally, (), _nothing)

    def stamp(self, told: float, arrival: float) -> float | None:
        """The stamp (s) of a sample; None, and told, for one from the future; told only, for one of long ago."""
        if told == 0.0 or self._restamp:
            return arrival
        ahead = told - self.clock.now()
        if ahead > MOST_AHEAD:
            text = f"a sample is stamped {ahead:.1f} s ahead of our clock: set the clocks, or `restamp = true`"
            self.tally.tell("from the future", "", text)
            return None
        if ahead < -MOST_BEHIND:
            text = f"a sample is stamped {-ahead:.1f} s behind our clock: set the clocks, or `restamp = true`"
            self.tally.tell("from the past", "", text)
        return told

    def close(self) -> None:
        """Leave ROS; harmless when repeated."""
        self.link.close()


def _nothing() -> None:
    """Nobody waits: drivers are asked once a tick."""
