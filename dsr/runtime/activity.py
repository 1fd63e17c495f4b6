"""Counts the reads and writes of an agent in each world, for its status."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec

from dsr.network.keys import BASE

if TYPE_CHECKING:
    from dsr.agent import Agent
    from dsr.replication.replica import Replica

MOST_USES = 256
"""Worlds of which a status tells, as many as the keeper of a state has open at most."""
_WINDOW = 0.9
"""s over which rates are taken at least."""


class WorldUse(msgspec.Struct, frozen=True, kw_only=True):
    """The use of one world by an agent."""

    world: str
    reads: bool = False
    """Whether the agent declares that it reads the world, or has opened it."""
    writes: bool = False
    """Whether the agent declares that it writes the world, or has written to it."""
    read_hz: float = 0.0
    """Messages of others a second that it took in."""
    write_hz: float = 0.0
    """Changes a second that it made."""
    last_read: float | None = None
    """s since the Unix epoch, to about a second; None if there was nothing yet."""
    last_write: float | None = None


class _Count:
    """A number that grows: how fast, and when it did so last."""

    def __init__(self) -> None:
        self.hz = 0.0
        self.last: float | None = None
        self._count = 0
        self._since: float | None = None

    def sample(self, count: int, now: float) -> None:
        """Note that it is `count` at time `now` (s)."""
        if self._since is None:
            self._since = now
            self.last = now if count else self.last
        elif now - self._since >= _WINDOW:
            self.hz = (count - self._count) / (now - self._since)
            self.last = now if count > self._count else self.last
            self._since = now
        else:
            return
        self._count = count

    def rest(self) -> None:
        """Note that there is nothing to count any more; what is counted next begins at 0."""
        self.hz, self._count, self._since = 0.0, 0, None


class _Counts:
    """What a replica of a world took in and wrote."""

    def __init__(self) -> None:
        self.read, self.written = _Count(), _Count()
        self._replica: Replica | None = None

    def sample(self, replica: Replica | None, now: float) -> None:
        """Note how far that of now has come; None if the world is not open."""
        if replica is not self._replica:
            self.read.rest()
            self.written.rest()
            self._replica = replica
        if replica is not None:
            self.read.sample(replica.received, now)
            self.written.sample(replica.written, now)


class Activity:
    """Follows what one agent does in its worlds; to be asked about once a second."""

    def __init__(self, agent: Agent) -> None:
        self._agent = agent
        self._counts: dict[str, _Counts] = {}

    def uses(self, now: float) -> list[WorldUse]:
        """List the agent's use of each world at time `now` (s), by name of the world.

        Of more than `MOST_USES` worlds, those that the agent declares come first.
        """
        agent = self._agent
        if not agent.uses_memory:
            return []
        reads, writes = agent.world_names()
        opened = {memory.world_name: memory.replica for memory in agent.memory.opened_worlds()}
        declared = {*reads, *writes}
        names = sorted({*declared, *(name for name in opened if name != BASE)}, key=lambda n: (n not in declared, n))
        names = sorted(names[:MOST_USES])
        self._counts = {name: self._counts.get(name) or _Counts() for name in names}
        return [self._use(name, opened.get(name), name in reads, name in writes, now) for name in names]

    def _use(self, name: str, replica: Replica | None, reads: bool, writes: bool, now: float) -> WorldUse:
        counts = self._counts[name]
        counts.sample(replica, now)
        wrote = replica is not None and replica.written > 0
        return WorldUse(
            world=name,
            reads=reads or (replica is not None and not writes),
            writes=writes or (wrote and not reads),
            read_hz=counts.read.hz,
            write_hz=counts.written.hz,
            last_read=counts.read.last,
            last_write=counts.written.last,
        )
