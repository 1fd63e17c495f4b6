"""Diagnostics of agents, events of the timeline, and `/clock`."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

from agents.ros_bridge.bridge.config import Send
from agents.ros_bridge.bridge.core import BridgeCore, RosOutlet
from agents.ros_bridge.bridge.throttle import Throttle
from agents.ros_bridge.mapping.diagnostics import DIAGNOSTICS, to_diagnostics
from agents.ros_bridge.mapping.events import EVENT, to_event
from agents.ros_bridge.mapping.stamps import CLOCK, to_clock
from dsr.graph.watch import Change
from dsr.network.keys import Keys
from dsr.network.transport import Transport
from dsr.runtime.status import Status, StatusBoard
from dsr.timeline.entries import EVENT as INSTANT
from dsr.timeline.entries import SITUATION, read_entry


class DiagnosticsOut:
    """Publishes the statuses of all agents, the bridge's own included.

    Args:
        core: of the bridge.
        config: what is sent.
        bus: on which the others tell theirs.
        keys: of the graph.
        own: gives the bridge's newest status; nobody hears what it sends itself.
    """

    def __init__(
        self, core: BridgeCore, config: Send, bus: Transport, keys: Keys, own: Callable[[], object] = lambda: None
    ) -> None:
        self._core = core
        self._own = own
        self._graph = keys.graph
        self._throttle = Throttle(core.clock, config.diagnostics_hz)
        self._outlet = core.outlet(config.diagnostics, DIAGNOSTICS) if config.diagnostics else None
        if self._outlet is not None:
            self._board = StatusBoard(bus, keys, core.clock)
            core.on_close(self._board.close)

    def update(self) -> None:
        """Publish if it is time."""
        if self._outlet is None or not self._throttle.take():
            return
        board = self._board
        heard = [
            (status.status, board.is_silent(agent))
            for agent in board.agents()
            if (status := board.get(agent)) is not None
        ]
        if isinstance(own := self._own(), Status):
            heard.append((own, False))
        stamp = self._core.times.to_ros(self._core.times.now())
        self._outlet.send(lambda: to_diagnostics(self._core.types, stamp, self._graph, heard))


class EventsOut:
    """Publishes events as they are written, and situations as they begin and end."""

    def __init__(self, core: BridgeCore, config: Send) -> None:
        self._core = core
        self._outlet = core.outlet(config.events, EVENT) if config.events else None
        if self._outlet is not None:
            self._watch = core.memory.watch(node_type=(INSTANT, SITUATION), existing=False)
            core.on_close(self._watch.close)
        self._sent: dict[str, float | None] = {}
        self._waiting: deque[Change] = deque()
        self._throttle = Throttle(core.clock, config.events_hz)

    def update(self) -> None:
        """Send what is new, as much as there is time for; the rest waits, and nothing of it is lost."""
        if self._outlet is None:
            return
        if not self._waiting:  # until then, the watch keeps one change of each entry
            self._waiting.extend(self._watch.poll())
        while self._waiting and self._throttle.is_due:
            change = self._waiting.popleft()
            if change.kind == "removed":
                self._sent.pop(change.name, None)
                continue
            node = self._core.memory.get_node(change.name)
            entry = None if node is None else read_entry(node)
            if entry is None or self._sent.get(entry.name, math.nan) == entry.end:
                continue
            if not self._core.wants(entry.participants):
                continue
            self._sent[entry.name] = entry.end
            self._throttle.take()
            self._outlet.send(lambda entry=entry: to_event(self._core.types, entry))  # type: ignore[misc]


class ClockOut:
    """Publishes our time on `/clock` while it is not that of the wall."""

    def __init__(self, core: BridgeCore, config: Send) -> None:
        self._core = core
        self._throttle = Throttle(core.clock, config.clock_hz)
        self._outlet: RosOutlet | None = None
        self._sent = -math.inf

    def update(self) -> None:
        """Send the time, if it went on, and if it is time for that."""
        now = self._core.times.now()
        if self._core.times.publishes and now != self._sent and self._throttle.take():
            self._sent = now
            if self._outlet is None:
                self._outlet = self._core.outlet("/clock", CLOCK)
            self._outlet.send(lambda: to_clock(self._core.types, now))
