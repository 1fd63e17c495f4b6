"""A robot that speaks ROS, made of a local link, beside a bridge in lockstep."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from agents.ros_bridge import RosBridge
from agents.ros_bridge.link.link import Qos, Topic
from agents.ros_bridge.link.local import LocalLink, LocalPublisher, LocalRos
from agents.ros_bridge.mapping.transforms import to_stamped
from agents.ros_bridge.messages.transforms import TF_MESSAGE, StampedTransform, decode_transforms, encode_transforms
from agents.ros_bridge.messages.types import types_of
from dsr.clock import ManualClock
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.runtime.lockstep import Lockstep
from dsr.runtime.system import AgentSpec

TYPES = types_of("jazzy")
LATCHED = Qos(transient_local=True, depth=10)


class Robot:
    """A node of ROS, with the publishers and the messages that it heard."""

    def __init__(self, ros: LocalRos, name: str = "/robot") -> None:
        self.link = LocalLink(ros, name)
        self.heard: dict[str, list[Any]] = {}
        self._publishers: dict[str, LocalPublisher] = {}

    def tf(self, *transforms: tuple[str, str, float, Pose], static: bool = False) -> None:
        """Publish transforms (parent, child, stamp, pose)."""
        self.tf_cdr(encode_transforms([to_stamped(*one) for one in transforms]), static=static)

    def tf_cdr(self, cdr: bytes, *, static: bool = False) -> None:
        """Publish bytes as tf."""
        name = "/tf_static" if static else "/tf"
        self.publisher(name, TF_MESSAGE, LATCHED if static else Qos(depth=100)).send(cdr)

    def send(self, name: str, type: str, **fields: Any) -> None:
        """Publish a message."""
        self.publisher(name, type, Qos()).send(TYPES.encode(type, TYPES.new(type, **fields)))

    def publisher(self, name: str, type: str, qos: Qos) -> LocalPublisher:
        """The publisher of a topic."""
        if name not in self._publishers:
            self._publishers[name] = self.link.publisher(Topic(name, type, qos))
        return self._publishers[name]

    def listen(self, name: str, type: str, qos: Qos | None = None) -> None:
        """Hear a topic from now on."""
        found = self.heard.setdefault(name, [])
        self.link.subscribe(Topic(name, type, qos or Qos()), lambda one: found.append(TYPES.decode(type, one.cdr)))

    def listen_tf(self) -> list[StampedTransform]:
        """Hear tf and static tf from now on; returns the list that grows."""
        found: list[StampedTransform] = []
        for name, qos in (("/tf", Qos(depth=100)), ("/tf_static", LATCHED)):
            self.link.subscribe(Topic(name, TF_MESSAGE, qos), lambda m: found.extend(decode_transforms(m.cdr)))
        return found


class Bridged:
    """A bridge in lockstep with a robot."""

    def __init__(self, lockstep: Lockstep, ros: LocalRos, clock: ManualClock) -> None:
        self.lockstep, self.ros, self.clock = lockstep, ros, clock
        self.robot = Robot(ros)

    @property
    def memory(self) -> Memory:
        """The observer's replica."""
        return self.lockstep.memory

    @property
    def counts(self) -> dict[str, int]:
        """What the bridge counted."""
        return dict(self.lockstep.runner("ros_bridge").agent.counts)

    @property
    def trouble(self) -> str:
        """What the bridge's status says."""
        return self.lockstep.runner("ros_bridge").status().last_error

    def run(self, seconds: float = 0.05) -> None:
        """Let time pass."""
        self.lockstep.run_for(seconds)

    @property
    def now(self) -> float:
        """S"""
        return self.clock.now()


@contextmanager
def bridged(config: dict[str, Any] | None = None, others: Iterable[AgentSpec] = ()) -> Iterator[Bridged]:
    """A bridge, and other agents, in lockstep."""
    clock = ManualClock()
    ros = LocalRos(clock)

    class LocalBridge(RosBridge):
        connect = staticmethod(lambda link, node: LocalLink(ros, node))

    kind = LocalBridge.configured(config or {})
    specs = [AgentSpec("ros_bridge", kind, config or {}), *others]
    with Lockstep(specs, graph="ros", clock=clock) as lockstep:
        yield Bridged(lockstep, ros, clock)
