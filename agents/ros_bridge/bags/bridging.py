"""A bridge that hears a bag: what it writes to the graph and publishes, message by message, on the bag's time."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple, cast

from agents.ros_bridge.agent import RosBridge
from agents.ros_bridge.bags.reader import Bag, BagMessage
from agents.ros_bridge.bridge.in_tf import TF_STATIC
from agents.ros_bridge.link.link import LinkConfig, Qos, Topic
from agents.ros_bridge.link.local import LocalLink, LocalPublisher, LocalRos
from dsr.agent import make_agent
from dsr.clock import ManualClock
from dsr.memory import Memory
from dsr.network.keys import ALL, Keys
from dsr.network.local_transport import LocalNetwork

NAME = RosBridge.name
"""Of the agent that wrote what came from a bag"""
SILENT: dict[str, Any] = {
    "tf": False, "belief": False, "markers": "", "beliefs": "", "joints": "", "images": False, "diagnostics": "",
    "events": "", "services": "",
}  # fmt: skip
"""`send` of a bridge that nobody hears"""
_DEPTH = 1000
"""Messages that a late subscriber to a latched topic gets; here all subscribe before the first one"""

_QUIET = logging.getLogger("dsr.ros.bag")
_QUIET.addHandler(logging.NullHandler())  # what is told is returned


class Published(NamedTuple):
    """A message of the bridge."""

    topic: str
    """Key without the graph's root"""
    payload: bytes


class BagBridge:
    """A bridge on a network of its own, with the only replica of its graph.

    Args:
        bag: whose messages it will hear.
        topics: those.
        config: of the bridge.
        keys: of the graph.
        begin: s, the time at which it begins.
        number: of the bridge, another one for each that writes to the same graph.
        snapshot: the graph as an earlier one left it.
    """

    def __init__(
        self, bag: Bag, topics: Iterable[str], config: Mapping[str, Any], keys: Keys, begin: float, number: int,
        snapshot: bytes | None,
    ) -> None:  # fmt: skip
        self.clock = ManualClock(begin)
        self._keys = keys
        self._published: list[Published] = []
        ros = LocalRos(self.clock)
        node = LocalLink(ros, "/bag", any_names=True)
        self._publishers: dict[str, LocalPublisher] = {}
        for name in dict.fromkeys(topics):
            qos = Qos(transient_local=name == TF_STATIC, depth=_DEPTH)
            self._publishers[name] = node.publisher(Topic(name, bag.topics[name].type, qos))
        self._network = LocalNetwork(self.clock)
        listener = self._network.connect("listener")
        for pattern in (keys.delta(), keys.stream(), keys.blob("**")):
            listener.subscribe(pattern, self._hear)
        rid = f"{NAME}-{number}"
        transport = self._network.connect(rid)
        self.memory = Memory(keys.graph, NAME, transport=transport, clock=self.clock, rid=rid, interest=(ALL,))
        if snapshot is not None:
            self.memory.restore(snapshot)

        def connect(link: LinkConfig, node: str) -> LocalLink:
            return LocalLink(ros, node, link.distro, any_names=True)

        kind = cast("type[RosBridge]", type(RosBridge.__name__, (RosBridge,), {"connect": staticmethod(connect)}))
        agent = make_agent(
            kind.configured(config), name=NAME, config=config, bus=transport, keys=keys, clock=self.clock,
            memory=self.memory,
        )  # fmt: skip
        agent.log = _QUIET
        self._agent = cast(RosBridge, agent)
        self._agent.setup()

    @property
    def counts(self) -> Counter[str]:
        """What the bridge counts of its work."""
        return Counter(self._agent.counts)

    @property
    def told(self) -> list[str]:
        """Each kind of trouble once, in words."""
        return self._agent.told

    def play(self, message: BagMessage) -> None:
        """Let the bridge hear a message at its time."""
        self.clock.advance_to(max(self.clock.now(), message.time))
        self._publishers[message.topic].send(message.cdr)

    def tick(self, now: float) -> list[Published]:
        """Let the bridge work at time `now` (s), and return what it published."""
        self.clock.advance_to(max(self.clock.now(), now))
        self.memory.poll()
        self._agent.tick(now)
        self.memory.flush()
        self._network.deliver()
        published, self._published = self._published, []
        return published

    def close(self) -> None:
        """End it."""
        self._agent.teardown()
        self.memory.close()

    def _hear(self, key: str, payload: bytes) -> None:
        self._published.append(Published(key.removeprefix(f"{self._keys.root}/"), payload))
