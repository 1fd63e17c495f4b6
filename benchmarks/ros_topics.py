"""Measures images and transforms over our link to ROS 2, beside raw Zenoh with the same bytes.

From before a message is encoded until the other process has decoded it. The peer is done when its callback has the
bytes. All take turns in short bursts, so that what disturbs the machine disturbs all of them.
"""

from __future__ import annotations

import contextlib
from typing import Any, Literal

import msgspec
import numpy as np

from agents.ros_bridge.link.link import LinkConfig, Qos, Topic
from agents.ros_bridge.link.link import Received as Message
from agents.ros_bridge.link.opening import open_link
from agents.ros_bridge.messages.transforms import TF_MESSAGE, StampedTransform, decode_transforms, encode_transforms
from agents.ros_bridge.messages.types import types_of
from benchmarks.group import Run
from benchmarks.links import Closable, Link, Received, Sender
from benchmarks.pairs import PERIOD, Latencies
from benchmarks.peers.zenoh_link import ZenohLink, open_router
from benchmarks.ports import reserved_endpoint
from benchmarks.ros_links import IMAGE, TF
from benchmarks.rows import Peer, Spec
from benchmarks.timing import percentile

_TYPES = types_of("jazzy")
_IMAGE = "sensor_msgs/msg/Image"
_WIDTH, _HEIGHT = 640, 480
_POSE = (0.5, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
_OURS, _RAW = "ours", "raw Zenoh"

Kind = Literal["image", "tf"]


class RosTopicLink(msgspec.Struct, frozen=True):
    """A topic between two nodes; the writer's process has the router."""

    endpoint: str
    kind: Kind

    def writer(self) -> Sender:
        """The publisher, and the router."""
        return _Sender(self)

    def reader(self, received: Received) -> Closable:
        """A subscription that decodes what comes."""
        link = open_link(self.config, "/reader")

        def decode(message: Message) -> None:
            received(_number(self.kind, message.cdr))

        link.subscribe(self.topic, decode)
        return link

    @property
    def config(self) -> LinkConfig:
        """Where the router is."""
        return LinkConfig(router=self.endpoint)

    @property
    def topic(self) -> Topic:
        """What is sent."""
        return Topic("/bench", _IMAGE if self.kind == "image" else TF_MESSAGE, Qos(depth=10))


class _Sender:
    def __init__(self, link: RosTopicLink) -> None:
        self._router = open_router(link.endpoint)
        self._link = open_link(link.config, "/writer")
        self._publisher = self._link.publisher(link.topic)
        self._kind: Kind = link.kind

    def send(self, number: int) -> None:
        self._publisher.send(encoded(self._kind, number))

    def close(self) -> None:
        self._link.close()
        self._router.close()  # type: ignore[no-untyped-call]


_PIXELS = np.zeros(_WIDTH * _HEIGHT * 3, np.uint8)


def encoded(kind: Kind, number: int) -> bytes:
    """A message that holds its number as its time."""
    if kind == "tf":
        return encode_transforms([StampedTransform(number, 0, "world", "arm", _POSE)])
    stamp = _TYPES.new("builtin_interfaces/msg/Time", sec=number)
    header = _TYPES.new("std_msgs/msg/Header", stamp=stamp, frame_id="camera")
    message: Any = _TYPES.new(
        _IMAGE, header=header, height=_HEIGHT, width=_WIDTH, encoding="rgb8", step=_WIDTH * 3, data=_PIXELS
    )
    return _TYPES.encode(_IMAGE, message)


def _number(kind: Kind, cdr: bytes | memoryview) -> int:
    if kind == "tf":
        return decode_transforms(cdr)[-1].sec
    return int(_TYPES.decode(_IMAGE, cdr).header.stamp.sec)


def measure(run: Run) -> None:
    """Measure ours and raw Zenoh in turns, first images, then transforms."""
    for spec, kind, period in ((IMAGE, "image", 1 / 30), (TF, "tf", PERIOD)):
        _measure(run, spec, kind, period)  # type: ignore[arg-type]


def _measure(run: Run, spec: Spec, kind: Kind, period: float) -> None:
    rounds, count = run.pick(8, 3), run.pick(100, 50)
    size = len(encoded(kind, 1))
    links: dict[str, Link] = {
        _OURS: RosTopicLink(reserved_endpoint(), kind),
        _RAW: ZenohLink(reserved_endpoint(), size, reliable=False),
    }
    taken: dict[str, list[float]] = {name: [] for name in links}
    with contextlib.ExitStack() as stack:
        pairs = {}
        for name, link in links.items():
            run.step(f"ROS 2 {kind}: starting {name}")
            pairs[name] = stack.enter_context(Latencies(link))
            pairs[name].warm_up()
        for number in range(rounds):
            for name, pair in pairs.items():
                run.step(f"ROS 2 {kind}: {name}, round {number + 1} of {rounds}")
                taken[name] += [seconds * 1e3 for seconds in pair.burst(count, period=period)]
    ours, raw = percentile(taken[_OURS], 0.5), percentile(taken[_RAW], 0.5)
    note = f"{size} bytes; {ours:.2f} ms, raw {raw:.2f} ms; {len(taken[_OURS])} samples"
    run.row(spec, ours / raw, [Peer("raw Zenoh", 1.0)], note)
