"""A connection to nodes under rmw_zenoh_cpp."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable
from typing import TypeVar

import zenoh

from agents.ros_bridge.errors import RosAbsentError, RosLinkError
from agents.ros_bridge.link.link import Endpoint, LinkConfig, Qos, Received, Topic
from agents.ros_bridge.link.telling import Lately, few
from agents.ros_bridge.link.zenoh.discovery import ZenohDiscovery
from agents.ros_bridge.link.zenoh.routing import places_beyond
from agents.ros_bridge.link.zenoh.services import ZenohClient, ZenohServed
from agents.ros_bridge.link.zenoh.session import is_loopback, open_session
from agents.ros_bridge.link.zenoh.tokens import Entity, Kind
from agents.ros_bridge.link.zenoh.topics import ZenohPublisher, ZenohSubscription, undeclare
from agents.ros_bridge.messages.names import check_name
from agents.ros_bridge.messages.types import RosTypes, types_of
from dsr.clock import WALL_CLOCK

_Declared = TypeVar("_Declared", bound=ZenohPublisher | ZenohSubscription | ZenohServed)

_SERVICE_QOS = Qos(depth=10)
"""As `rmw_qos_profile_services_default`"""
_ONLY_NODE = 0


class ZenohLink:
    """One node on a Zenoh session of its own; implements `agents.ros_bridge.link.link.RosLink`.

    Args:
        config: where the router is, and which domain and release of ROS 2.
        node: full name of the node, for example `/dsr_bridge`.

    Raises:
        RosLinkError: if the router's endpoint is malformed, or on another machine without `beyond_loopback`.
    """

    def __init__(self, config: LinkConfig, node: str) -> None:
        self._types: RosTypes = types_of(config.distro)
        self._config = config
        self._node = check_name(node)
        self._session = open_session(config)
        self._ids = 0
        self._lock = threading.Lock()
        self._closed = False
        self._declared: list[ZenohPublisher | ZenohSubscription | ZenohServed] = []
        self._clients: dict[str, ZenohClient] = {}
        self._lately = Lately()
        self._lost_before: Counter[str] = Counter()
        """By topic, of subscriptions that were taken back"""
        self._discovery = ZenohDiscovery(self._session, config.domain)
        self._own = Entity("node", config.domain, str(self._session.zid()), _ONLY_NODE, _ONLY_NODE, node)
        self._token = self._session.liveliness().declare_token(self._own.token())

    def publisher(self, topic: Topic) -> ZenohPublisher:
        """Announce a publisher. Raises `RosMessageError` for a type that is not known."""
        entity = self._entity("publisher", topic)
        publisher = ZenohPublisher(self._session, entity, lambda: self._others(entity))
        return self._kept(publisher)

    def subscribe(self, topic: Topic, receive: Callable[[Received], None]) -> ZenohSubscription:
        """Call `receive` with each message, from a thread. Raises `RosMessageError` for a type that is not known."""
        entity = self._entity("subscriber", topic)
        subscription = ZenohSubscription(self._session, entity, receive, lambda: self._others(entity))
        return self._kept(subscription)

    def endpoints(self) -> list[Endpoint]:
        """All that is visible, this link's own included."""
        return self._discovery.endpoints()

    def serve(self, name: str, type: str, answer: Callable[[bytes], bytes]) -> ZenohServed:
        """Answer requests to a service; `answer` is called from a thread, one request after the other."""
        served = ZenohServed(self._session, self._entity("service", Topic(name, type, _SERVICE_QOS)), answer)
        return self._kept(served)

    def prepare(self, name: str, type: str) -> None:
        """Announce a client of the service."""
        self._client(name, type)

    def call(self, name: str, type: str, request: bytes, timeout: float) -> bytes:
        """Wait until the service is there, ask, and wait for its response, at most `timeout` s in all."""
        client = self._client(name, type)
        end = WALL_CLOCK.monotonic() + timeout
        announced = self._discovery.wait_for_service(client.key, timeout)
        if not announced or not client.wait(end - WALL_CLOCK.monotonic()):
            raise RosAbsentError(f"nobody serves {name} ({type}) within {timeout:g} s")
        return client.call(request, max(end - WALL_CLOCK.monotonic(), 0.001))

    def problems(self) -> list[str]:
        """Sentences that tell why messages may not arrive; empty if all is well."""
        found = [*self._network_problems(), *self._type_problems()]
        for subscription in self._declared:
            if not isinstance(subscription, ZenohSubscription):
                continue
            for number, what in (
                (subscription.malformed, "came without the data that rmw_zenoh adds, and were dropped"),
                (
                    subscription.outdated,
                    "came from an rmw_zenoh older than 0.2.4 (Jazzy) or 0.1.2 (Humble), and were dropped: update it",
                ),
                (subscription.failures, "could not be handled"),
            ):
                if self._lately.grew((id(subscription), what), number):
                    found.append(f"{number} messages of {subscription.topic} {what}")
        return found

    def lost(self) -> dict[str, int]:
        """Messages by topic that did not arrive, by the gaps in their numbers: they came too fast, or a link broke."""
        with self._lock:
            found = Counter(self._lost_before)
            for one in self._declared:
                if isinstance(one, ZenohSubscription):
                    found[one.topic] += one.lost
        return dict(+found)

    def unauthenticated(self) -> list[str]:
        """Who may speak to us without proving who they are, as far as the router tells with whom it is joined."""
        router, domain = self._config.router, self._config.domain
        found = [f"whoever reaches the Zenoh router {router} may speak in domain {domain}, in the name of any node"]
        places = places_beyond(self._session)
        if places:
            found.append(f"the router {router} is joined with {', '.join(places)}: it passes on what comes from there")
        return found

    def close(self) -> None:
        """Take all back and leave; harmless when repeated."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
            declared, clients = self._declared, self._clients
        for one in declared:
            one.close()
        for client in clients.values():
            client.close()
        undeclare(self._token)
        self._discovery.close()
        self._session.close()  # type: ignore[no-untyped-call]

    def _client(self, name: str, type: str) -> ZenohClient:
        with self._lock:
            client = self._clients.get(name)
        if client is None:
            client = ZenohClient(self._session, self._entity("client", Topic(name, type, _SERVICE_QOS)))
            with self._lock:
                client = self._clients.setdefault(name, client)
        return client

    def _kept(self, declared: _Declared) -> _Declared:
        """Remember what is to be taken back in the end, and forget what was taken back."""
        with self._lock:
            for one in self._declared:
                if one.closed and isinstance(one, ZenohSubscription):
                    self._lost_before[one.topic] += one.lost
            self._declared = [*(one for one in self._declared if not one.closed), declared]
        return declared

    def _entity(self, kind: Kind, topic: Topic) -> Entity:
        hash = self._types.hash(topic.type)
        check_name(topic.name)
        with self._lock:
            if self._closed:
                raise RosLinkError("the connection to ROS is closed")
            self._ids += 1
            own = self._own
            return Entity(
                kind, own.domain, own.session, _ONLY_NODE, self._ids, own.node,
                topic.name, topic.type, hash, topic.qos,
            )  # fmt: skip

    def _others(self, entity: Entity) -> int:
        """How many entities elsewhere send what this one receives, or receive what it sends."""
        found = self._discovery.entities(_OPPOSITE[entity.kind], entity.topic)
        as_this = entity.type, entity.hash
        return sum((other.type, other.hash) == as_this and not self._discovery.is_mine(other) for other in found)

    def _network_problems(self) -> list[str]:
        found = []
        links = self._session.info.links()
        if not links:
            found.append(
                f"no Zenoh router answers at {self._config.router}; "
                "start one beside the robot's nodes: ros2 run rmw_zenoh_cpp rmw_zenohd"
            )
        elif not self._session.info.routers_zid():
            found.append(f"the Zenoh router at {self._config.router} is gone: nodes that start now are not found")
        if not any(not self._discovery.is_mine(entity) for entity in self._discovery.entities()):
            found += few(
                f"nobody is visible in domain {self._config.domain}, but {number} nodes in domain {domain}"
                for domain, number in self._discovery.elsewhere().items()
            )
        if not self._config.beyond_loopback:
            others = sorted({link.dst for link in links if not _is_here(link)})
            found += [f"{place} is on another machine: nothing passes without beyond_loopback" for place in others]
        if self._lately.grew("ignored", self._discovery.ignored):
            found.append(f"{self._discovery.ignored} announcements were malformed or too many, and were ignored")
        return found

    def _type_problems(self) -> list[str]:
        """Endpoints on our topics that cannot hear us, or we them, because their keys differ."""
        entities = self._discovery.entities()
        own = {(entity.topic, entity.kind): entity for entity in entities if self._discovery.is_mine(entity)}
        found = set()
        for entity in entities:
            mine = own.get((entity.topic, _OPPOSITE[entity.kind])) if entity.kind in _OPPOSITE else None
            if mine is None or self._discovery.is_mine(entity) or mine.key() == entity.key():
                continue
            who = f"{entity.node} has {entity.topic} as {entity.type}"
            if entity.type != mine.type:
                found.add(f"{who}, we as {mine.type}: they do not hear each other")
            else:
                found.add(
                    f"{who} with another definition ({entity.hash}) than that of ROS 2 {self._types.distro} "
                    f"({mine.hash}): they do not hear each other"
                )
        return few(found)


_OPPOSITE: dict[Kind, Kind] = {
    "publisher": "subscriber", "subscriber": "publisher", "service": "client", "client": "service",
}  # fmt: skip


def _is_here(link: zenoh.Link) -> bool:
    host = link.dst.partition("/")[2].rpartition(":")[0]
    return is_loopback(host)
