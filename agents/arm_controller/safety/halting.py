"""The arm controller's part in the emergency stop: hears orders, as messages and from the graph, and answers them."""

from __future__ import annotations

import logging

import msgspec

from dsr.memory import Memory
from dsr.network.keys import Keys
from dsr.network.transport import Qos, Transport
from dsr.vocabulary.arms import ARM
from dsr.vocabulary.halting import (
    HALT_NODE,
    HaltLatch,
    HaltReport,
    halt_report_key,
    order_about,
    write_order,
)


class EmergencyStop:
    """Whether the arm may move, as orders of `dsr halt` say.

    Args:
        memory: holds the node `halt`, which is written here, too.
        bus: where orders are heard, whatever becomes of the memory.
        keys: of the graph.
        agent: in whose name orders are answered.
        log: where each order is told.
        arm: name of the arm; orders about another one are none of its.
    """

    def __init__(
        self, memory: Memory, bus: Transport, keys: Keys, agent: str, log: logging.Logger, arm: str = ARM
    ) -> None:
        self._memory, self._bus, self._keys, self._agent, self._log = memory, bus, keys, agent, log
        self._latch, self._arm = HaltLatch(bus, keys, arm=arm), arm
        self._watch = memory.watch(node_type=HALT_NODE)
        self._written = self._told = ""
        self._answered = 0
        self._take_from(memory)

    @property
    def reason(self) -> str:
        """Who forbids motion now, and why; empty if nobody does."""
        return self._latch.reason

    def tick(self, moving: bool) -> None:
        """Take in new orders, write them to the graph, and answer those that came as messages.

        Args:
            moving: whether the arm still moves.
        """
        if self._watch.poll():
            self._take_from(self._memory)
        order = self._latch.order
        if order is None:
            return
        if order.id != self._told:
            self._told = order.id
            self._log.warning("%s", order.reason or f"released by {order.by}")
        if order.id != self._written and self._memory.joined:
            write_order(self._memory, order)
            self._written = order.id
        if self._answered != self._latch.heard:
            self._answered = self._latch.heard
            report = HaltReport(self._agent, order.id, order.halted, moving)
            self._bus.publish(halt_report_key(self._keys, self._agent), msgspec.msgpack.encode(report), Qos.STREAM)

    def close(self) -> None:
        """Hear no more orders."""
        self._watch.close()
        self._latch.close()

    def _take_from(self, memory: Memory) -> None:
        order = order_about(memory, self._arm)
        if order is not None:
            self._written = order.id
            self._latch.take(order)
