"""Who provides and who reads which world of a running system, as its agents tell and its replicas show."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import msgspec

from dsr.keys import Keys
from dsr.runtime.activity import WorldUse
from dsr.runtime.status import Status, StatusBoard
from dsr.transport import Subscription
from dsr.worlds.registry import Record, WorldInfo, records

if TYPE_CHECKING:
    from dsr.memory import Memory

WAITED_FOR = "waited for"
"""State of a world that an agent names and that is not there."""


class ClientInfo(msgspec.Struct, frozen=True):
    """A process that has to do with worlds."""

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
    """Agents that write it."""
    readers: list[str]
    """Agents that read it, and other processes that have it open."""
    last_write: float | None
    """s since the Unix epoch, of those writers that tell."""
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
    """What these statuses amount to.

    Args:
        worlds: those that are there.
        statuses: the newest of each agent.
        silent: agents that say nothing any more.
        present: by world the agents that have it open, whether they tell a status or not.
    """
    quiet = set(silent)
    clients = {
        status.agent: ClientInfo(
            status.agent, "silent" if status.agent in quiet else str(status.state), list(status.worlds)
        )
        for status in statuses
    }
    for world, agents in (present or {}).items():
        for agent in set(agents) - {name for name, client in clients.items() if client.state}:
            known = clients.get(agent, ClientInfo(agent, "", []))
            clients[agent] = ClientInfo(agent, "", [*known.uses, WorldUse(world=world, reads=True)])
    ordered = [clients[name] for name in sorted(clients)]
    there = {info.name: info for info in worlds}
    named = {use.world for client in ordered for use in client.uses}
    missing = {name: WorldInfo(name) for name in sorted(named - there.keys())}
    entries = [_entry(info, info.name in there, ordered) for info in (*there.values(), *missing.values())]
    return Topology(entries, ordered)


def _entry(info: WorldInfo, there: bool, clients: list[ClientInfo]) -> WorldEntry:
    uses = [(client.agent, use) for client in clients for use in client.uses if use.world == info.name]
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
        self._present: dict[str, set[str]] = {}
        self._watches: dict[str, Subscription] = {}
        self._follow()

    def look(self) -> Topology:
        """What is known now; statuses come once a second."""
        self._follow()
        heard = [found for name in self._board.agents() if name not in self._but and (found := self._board.get(name))]
        return topology(
            self._memory.worlds(),
            [one.status for one in heard],
            silent=[one.status.agent for one in heard if self._board.is_silent(one.status.agent)],
            present=self._agents_present(),
        )

    def close(self) -> None:
        """Listen no longer."""
        self._board.close()
        for watch in self._watches.values():
            watch.close()
        self._watches = {}

    def _follow(self) -> None:
        """Look who is present in each world that there is."""
        found = {record.channel: record for record in records(self._memory.replica.graph)}
        for channel in self._watches.keys() - found.keys():
            self._watches.pop(channel).close()
        for channel in found.keys() - self._watches.keys():
            self._watches[channel] = self._watch(found[channel])

    def _watch(self, record: Record) -> Subscription:
        keys = Keys(self._memory.graph_name, record.info.name, record.channel)
        present = self._present[record.info.name] = set()

        def note(key: str, alive: bool) -> None:
            (present.add if alive else present.discard)(key)

        return self._memory.transport.watch_presence(keys.presence(), note)

    def _agents_present(self) -> dict[str, list[str]]:
        """By world; a token's key ends with agent and replica id."""
        names = [info.name for info in self._memory.worlds()]
        return {
            name: sorted({key.split("/")[-2] for key in list(self._present.get(name, ()))} - self._but)
            for name in names
        }  # fmt: skip
