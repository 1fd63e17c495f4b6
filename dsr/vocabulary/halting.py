"""The emergency stop: the message that forbids motion, the answers to it, and the node that tells late joiners.

An order travels as a message of its own, so it needs neither a planner nor a graph that answers. Whoever moves
something obeys at once, and moves nothing until another order releases it. The arm controllers write the newest order
to the node `halt`, and so does `dsr halt` if the graph answers.

An order may be about one arm, such as `left`: the other arms do not mind it, and its node is `halt_left`. Of all orders
that are about an arm the newest counts for this arm.

Nobody has to believe the time in an order. No order is written with a time ahead of the writer's clock. A release that
is stamped with a time to come releases nothing, and a halt forbids motion until it is released.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator
from typing import Annotated

import msgspec
from msgspec import Meta

from dsr.errors import WireError
from dsr.graph.elements import Node
from dsr.memory import Memory
from dsr.network.decoding import decoded
from dsr.network.keys import Keys
from dsr.network.transport import Qos, Transport
from dsr.replication.sync import MAX_DRIFT
from dsr.vocabulary.arms import ARM

HALT_NODE = "halt"
"""Name of the node that holds the newest order to all arms, and type of all nodes that hold orders."""
HALT_ATTRIBUTES = ("halted", "halt_id", "source", "explanation", "since", "arm")
"""Attributes of those nodes."""
HALTER = "halt"
"""The agent as which `dsr halt` acts, in a secured graph too."""
_MOST_ORDERS = 1000
"""Orders that are remembered, so that none counts twice: more than people give in the life of a process"""

Text = Annotated[str, Meta(max_length=500)]
"""Some words of people."""
Id = Annotated[str, Meta(min_length=1, max_length=64)]
"""Tells an order from all others."""


class HaltOrder(msgspec.Struct, frozen=True):
    """An order to stop and stay stopped, or to release that (a MessagePack map)."""

    id: Id
    halted: bool
    """Whether motion is forbidden from now on."""
    by: Text
    """Who gave the order."""
    why: Text = ""
    stamp: float = 0.0
    """Time of the order on the clock of who gave it, s since the Unix epoch."""
    arm: Annotated[str, Meta(max_length=200)] = ""
    """Name of the only arm that the order is about; empty for all arms."""

    def concerns(self, arm: str) -> bool:
        """Whether the order is about the arm of that name."""
        return self.arm in ("", arm)

    @property
    def reason(self) -> str:
        """Who forbade motion, and why, in words; empty for a release."""
        if not self.halted:
            return ""
        return f"halted by {self.by}{f': {self.why}' if self.why else ''}"


class HaltReport(msgspec.Struct, frozen=True):
    """The answer of one agent that obeys orders (a MessagePack map)."""

    agent: str
    id: Id
    """Of the order that was heard."""
    halted: bool
    """Whether motion is forbidden for that agent now."""
    moving: bool
    """Whether what it drives still moved at its last sample."""


_order_decoder = msgspec.msgpack.Decoder(HaltOrder)
_report_decoder = msgspec.msgpack.Decoder(HaltReport)


def halt_key(keys: Keys) -> str:
    """Key of the orders."""
    return keys.device("halt")


def halt_report_key(keys: Keys, agent: str = "*") -> str:
    """Key on which an agent answers."""
    return keys.device(f"halted/{agent}")


def decode_order(payload: bytes) -> HaltOrder:
    """The order in a message; raises `WireError`."""
    return decoded(payload, "halt order", _read_order)


def decode_report(payload: bytes) -> HaltReport:
    """The report in a message; raises `WireError`."""
    return decoded(payload, "halt report", _report_decoder.decode)


def _read_order(payload: bytes) -> HaltOrder:
    order = _order_decoder.decode(payload)
    if not math.isfinite(order.stamp):
        raise ValueError(f"time {order.stamp}")
    return order


def send_order(bus: Transport, keys: Keys, order: HaltOrder) -> None:
    """Tell everybody in the graph."""
    bus.publish(halt_key(keys), msgspec.msgpack.encode(order), Qos.RELIABLE)


def halt_node(arm: str = "") -> str:
    """Name of the node that holds the newest order to one arm; to all arms if empty."""
    return f"{HALT_NODE}_{arm}" if arm else HALT_NODE


def write_order(memory: Memory, order: HaltOrder) -> None:
    """Write an order to its node, if it is not there yet; no later than now.

    Orders about the same arms that are stamped as if they were to come, by a clock that is ahead, count as older.
    """
    name = halt_node(order.arm)
    node = memory.get_node(name)
    now = memory.clock.now()
    since = min(max(order.stamp, 0.0), now)
    if order.halted:  # whatever the clock of who ordered it says, it is newer than what was released before
        since = max([since, *_releases(memory, order.arm, now + MAX_DRIFT)])
    values = {"halted": order.halted, "halt_id": order.id, "source": order.by, "explanation": order.why, "since": since}
    if order.arm:
        values["arm"] = order.arm
    if node is not None and node.get("halt_id") == order.id:
        return
    with memory.batch():
        if node is None:
            memory.add_node(name, HALT_NODE, **values)
        else:
            memory.update_node(name, **values)
        for other in _orders_about(memory, order.arm):
            if other.name != name and other.get("since", 0.0) > now + MAX_DRIFT:
                # a halt goes on for the arms that this order is not about; a release of a time to come released nobody
                older = math.nextafter(since, -math.inf) if other.get("halted", False) else 0.0
                memory.update_node(other.name, since=older)


def _orders_about(memory: Memory, arm: str) -> list[Node]:
    """The orders in the graph that are about an arm which an order about `arm` is about."""
    return [node for node in memory.nodes(HALT_NODE) if arm in ("", node.get("arm", "")) or node.name == HALT_NODE]


def _releases(memory: Memory, arm: str, latest: float) -> Iterator[float]:
    """Times of releases in the graph, up to the latest, about arms that an order about `arm` is about."""
    for node in _orders_about(memory, arm):
        since = float(node.get("since", 0.0))
        if not node.get("halted", False) and since <= latest:
            yield since


def order_about(memory: Memory, arm: str) -> HaltOrder | None:
    """The newest order in the graph that is about an arm; None without any.

    At one time, a halt precedes a release. Of orders whose time is to come halts precede all others, and releases none.
    """
    found = [order for name in ("", arm) if (order := order_of(memory.get_node(halt_node(name)))) is not None]
    latest = memory.clock.now() + MAX_DRIFT
    return max(found, key=lambda order: (_time(order, latest), order.halted), default=None)


def _time(order: HaltOrder, latest: float) -> float:
    """When (s) an order counts as given, if no clock says more than `latest`."""
    if order.stamp <= latest:
        return order.stamp
    return math.inf if order.halted else -math.inf


def order_of(node: Node | None) -> HaltOrder | None:
    """The order that a node of type `halt` holds; None if there is no such node, or nothing can be read off it."""
    if node is None or node.type != HALT_NODE:
        return None
    halted, id = node.get("halted"), node.get("halt_id")
    if halted is None or not id:
        return None
    by, why = node.get("source", ""), node.get("explanation", "")
    return HaltOrder(id, halted, by, why, node.get("since", 0.0), node.get("arm", ""))


class HaltLatch:
    """Whether motion is forbidden, as the newest order says; stays so whatever becomes of who gave the order.

    Args:
        bus: where orders are heard.
        keys: of the graph.
        on_order: called for each new order, in the network's thread; must return at once.
        arm: name of the arm that moves; orders about another one are none of its.
    """

    def __init__(
        self, bus: Transport, keys: Keys, on_order: Callable[[HaltOrder], None] | None = None, arm: str = ARM
    ) -> None:
        self.order: HaltOrder | None = None
        """The newest order; None before the first."""
        self.heard = 0
        """Messages with orders so far, repeated ones too: each wants an answer."""
        self.malformed = 0
        """Messages that were no orders. They change nothing."""
        self._on_order, self._arm = on_order, arm
        self._known: dict[str, None] = {}
        self._lock = threading.Lock()
        self._subscription = bus.subscribe(halt_key(keys), self._receive)

    @property
    def reason(self) -> str:
        """Why motion is forbidden now, and who forbade it; empty if it is not."""
        return "" if self.order is None else self.order.reason

    def take(self, order: HaltOrder) -> bool:
        """Obey an order, wherever it came from; returns whether it is about this arm and was not known yet."""
        if not order.concerns(self._arm):
            return False
        with self._lock:
            if order.id in self._known:
                return False
            self._known[order.id] = None
            if len(self._known) > _MOST_ORDERS:
                del self._known[next(iter(self._known))]
            self.order = order
        if self._on_order is not None:
            self._on_order(order)
        return True

    def close(self) -> None:
        """Stop listening; what is forbidden stays forbidden."""
        self._subscription.close()

    def _receive(self, key: str, payload: bytes) -> None:
        try:
            order = decode_order(payload)
        except WireError:
            self.malformed += 1
            return
        if order.concerns(self._arm):
            self.take(order)
            self.heard += 1
