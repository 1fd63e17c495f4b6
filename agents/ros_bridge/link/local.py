"""A connection between nodes of one process, for tests and runs in lockstep: all happens within the caller's turn."""

from __future__ import annotations

import hashlib
from collections import deque
from collections.abc import Callable

from agents.ros_bridge.errors import RosAbsentError, RosLinkError
from agents.ros_bridge.link.link import Endpoint, Received, Topic
from agents.ros_bridge.messages.names import check_name
from agents.ros_bridge.messages.types import RosTypes, types_of
from dsr.clock import WALL_CLOCK, Clock

_GID_BYTES = 16


class LocalRos:
    """What `LocalLink`s of one process have in common: the topics and services."""

    def __init__(self, clock: Clock = WALL_CLOCK) -> None:
        self.clock = clock
        self.publishers: list[LocalPublisher] = []
        self.subscriptions: list[LocalSubscription] = []
        self.services: list[LocalServed] = []

    def matches(self, publisher: LocalPublisher, subscription: LocalSubscription) -> bool:
        """Whether what one sends reaches the other, by the rules of ROS."""
        ours, theirs = publisher.topic, subscription.topic
        return (
            publisher.link is not subscription.link
            and (ours.name, ours.type) == (theirs.name, theirs.type)
            and publisher.type_hash == subscription.type_hash
            and ours.qos.reliable >= theirs.qos.reliable
            and ours.qos.transient_local >= theirs.qos.transient_local
        )


class LocalPublisher:
    """Sends on one topic."""

    def __init__(self, link: LocalLink, topic: Topic, type_hash: str, writer: bytes) -> None:
        self.link, self.topic, self.type_hash, self.writer = link, topic, type_hash, writer
        self.kept: deque[Received] = deque(maxlen=max(topic.qos.depth, 1))
        """For late subscribers."""
        self._ros = link.ros
        self._ros.publishers.append(self)

    def send(self, cdr: bytes) -> None:
        """Send a message to all subscribers; raises `RosLinkError` after `close`."""
        if self not in self._ros.publishers:
            raise RosLinkError(f"the publisher of {self.topic.name} is closed")
        message = Received(cdr, self._ros.clock.now(), self.writer)
        if self.topic.qos.transient_local:
            self.kept.append(message)
        for subscription in self._subscriptions():
            subscription.receive(message)

    def subscribers(self) -> int:
        """How many subscribers elsewhere are visible."""
        return len(self._subscriptions())

    def close(self) -> None:
        """Take it back; harmless when repeated."""
        if self in self._ros.publishers:
            self._ros.publishers.remove(self)

    def _subscriptions(self) -> list[LocalSubscription]:
        return [found for found in self._ros.subscriptions if self._ros.matches(self, found)]


class LocalSubscription:
    """Calls back with what is sent on one topic."""

    def __init__(self, link: LocalLink, topic: Topic, type_hash: str, receive: Callable[[Received], None]) -> None:
        self.link, self.topic, self.type_hash, self.receive = link, topic, type_hash, receive
        self._ros = link.ros
        self._ros.subscriptions.append(self)
        if topic.qos.transient_local:
            for publisher in self._ros.publishers:
                if self._ros.matches(publisher, self):
                    for message in list(publisher.kept)[-topic.qos.depth :]:
                        receive(message)

    def publishers(self) -> int:
        """How many publishers elsewhere it hears."""
        return sum(self._ros.matches(publisher, self) for publisher in self._ros.publishers)

    def close(self) -> None:
        """Take it back; harmless when repeated."""
        if self in self._ros.subscriptions:
            self._ros.subscriptions.remove(self)


class LocalServed:
    """Answers requests to one service."""

    def __init__(self, link: LocalLink, topic: Topic, type_hash: str, answer: Callable[[bytes], bytes]) -> None:
        self.link, self.topic, self.type_hash, self.answer = link, topic, type_hash, answer
        self._ros = link.ros
        self._ros.services.append(self)

    def close(self) -> None:
        """Take it back; harmless when repeated."""
        if self in self._ros.services:
            self._ros.services.remove(self)


class LocalLink:
    """One node; implements `agents.ros_bridge.link.link.RosLink`.

    Args:
        ros: what the nodes that are to hear each other have in common.
        node: full name of the node, for example `/dsr_bridge`.
        distro: release of ROS 2 whose types it knows.
        any_names: whether topics may have names that ROS 2 has not, as in bags of ROS 1.
    """

    def __init__(self, ros: LocalRos, node: str, distro: str = "jazzy", *, any_names: bool = False) -> None:
        self.ros = ros
        self._any_names = any_names
        self._node = check_name(node)
        self._types: RosTypes = types_of(distro)
        self._made = 0
        self._declared: list[LocalPublisher | LocalSubscription | LocalServed] = []
        self._closed = False

    def publisher(self, topic: Topic) -> LocalPublisher:
        """Announce a publisher. Raises `RosMessageError` for a type that is not known."""
        hash = self._check(topic)
        self._made += 1
        writer = hashlib.sha256(f"{self._node} {self._made}".encode()).digest()[:_GID_BYTES]
        self._declared.append(made := LocalPublisher(self, topic, hash, writer))
        return made

    def subscribe(self, topic: Topic, receive: Callable[[Received], None]) -> LocalSubscription:
        """Call `receive` with each message. Raises `RosMessageError` for a type that is not known."""
        self._declared.append(made := LocalSubscription(self, topic, self._check(topic), receive))
        return made

    def endpoints(self) -> list[Endpoint]:
        """All that is visible, this link's own included."""
        ros, found = self.ros, []
        for publisher in ros.publishers:
            of = publisher.link
            hash, mine = publisher.type_hash, of is self
            found.append(Endpoint("publisher", of._node, publisher.topic, hash, mine, publisher.writer))
        for subscription in ros.subscriptions:
            of = subscription.link
            found.append(Endpoint("subscriber", of._node, subscription.topic, subscription.type_hash, of is self))
        for served in ros.services:
            of = served.link
            found.append(Endpoint("service", of._node, served.topic, served.type_hash, of is self))
        return found

    def serve(self, name: str, type: str, answer: Callable[[bytes], bytes]) -> LocalServed:
        """Answer requests to a service."""
        topic = Topic(name, type)
        self._declared.append(made := LocalServed(self, topic, self._check(topic), answer))
        return made

    def prepare(self, name: str, type: str) -> None:
        """Nothing: all is there."""

    def call(self, name: str, type: str, request: bytes, timeout: float) -> bytes:
        """Ask a service. Errors as of `RosLink.call`; what the server raises is a refusal."""
        self._check(Topic(name, type))
        for served in self.ros.services:
            if (served.topic.name, served.topic.type) == (name, type):
                try:
                    return served.answer(request)
                except Exception as error:
                    raise RosLinkError(f"{name} refused: {error}") from error
        raise RosAbsentError(f"nobody serves {name} ({type}) within {timeout:g} s")

    def problems(self) -> list[str]:
        """Nothing: within a process, all arrives."""
        return []

    def lost(self) -> dict[str, int]:
        """Nothing."""
        return {}

    def unauthenticated(self) -> list[str]:
        """Nobody: all is of this process."""
        return []

    def close(self) -> None:
        """Take all back and leave; harmless when repeated."""
        self._closed = True
        for one in self._declared:
            one.close()

    def _check(self, topic: Topic) -> str:
        if self._closed:
            raise RosLinkError("the connection to ROS is closed")
        if not self._any_names:
            check_name(topic.name)
        return self._types.hash(topic.type)
