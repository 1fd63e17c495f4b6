"""How agents are doing: the status that each publishes once a second, and a board that collects them."""

from __future__ import annotations

import enum
import logging
import threading
from typing import NamedTuple, TypeVar

import msgspec
from msgspec.structs import replace

from dsr.clock import Clock
from dsr.errors import WireError
from dsr.network.decoding import decoded
from dsr.network.keys import Keys
from dsr.network.transport import Transport
from dsr.runtime.activity import WorldUse

PERIOD = 1.0
"""s between two statuses of an agent."""
SILENT_AFTER = 3.0
"""s without a word from an agent until it counts as silent (it hangs, or its process is gone)."""
MOST_BYTES = 1 << 17
"""Bytes of a status: one that tells of the most worlds, and cites the longest error, takes half of that."""
MOST_TEXT = 4096
"""Characters of an error that a status cites"""
MOST_AGENTS = 1000
"""Agents whose statuses are kept, as many as replicas are listened to: made-up names must take no memory."""

T = TypeVar("T")
_log = logging.getLogger("dsr.runtime.status")


class State(enum.StrEnum):
    """The state of an agent in its life."""

    STARTING = "starting"
    READY = "ready"
    """The agent was set up and its last tick succeeded."""
    DEGRADED = "degraded"
    """The agent works, but not as it should: see the last error."""
    STOPPED = "stopped"
    FAILED = "failed"
    """The agent gave up; its process ends."""


class Status(msgspec.Struct, frozen=True, kw_only=True):
    """The condition of one agent, as it travels (a MessagePack map)."""

    agent: str
    rid: str
    """Replica id: new with each start of the agent."""
    pid: int
    state: State
    rate_hz: float = 0.0
    """Measured ticks a second."""
    tick_ms_p50: float = 0.0
    """Median duration of the last ticks, ms."""
    tick_ms_p95: float = 0.0
    missed: int = 0
    """Ticks left out because an earlier one took too long."""
    behind: float = 0.0
    """Time (s) since the agent's memory has known that it lacks changes of the graph; 0 if it lacks none."""
    errors: int = 0
    """Failed ticks since the start."""
    restarts: int = 0
    """Number of restarts of the agent by its launcher."""
    last_error: str = ""
    stamp: float = 0.0
    """Time of the status, s since the Unix epoch."""
    clock: str = ""
    """Fault of the agent's clock, or of another one, in words; empty if all agree."""
    worlds: list[WorldUse] = []
    """The agent's use of each world."""
    waiting: float = 0.0
    """Share of the last second in which the agent was ready to go on and its machine had no processor free."""
    overloaded: bool = False
    """Whether the agent left out ticks while it waited so: the machine has more to do than it can."""
    counts: dict[str, int] = {}
    """What the agent counts of its own work, by name, since its start."""


_encoder = msgspec.msgpack.Encoder()
_decoder = msgspec.msgpack.Decoder(Status)


def encode_status(status: Status) -> bytes:
    """The status as a message for `Keys.status`; a long error is cut."""
    if len(status.last_error) > MOST_TEXT:
        status = replace(status, last_error=status.last_error[:MOST_TEXT])
    return _encoder.encode(status)


def decode_status(payload: bytes) -> Status:
    """The status of a message; raises `WireError`, also for a message of more than `MOST_BYTES`."""
    if len(payload) > MOST_BYTES:
        raise WireError(f"status of {len(payload)} bytes; at most {MOST_BYTES}")
    return decoded(payload, "status", _decoder.decode)


def keep_newest(newest: dict[str, T], agent: str, value: T) -> bool:
    """Keep what came of an agent; of more than `MOST_AGENTS` the one goes that was heard longest ago.

    Returns whether one went.
    """
    newest.pop(agent, None)
    newest[agent] = value
    if len(newest) <= MOST_AGENTS:
        return False
    del newest[next(iter(newest))]
    return True


class Heard(NamedTuple):
    """The newest status of an agent, and how it arrived."""

    status: Status
    at: float
    """s, on the listener's monotonic clock."""
    latency: float
    """s from its stamp until it arrived; with clocks apart, off by their difference."""


class StatusBoard:
    """The newest status of the agents of one graph, as heard on the bus: of at most `MOST_AGENTS`."""

    def __init__(self, bus: Transport, keys: Keys, clock: Clock) -> None:
        self.malformed = 0
        """Messages dropped because they were no valid status."""
        self.forgotten = 0
        """Statuses forgotten because others came of more agents than are kept."""
        self._clock = clock
        self._newest: dict[str, Heard] = {}
        self._lock = threading.Lock()
        self._subscription = bus.subscribe(keys.status(), self._receive)

    def agents(self) -> list[str]:
        """Names of the agents that were heard."""
        with self._lock:
            return sorted(self._newest)

    def get(self, agent: str) -> Heard | None:
        """The newest status of `agent`, or None before the first."""
        with self._lock:
            return self._newest.get(agent)

    def is_silent(self, agent: str) -> bool:
        """Whether `agent` was not heard for `SILENT_AFTER` seconds although it never said that it stops."""
        heard = self.get(agent)
        if heard is None:
            return True
        stopped = heard.status.state in (State.STOPPED, State.FAILED)
        return not stopped and self._clock.monotonic() - heard.at > SILENT_AFTER

    def close(self) -> None:
        """Stop listening; harmless when repeated."""
        self._subscription.close()

    def _receive(self, key: str, payload: bytes) -> None:
        try:
            status = decode_status(payload)
            if status.agent != key.rpartition("/")[2]:
                raise WireError(f"status: agent {status.agent!r} sent it on {key!r}")
        except WireError as error:
            self.malformed += 1
            if self.malformed == 1:
                _log.warning("dropped a message on %s: %s (further ones are only counted)", key, error)
            return
        heard = Heard(status, self._clock.monotonic(), self._clock.now() - status.stamp)
        with self._lock:
            self.forgotten += keep_newest(self._newest, status.agent, heard)
