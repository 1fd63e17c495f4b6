"""Who is there: the nodes, publishers, subscribers, services and clients that liveliness tokens announce."""

from __future__ import annotations

import threading
from collections import Counter

import zenoh

from agents.ros_bridge.link.link import Endpoint, Topic
from agents.ros_bridge.link.zenoh.tokens import ADMIN, Entity, Kind, gid, read_token

_MOST_TOKENS = 20_000
"""That are kept: robots have some hundreds; beyond these, somebody floods"""


class ZenohDiscovery:
    """All tokens of one session's neighbourhood, kept up to date from Zenoh's threads."""

    def __init__(self, session: zenoh.Session, domain: int) -> None:
        self.ignored = 0
        """Tokens that were malformed, or too many."""
        self._domain = domain
        self._own = str(session.zid())
        self._entities: dict[str, Entity] = {}
        self._changed = threading.Condition()
        self._tokens = session.liveliness().declare_subscriber(f"{ADMIN}/**", self._on_token, history=True)

    def entities(self, kind: Kind | None = None, topic: str | None = None) -> list[Entity]:
        """Those of our domain, of one kind and on one topic if that is asked for."""
        with self._changed:
            found = list(self._entities.values())
        return [
            entity
            for entity in found
            if entity.domain == self._domain
            and (kind is None or entity.kind == kind)
            and (topic is None or entity.topic == topic)
        ]

    def elsewhere(self) -> Counter[int]:
        """How many nodes are visible in each domain but ours."""
        with self._changed:
            nodes = [entity.domain for entity in self._entities.values() if entity.kind == "node"]
        return Counter(domain for domain in nodes if domain != self._domain)

    def is_mine(self, entity: Entity) -> bool:
        """Whether this session announced it."""
        return entity.session == self._own

    def endpoints(self) -> list[Endpoint]:
        """All but the nodes, as the interface of links has them."""
        with self._changed:
            entities = list(self._entities.items())
        found = []
        for token, one in entities:
            if one.kind != "node" and one.domain == self._domain:
                topic = Topic(one.topic, one.type, one.qos)
                found.append(Endpoint(one.kind, one.node, topic, one.hash, self.is_mine(one), gid(token)))
        return found

    def wait_for_service(self, key: str, timeout: float) -> bool:
        """Wait until somebody serves requests on `key`; false if nobody does after `timeout` s."""

        def is_there() -> bool:
            return any(entity.kind == "service" and entity.key() == key for entity in self._entities.values())

        with self._changed:
            return self._changed.wait_for(is_there, timeout)

    def close(self) -> None:
        """Stop watching; whoever waits goes on waiting to the end of its time."""
        self._tokens.undeclare()  # type: ignore[no-untyped-call]

    def _on_token(self, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        with self._changed:
            if sample.kind == zenoh.SampleKind.DELETE:
                self._entities.pop(key, None)
            elif len(self._entities) >= _MOST_TOKENS or (entity := read_token(key)) is None:
                self.ignored += 1
            else:
                self._entities[key] = entity
            self._changed.notify_all()
