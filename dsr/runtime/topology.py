"""Tells which agent provides and which reads each world of a running system, by statuses and open replicas."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import msgspec

from dsr.runtime.activity import WorldUse
from dsr.runtime.status import Status, StatusBoard
from dsr.worlds.presence import WorldPresence
from dsr.worlds.registry import WorldInfo

if TYPE_CHECKING:
    from dsr.memory import Memory

WAITED_FOR = "waited for"
"""State of a world that an agent names and that is not there."""


class ClientInfo(msgspec.Struct, frozen=True):
    """A process that reads or writes worlds."""

    agent: str
    state: str
    """As its status says; `silent` if it says nothing any more, empty for a process that never did."""
    uses: list[WorldUse]


class WorldEntry(msgspec.Struct, frozen=True):
    """A world and who has to do with it."""

    info: WorldInfo
    there: bool
    """False for one that agents only wait for."""
    providers: list[str]
    """Agents that write it, and another process that made it and has it open."""
    readers: list[str]
    """Agents that read it, and other processes that have it open."""
    last_write: float | None
    """Time of the last write, s since the Unix epoch, of the writers that tell."""
    write_hz: float
    """Changes a second."""


class Topology(msgspec.Struct, frozen=True):
    """The worlds of a system and its agents."""

    worlds: list[WorldEntry]
    clients: list[ClientInfo]


def topology(
    worlds: Iterable[WorldInfo],
    statuses: Iterable[Status],
    *,
    silent: Iterable[str] = (),
    present: Mapping[str, Iterable[str]] | None = None,
) -> Topology:
    """Combine these statuses into the topology of the worlds.

    Args:
        worlds: those that are there.
        statuses: the newest of each agent.
        silent: agents that say nothing any more.
        present: by world the agents that have it open, whether they tell a status or not.
    """
    quiet, there = set(silent), {info.name: info for info in worlds}
    clients = {status.agent: _client(status, status.agent in quiet) for status in statuses}
    for world, agents in (present or {}).items():
        for agent in set(agents) - {name for name, client in clients.items() if client.state}:
            known = clients.get(agent, ClientInfo(agent, "", []))
            use = _use_of(agent, there.get(world, WorldInfo(world)))
            clients[agent] = ClientInfo(agent, "", [*known.uses, use])
    ordered = [clients[name] for name in sorted(clients)]
    uses: dict[str, list[tuple[str, WorldUse]]] = {}
    for client in ordered:
        for use in client.uses:
            uses.setdefault(use.world, []).append((client.agent, use))
    missing = {name: WorldInfo(name) for name in sorted(uses.keys() - there.keys())}
    worlds = (*there.values(), *missing.values())
    return Topology([_entry(info, info.name in there, uses.get(info.name, [])) for info in worlds], ordered)


def _client(status: Status, is_silent: bool) -> ClientInfo:
    """An agent by its status; one that says nothing any more does nothing any more."""
    if not is_silent:
        return ClientInfo(status.agent, str(status.state), list(status.worlds))
    uses = [msgspec.structs.replace(use, read_hz=0.0, write_hz=0.0) for use in status.worlds]
    return ClientInfo(status.agent, "silent", uses)


def _use_of(agent: str, world: WorldInfo) -> WorldUse:
    """What can be said of a process that has a world open and tells no status: it writes what it made."""
    return WorldUse(world=world.name, reads=True, writes=agent == world.creator)


def _entry(info: WorldInfo, there: bool, uses: list[tuple[str, WorldUse]]) -> WorldEntry:
    return WorldEntry(
        info=info,
        there=there,
        providers=[agent for agent, use in uses if use.writes],
        readers=[agent for agent, use in uses if use.reads],
        last_write=max((use.last_write for _, use in uses if use.writes and use.last_write), default=None),
        write_hz=sum(use.write_hz for _, use in uses if use.writes),
    )


class TopologyObserver:
    """Follows a running system from one of its memories, which opens no world for that.

    Args:
        memory: of the base.
        but: agents that are left out: who looks.
    """

    def __init__(self, memory: Memory, but: Iterable[str] = ()) -> None:
        self._memory = memory
        self._but = frozenset(but)
        self._board = StatusBoard(memory.transport, memory.keys, memory.clock)
        self._presence = WorldPresence(memory)

    def look(self) -> Topology:
        """Return the present topology; statuses come once a second."""
        self._presence.follow()
        heard = [found for name in self._board.agents() if name not in self._but and (found := self._board.get(name))]
        return topology(
            self._memory.worlds(),
            [one.status for one in heard],
            silent=[one.status.agent for one in heard if self._board.is_silent(one.status.agent)],
            present=self._presence.agents(but=self._but),
        )

    def close(self) -> None:
        """Listen no longer."""
        self._board.close()
        self._presence.close()
