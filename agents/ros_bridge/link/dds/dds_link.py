"""A connection to nodes under DDS (Fast DDS, Cyclone DDS, ...): topics, and services by an installed ROS."""

from __future__ import annotations

import logging
import threading
from collections import Counter
from collections.abc import Callable
from typing import Any

from cyclonedds.core import (
    DDSException,
    GuardCondition,
    InstanceState,
    Listener,
    ReadCondition,
    SampleState,
    ViewState,
    WaitSet,
)
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic as DdsTopic
from cyclonedds.util import duration

from agents.ros_bridge.errors import RosLinkError
from agents.ros_bridge.link.dds.discovery import DdsDiscovery, dds_qos
from agents.ros_bridge.link.dds.installed_ros import InstalledRos, services_node
from agents.ros_bridge.link.dds.participant import join
from agents.ros_bridge.link.dds.raw_type import RawMessage, raw_type
from agents.ros_bridge.link.dds.returned import Returned
from agents.ros_bridge.link.link import Endpoint, LinkConfig, Received, Served, Topic
from agents.ros_bridge.link.telling import Lately, few
from agents.ros_bridge.messages.names import check_name
from agents.ros_bridge.messages.types import RosTypes, types_of
from dsr.clock import WALL_CLOCK
from dsr.threads import new_thread

_log = logging.getLogger("dsr.ros")

_MOST_AT_ONCE = 64
"""Messages that are taken out of DDS in one turn"""
_MOST_WRITERS = 1000
"""Publishers whose gids are remembered for one subscription"""
_PATIENCE = 2.0  # s
_FOREVER = duration(days=3650)
_ANY = SampleState.Any | ViewState.Any | InstanceState.Any
_NOT_SERVED = "services are served over rmw_zenoh only: vendors of DDS do not understand each other's requests"
_NOT_ASKED = (
    "vendors of DDS do not understand each other's requests; set installed_ros to the setup.bash of the robot's ROS, "
    "or use rmw_zenoh"
)


class DdsPublisher:
    """Sends on one topic."""

    def __init__(self, participant: DomainParticipant, topic: DdsTopic[Any], qos: Any, name: str) -> None:
        self._name = name
        self._writer: DataWriter[Any] | None = DataWriter(participant, topic, qos)
        self.writer = self._writer.guid.bytes

    @property
    def closed(self) -> bool:
        """Whether it was taken back."""
        return self._writer is None

    def send(self, cdr: bytes) -> None:
        """Send a message to all subscribers; raises `RosLinkError` after `close`, or if a slow one holds it up 1 s."""
        writer = self._writer
        if writer is None:
            raise RosLinkError(f"the publisher of {self._name} is closed")
        try:
            writer.write(writer.topic.data_type(cdr))
        except DDSException as error:
            raise RosLinkError(f"cannot publish on {self._name}: {error}") from error

    def subscribers(self) -> int:
        """How many subscribers elsewhere are visible."""
        return len(self._writer.get_matched_subscriptions()) if self._writer is not None else 0

    def close(self) -> None:
        """Take it back; harmless when repeated."""
        self._writer = None


class _Arrivals(Listener):  # type: ignore[misc]
    """Counts, in threads of DDS, what is put into a reader: Cyclone DDS has no status for what is overwritten there.

    A publisher that leaves counts as a message as well, unless others of the topic stay.
    """

    def __init__(self) -> None:
        super().__init__()
        self._lock = threading.Lock()
        self.came = 0
        self.left = 0
        """Publishers that left"""

    def on_data_available(self, reader: DataReader[Any]) -> None:
        """Called by DDS for each message."""
        with self._lock:
            self.came += 1

    def on_subscription_matched(self, reader: DataReader[Any], status: Any) -> None:
        """Called by DDS for each publisher that comes or goes."""
        with self._lock:
            self.left += max(-status.current_count_change, 0)


class DdsSubscription:
    """Calls back with what comes on one topic, from a thread of its own.

    DDS keeps the newest messages for this thread, as many as the depth of its QoS. Older ones are overwritten, and
    counted. Those that are lost on the way are not: Cyclone DDS does not tell, and its `sample_lost` stays 0 for them.
    """

    def __init__(
        self, participant: DomainParticipant, topic: DdsTopic[Any], qos: Any, name: str,
        receive: Callable[[Received], None],
    ) -> None:  # fmt: skip
        self.name = name
        self.failures = 0
        """Messages that `receive` raised an exception for."""
        self._receive = receive
        self._writers: dict[int, bytes] = {}
        self._arrivals = _Arrivals()
        self._taken = self._not_taken = self._missing = self._lost = 0
        self._reader: DataReader[Any] | None = DataReader(participant, topic, qos, listener=self._arrivals)
        self.gid = self._reader.guid.bytes
        self._stop = GuardCondition(participant)
        self._wait = WaitSet(participant)
        self._wait.attach(self._stop)
        self._wait.attach(ReadCondition(self._reader, _ANY))
        self._thread = new_thread(self._run, f"ros-sub-{name}")
        self._thread.start()

    @property
    def closed(self) -> bool:
        """Whether it was taken back."""
        return self._reader is None

    def publishers(self) -> int:
        """How many publishers elsewhere it hears."""
        return len(self._reader.get_matched_publications()) if self._reader is not None else 0

    @property
    def lost(self) -> int:
        """Messages that came too fast and were overwritten, as far as two looks in a row agree on them.

        DDS tells a moment later that a publisher left. One too few is counted for each that left while others stayed.
        """
        before, self._missing = self._missing, self._not_taken - self._arrivals.left
        self._lost = max(self._lost, min(before, self._missing))
        return self._lost

    def close(self) -> None:
        """Take it back; harmless when repeated. From another thread than that of `receive`, it waits for that one."""
        if self._reader is not None:
            self._reader = None
            self._stop.set(True)
        if self._thread is not threading.current_thread():
            self._thread.join(_PATIENCE)

    def _run(self) -> None:
        while (reader := self._reader) is not None:
            self._wait.wait(_FOREVER)
            came, messages = -1, list[Any]()
            while self._reader is not None and (messages or came != self._arrivals.came):
                came = self._arrivals.came
                messages = [message for message in reader.take(N=_MOST_AT_ONCE) if getattr(message, "cdr", b"")]
                self._taken += len(messages)
                for message in messages:
                    if self._reader is not None:
                        self._pass_on(reader, message)
            self._not_taken = came - self._taken

    def _pass_on(self, reader: DataReader[Any], message: RawMessage) -> None:
        info = message.sample_info
        writer = self._writers.get(info.publication_handle)
        if writer is None:
            if len(self._writers) >= _MOST_WRITERS:
                self._writers.clear()
            writer = self._writers[info.publication_handle] = _gid(reader, info.publication_handle)
        try:
            self._receive(Received(message.cdr, info.source_timestamp / 1e9, writer))
        except Exception:
            self.failures += 1
            if self.failures == 1:
                _log.exception("a message of %s could not be handled", self.name)


class DdsLink:
    """One node in a DDS domain; implements `agents.ros_bridge.link.link.RosLink`, and serves nothing.

    Args:
        config: which domain and release of ROS 2.
        node: full name of the node, for example `/dsr_bridge`.

    Raises:
        RosLinkError: if the domain cannot be joined, or the installed ROS does not start.
    """

    def __init__(self, config: LinkConfig, node: str) -> None:
        self._types: RosTypes = types_of(config.distro)
        self._config = config
        self._node = check_name(node)
        self._participant: DomainParticipant | None = join(config)
        self._installed: InstalledRos | None = None
        self._lock = threading.Lock()
        self._topics: dict[tuple[str, str], DdsTopic[Any]] = {}
        self._publishers: list[DdsPublisher] = []
        self._subscriptions: list[DdsSubscription] = []
        self._lately = Lately()
        self._lost_before: Counter[str] = Counter()
        """By topic, of subscriptions that were taken back"""
        self._discovery: DdsDiscovery | None = DdsDiscovery(self._participant, node, self._types)
        self._returned: Returned | None = Returned(self._discovery)
        self._tell()
        if config.installed_ros:
            try:
                self._installed = InstalledRos(config, node)
            except RosLinkError:
                self.close()
                raise

    def publisher(self, topic: Topic) -> DdsPublisher:
        """Announce a publisher. Raises `RosMessageError` for a type that is not known."""
        participant, dds_topic, qos = self._prepared(topic)
        publisher = DdsPublisher(participant, dds_topic, qos, topic.name)
        self._publishers.append(publisher)
        self._tell()
        return publisher

    def subscribe(self, topic: Topic, receive: Callable[[Received], None]) -> DdsSubscription:
        """Call `receive` with each message, from a thread. Raises `RosMessageError` for a type that is not known."""
        participant, dds_topic, qos = self._prepared(topic)
        subscription = DdsSubscription(participant, dds_topic, qos, topic.name, receive)
        self._subscriptions.append(subscription)
        self._tell()
        return subscription

    def endpoints(self) -> list[Endpoint]:
        """All that is visible, this link's own included."""
        discovery = self._discovery
        return [] if discovery is None else discovery.endpoints()

    def serve(self, name: str, type: str, answer: Callable[[bytes], bytes]) -> Served:
        """Not over DDS: raises `RosLinkError`."""
        raise RosLinkError(f"{name} cannot be served: {_NOT_SERVED}")

    def prepare(self, name: str, type: str) -> None:
        """Begin to look for the server of a service, if there is an installed ROS."""
        if self._installed is not None:
            self._installed.prepare(name, type)

    def call(self, name: str, type: str, request: bytes, timeout: float) -> bytes:
        """Ask by the installed ROS; raises `RosLinkError` if none is configured."""
        if self._installed is None:
            raise RosLinkError(f"{name} cannot be asked: {_NOT_ASKED}")
        return self._installed.call(name, type, request, timeout)

    def problems(self) -> list[str]:
        """Sentences that tell why messages may not arrive; empty if all is well."""
        endpoints = self.endpoints()
        found = set()
        ours = services_node(self._node)
        if all(endpoint.mine or endpoint.node == ours for endpoint in endpoints):
            reach = "anywhere" if self._config.beyond_loopback else "on this machine"
            found.add(
                f"nobody is visible {reach} in DDS domain {self._config.domain}: compare ROS_DOMAIN_ID, and start the "
                "robot's nodes with ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST or SUBNET"
            )
        for mine in (endpoint for endpoint in endpoints if endpoint.mine):
            for other in endpoints:
                if not other.mine and other.topic.name == mine.topic.name and (reason := _mismatch(mine, other)):
                    found.add(
                        f"{other.node or 'somebody'} has {other.topic.name} {reason}: they do not hear each other"
                    )
        found.update(self._deaf())
        failures = [one for one in self._subscriptions if self._lately.grew(id(one), one.failures)]
        if self._installed is not None:
            found.update(self._installed.problems())
        return [*few(found), *(f"{one.failures} messages of {one.name} could not be handled" for one in failures)]

    def _deaf(self) -> list[str]:
        """Of nodes that came back and tell nothing."""
        returned, discovery = self._returned, self._discovery
        if returned is None or discovery is None:
            return []
        return [
            f"{', '.join(discovery.nodes_of(guid)) or 'a node'} stood still for so long that DDS gave it up, and tells "
            "nothing since: start it anew, or start this process anew"
            for guid in returned.deaf(WALL_CLOCK.monotonic())
        ]

    def lost(self) -> dict[str, int]:
        """Messages by topic that came too fast; of what is lost on the way, DDS does not say anything."""
        with self._lock:
            found = Counter(self._lost_before)
            for one in self._subscriptions:
                found[one.name] += one.lost
        return dict(+found)

    def unauthenticated(self) -> list[str]:
        """Who may speak to us without proving who they are, in sentences."""
        who = "every machine that reaches this one" if self._config.beyond_loopback else "every process of this machine"
        return [f"{who} may speak in DDS domain {self._config.domain}, in the name of any node"]

    def close(self) -> None:
        """Take all back and leave; harmless when repeated."""
        with self._lock:
            publishers, subscriptions = self._publishers, self._subscriptions
            self._participant = self._discovery = self._returned = None
            self._publishers, self._subscriptions = [], []
        if self._installed is not None:
            self._installed.close()
        for publisher in publishers:
            publisher.close()
        for subscription in subscriptions:
            subscription.close()
        self._topics.clear()

    def _prepared(self, topic: Topic) -> tuple[DomainParticipant, DdsTopic[Any], Any]:
        hash = self._types.hash(topic.type)
        check_name(topic.name)
        with self._lock:
            if self._participant is None:
                raise RosLinkError("the connection to ROS is closed")
            self._publishers = [one for one in self._publishers if not one.closed]
            for one in self._subscriptions:
                if one.closed:
                    self._lost_before[one.name] += one.lost
            self._subscriptions = [one for one in self._subscriptions if not one.closed]
            place = (topic.name, topic.type)
            if place not in self._topics:
                made = raw_type(self._types, topic.type)
                self._topics[place] = DdsTopic(self._participant, f"rt{topic.name}", made)
            return self._participant, self._topics[place], dds_qos(topic.qos, hash)

    def _tell(self) -> None:
        if self._discovery is not None:
            readers = [one.gid for one in self._subscriptions]
            self._discovery.tell(readers, [one.writer for one in self._publishers])


def _mismatch(mine: Endpoint, other: Endpoint) -> str:
    """Why two endpoints of one topic do not match; empty if they do, or need not."""
    if {mine.kind, other.kind} != {"publisher", "subscriber"}:
        return ""
    if mine.topic.type != other.topic.type:
        return f"as {other.topic.type}, we as {mine.topic.type}"
    if mine.type_hash and other.type_hash and mine.type_hash != other.type_hash:
        return f"with another definition ({other.type_hash}) than ours ({mine.type_hash})"
    sender, receiver = (mine, other) if mine.kind == "publisher" else (other, mine)
    if receiver.topic.qos.reliable and not sender.topic.qos.reliable:
        return f"as {other.kind}: best effort is offered, reliable is asked for"
    if receiver.topic.qos.transient_local and not sender.topic.qos.transient_local:
        return f"as {other.kind}: volatile is offered, transient local is asked for"
    return ""


def _gid(reader: DataReader[Any], handle: int) -> bytes:
    """Of a writer; empty if it is gone already."""
    try:
        found = reader.get_matched_publication_data(handle)
    except DDSException:
        return b""
    return found.key.bytes if found is not None else b""
