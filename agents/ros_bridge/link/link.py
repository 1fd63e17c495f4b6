"""The interface of a connection to ROS 2: topics, services and what is visible, as CDR whatever the transport.

Names of topics and services are absolute (`/tf`). Types are named as in ROS 2 (`tf2_msgs/msg/TFMessage`,
`std_srvs/srv/Trigger`). A message in CDR begins with its encapsulation header of 4 bytes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, Protocol

import msgspec


class Qos(msgspec.Struct, frozen=True):
    """Quality of service, as far as publishers and subscribers must agree on it."""

    reliable: bool = True
    """Lost messages are sent again; a reliable subscriber hears no publisher that is not."""
    transient_local: bool = False
    """Who subscribes late gets the newest `depth` messages of each publisher (latched, as `/tf_static`)."""
    depth: int = 10
    """Messages that are kept."""


class Topic(msgspec.Struct, frozen=True):
    """A topic or service with its type."""

    name: str
    """Absolute, for example `/tf`"""
    type: str
    """For example `tf2_msgs/msg/TFMessage`"""
    qos: Qos = Qos()


class Received(msgspec.Struct, frozen=True):
    """A message as it arrived."""

    cdr: bytes | memoryview
    sent: float | None
    """s since the Unix epoch, of the writer's clock, when it was sent; None if the transport does not tell"""
    writer: bytes
    """16 bytes that name the publisher (its gid); empty if the transport does not tell"""


class Endpoint(msgspec.Struct, frozen=True):
    """A publisher, subscriber, service or client that is visible."""

    kind: Literal["publisher", "subscriber", "service", "client"]
    node: str
    """Full name of its node, for example `/camera/driver`; empty if the transport does not tell"""
    topic: Topic
    type_hash: str
    """`RIHS01_...`; empty if it is not told"""
    mine: bool
    """Made by this link."""
    gid: bytes = b""
    """16 bytes, `Received.writer` of what a publisher sends; empty if the transport does not tell"""


class RosSubscription(Protocol):
    """A subscription that can be taken back."""

    def publishers(self) -> int:
        """How many publishers elsewhere it hears."""

    def close(self) -> None:
        """Take it back; harmless when repeated."""


class Served(Protocol):
    """A service that can be taken back."""

    def close(self) -> None:
        """Take it back; harmless when repeated."""


class Publisher(Protocol):
    """Sends on one topic."""

    writer: bytes
    """16 bytes that name this publisher to others (its gid); empty if the transport has none"""

    def send(self, cdr: bytes) -> None:
        """Send a message to all subscribers; raises `RosLinkError` after `close`."""

    def subscribers(self) -> int:
        """How many subscribers elsewhere are visible."""

    def close(self) -> None:
        """Take it back; harmless when repeated."""


class RosLink(Protocol):
    """A connection to ROS 2 as one node. It hears nothing of what it sends itself."""

    def publisher(self, topic: Topic) -> Publisher:
        """Announce a publisher. Raises `RosMessageError` for a type that is not known."""

    def subscribe(self, topic: Topic, receive: Callable[[Received], None]) -> RosSubscription:
        """Call `receive` with each message, from a thread of the link: it must not block.

        Raises `RosMessageError` for a type that is not known.
        """

    def endpoints(self) -> list[Endpoint]:
        """All that is visible, this link's own included."""

    def serve(self, name: str, type: str, answer: Callable[[bytes], bytes]) -> Served:
        """Answer requests to a service; `answer` maps a request to a response, and is called from a thread."""

    def prepare(self, name: str, type: str) -> None:
        """Begin to look for the server of a service that will be asked: the first answer comes sooner then."""

    def call(self, name: str, type: str, request: bytes, timeout: float) -> bytes:
        """Ask a service and wait at most `timeout` s for its response.

        Raises:
            RosAbsentError: if nobody serves it.
            RosTimeoutError: if no response came.
            RosLinkError: if the transport has no services, or the server refused.
        """

    def problems(self) -> list[str]:
        """Sentences that tell why messages may not arrive, such as that no router is reached; empty if all is well."""

    def lost(self) -> dict[str, int]:
        """Messages by topic, since the connection was made, that were sent and did not arrive; of those counted."""

    def unauthenticated(self) -> list[str]:
        """Who may speak to us without proving who they are, in sentences."""

    def close(self) -> None:
        """Take all back and leave; harmless when repeated."""


class LinkConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How ROS 2 is reached."""

    transport: Literal["zenoh", "dds"] = "zenoh"
    """`zenoh` speaks with nodes under `rmw_zenoh_cpp`, `dds` with those under any DDS."""
    domain: int = 0
    """`ROS_DOMAIN_ID` of the robot"""
    distro: str = "jazzy"
    """Release of ROS 2 whose message definitions are used"""
    router: str = "tcp/localhost:7447"
    """Zenoh router of the robot; for `zenoh` only"""
    beyond_loopback: bool = False
    """Speak with other machines. What arrives from ROS is not authenticated."""
    installed_ros: str = ""
    """For `dds` only: the robot's ROS, which asks its services and actions. A `setup.bash`, or a Python with rclpy"""
