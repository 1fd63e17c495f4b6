"""What an attack is, where it runs, and what it reports."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

from dsr.crdt.delta import Delta
from dsr.memory import Memory
from dsr.network.keys import Keys
from dsr.network.transport import Qos, Transport
from dsr.replication.wire import encode_delta
from dsr.security.policy import Grant

GRAPH = "attacked"
"""Name of the graph in which attacks run."""


@dataclass(frozen=True)
class Raw:
    """A peer that speaks the protocol itself, and checks nothing of what it sends.

    Attributes:
        rid: the replica id under which it speaks.
        transport: its connection; in a secured graph with the certificate of its agent.
        keys: those of the base world.
    """

    rid: str
    transport: Transport
    keys: Keys

    def send(self, delta: Delta, rid: str | None = None) -> None:
        """Publish a delta as this replica, or as another one that `rid` names."""
        self.transport.publish(self.keys.delta(rid or self.rid), encode_delta(delta))

    def send_digest(self, payload: bytes, rid: str | None = None) -> None:
        """Publish a digest, likewise."""
        self.transport.publish(self.keys.digest(rid or self.rid), payload, Qos.STREAM)


class Arena(Protocol):
    """A network on which an attack runs: real or in memory, open or secured."""

    secured: bool

    def now(self) -> float:
        """Physical time of all that take part, s."""

    def join(self, agent: str) -> Memory:
        """A memory of the attacked graph, complete."""

    def raw(self, agent: str) -> Raw:
        """A raw peer; in a secured graph it has the certificate of `agent`."""

    def wait(self, seconds: float) -> None:
        """Let messages travel for this long."""

    def eventually(self, condition: Callable[[], object], seconds: float) -> bool:
        """Let messages travel until `condition` holds; false if it does not within `seconds`."""


@dataclass(frozen=True)
class Outcome:
    """What an attack achieved."""

    held: bool
    """Whether what must hold did."""
    effect: str
    """What was measured, in a few words."""
    figures: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Attack:
    """One attack.

    Attributes:
        name: by which it is asked for.
        sentence: what the attacker does.
        holds: what must hold all the same.
        run: does it, bounded in count and time.
        grants: of all agents, if it runs in a secured graph, too; the attacker's certificate is one of these.
        open: whether it runs in an open graph.
    """

    name: str
    sentence: str
    holds: str
    run: Callable[[Arena], Outcome]
    grants: Mapping[str, Grant] = field(default_factory=dict)
    open: bool = True

    @property
    def settings(self) -> list[str]:
        """In which graphs it runs: `open`, `secured`."""
        return [*(["open"] if self.open else []), *(["secured"] if self.grants else [])]
