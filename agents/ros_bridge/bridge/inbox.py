"""Messages of one topic that wait for the bridge's next tick: bounded in number and in bytes, the newest win."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Container
from typing import NamedTuple

from agents.ros_bridge.bridge.tally import Tally
from agents.ros_bridge.link.link import Received, RosLink, Topic
from agents.ros_bridge.mapping.clouds import CLOUD
from agents.ros_bridge.mapping.images import COMPRESSED, IMAGE
from dsr.clock import Clock

_MOST_BYTES = 1 << 26
"""bytes of one topic of images or clouds that wait: two images of 8 megapixels"""
_MOST_SMALL_BYTES = 1 << 22
"""bytes of any other topic that wait: 40 000 transforms, more than any robot sends in a tick, and read in a second"""
_LARGE = (IMAGE, COMPRESSED, CLOUD)
"""Types of messages that are large, and read as one array"""


class Arrived(NamedTuple):
    """A message, and when it came."""

    cdr: bytes | memoryview
    writer: bytes
    """Gid of its publisher; empty if it is not known"""
    at: float
    """s, time of arrival by the agent's clock"""


class RosInbox:
    """Collects what others send on one topic, until it is taken.

    Args:
        link: the connection.
        topic: with its type.
        most: messages that wait; of images one is enough.
        clock: the agent's.
        tally: counts what is dropped.
        own: gids of the bridge's own publishers, which are not heard.
        notify: called in a thread of the link when something came; it returns at once.
    """

    def __init__(
        self, link: RosLink, topic: Topic, most: int, clock: Clock, tally: Tally, own: Container[bytes],
        notify: Callable[[], None],
    ) -> None:  # fmt: skip
        self.topic = topic
        self._most = most
        self._most_bytes = _MOST_BYTES if topic.type in _LARGE else _MOST_SMALL_BYTES
        self._clock = clock
        self._tally = tally
        self._own = own
        self._notify = notify
        self._waiting: deque[Arrived] = deque()
        self._bytes = 0
        self._lock = threading.Lock()
        self._subscription = link.subscribe(topic, self._receive)

    def take(self) -> list[Arrived]:
        """Return all messages since the last call, in the order in which they came."""
        with self._lock:
            taken, self._waiting, self._bytes = list(self._waiting), deque(), 0
        if taken:
            self._tally.count(f"from {self.topic.name}", len(taken))
        return taken

    def close(self) -> None:
        """Stop collecting."""
        self._subscription.close()

    def _receive(self, message: Received) -> None:
        size = len(message.cdr)
        if message.writer and message.writer in self._own:
            return
        if size > self._most_bytes:
            self._tally.tell(
                "too large", self.topic.name, f"a message of {size} bytes on {self.topic.name} was dropped"
            )
            return
        with self._lock:
            self._waiting.append(Arrived(message.cdr, message.writer, self._clock.now()))
            self._bytes += size
            while len(self._waiting) > self._most or self._bytes > self._most_bytes:
                self._bytes -= len(self._waiting.popleft().cdr)
                self._tally.count(f"passed over on {self.topic.name}")
        self._notify()
