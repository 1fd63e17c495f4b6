"""What the parts of the bridge have in common: the memory, the connection, names, times, counts and own publishers."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import msgspec

from agents.ros_bridge.bridge.frame_nodes import FrameNodes
from agents.ros_bridge.bridge.inbox import RosInbox
from agents.ros_bridge.bridge.tally import Tally
from agents.ros_bridge.bridge.times import TimeSource
from agents.ros_bridge.bridge.turns import Turns
from agents.ros_bridge.errors import RosError, RosLinkError
from agents.ros_bridge.link.link import Publisher, Qos, RosLink, Topic
from agents.ros_bridge.mapping.names import FrameNames
from agents.ros_bridge.messages.types import RosTypes
from dsr.clock import Clock
from dsr.crdt.delta import Write
from dsr.graph.elements import Edge, Node
from dsr.graph.shares import makers
from dsr.memory import Memory
from dsr.network.keys import agent_of

SENSOR = Qos(reliable=False, depth=5)
"""Of subscriptions to sensors: hears reliable publishers and others"""
LATCHED = Qos(transient_local=True, depth=1)
"""Of what late subscribers get, too"""


class BridgeCore:
    """Made once by the agent, and given to each part."""

    def __init__(
        self, memory: Memory, link: RosLink, types: RosTypes, names: FrameNames, times: TimeSource, tally: Tally,
        clock: Clock, agent: str, turns: Turns,
        wants: Callable[[Iterable[str]], bool] = lambda names: True,
    ) -> None:  # fmt: skip
        self.memory, self.link, self.types, self.names = memory, link, types, names
        self.times, self.tally, self.clock = times, tally, clock
        self.frames = FrameNodes(memory)
        self.turns = turns
        """Asks for a tick soon, or lets a thread of the connection work between two."""
        self.wants = wants
        """Whether what is about nodes of these names is sent"""
        self.own: set[bytes] = set()
        """Gids of our publishers"""
        self._agent = agent
        self._closers: dict[Callable[[], None], None] = {}

    def inbox(
        self, name: str, type: str, most: int, qos: Qos = SENSOR, take: Callable[[], None] | None = None
    ) -> RosInbox:
        """Listen to a topic. Raises `RosMessageError` for a name or type that there is not.

        What comes waits for a tick, or for `take`, which is called between two ticks if there is time.
        """
        qos = msgspec.structs.replace(qos, depth=max(qos.depth, most))  # what may wait for a tick may wait before, too
        turns = self.turns
        notify = turns.notify if take is None else lambda: turns.do_now(take)
        inbox = RosInbox(self.link, Topic(name, type, qos), most, self.clock, self.tally, self.own, notify)
        self.on_close(inbox.close)
        return inbox

    def outlet(self, name: str, type: str, qos: Qos | None = None) -> RosOutlet:
        """Publish on a topic. Raises `RosMessageError` for a name or type that there is not."""
        publisher = self.link.publisher(Topic(name, type, qos or Qos()))
        self.own.add(publisher.writer)
        self.on_close(publisher.close)
        return RosOutlet(self, publisher, name, type)

    def on_close(self, close: Callable[[], None]) -> None:
        """Call `close` in the end, unless that is taken back (`forget`)."""
        self._closers[close] = None

    def forget(self, close: Callable[[], None]) -> None:
        """Do not call `close` in the end any more: it has been done."""
        self._closers.pop(close, None)

    def close(self) -> None:
        """Take all back, last one first."""
        while self._closers:
            self._closers.popitem()[0]()

    def came_from_ros(self, element: Node | Edge, attribute: str) -> bool:
        """Whether a bridge of our name wrote the present value, now or in an earlier life: it is not sent back."""
        write = element.newest_write(attribute)
        return write is not None and self.is_of_bridge(write)

    def is_made_by_bridge(self, element: Node | Edge) -> bool:
        """Whether a bridge of our name made this element, now or in an earlier life."""
        return self._agent in makers(element)

    def is_of_bridge(self, write: Write) -> bool:
        """Whether a bridge of our name made this write, now or in an earlier life."""
        return agent_of(write.writer) == self._agent


class RosOutlet:
    """Sends messages on one topic; what cannot be sent is counted and told, and nothing waits for it."""

    def __init__(self, core: BridgeCore, publisher: Publisher, name: str, type: str) -> None:
        self._core, self._publisher, self._name, self._type = core, publisher, name, type

    @property
    def wanted(self) -> bool:
        """Whether anybody is there to hear it."""
        return self._publisher.subscribers() > 0

    def send(self, make: Callable[[], Any]) -> None:
        """Make a message and send it; one that ROS cannot express is counted and told."""
        try:
            self.send_cdr(self._core.types.encode(self._type, make()))
        except RosError as error:
            self._core.tally.tell("not sent", self._name, f"a message on {self._name} was not sent: {error}")

    def send_cdr(self, cdr: bytes) -> None:
        """Send an encoded message."""
        try:
            self._publisher.send(cdr)
            self._core.tally.count(f"to {self._name}")
        except RosLinkError as error:
            self._core.tally.tell("not sent", self._name, f"a message on {self._name} was not sent: {error}")

    def close(self) -> None:
        """Publish no more."""
        self._core.own.discard(self._publisher.writer)
        self._core.forget(self._publisher.close)
        self._publisher.close()
