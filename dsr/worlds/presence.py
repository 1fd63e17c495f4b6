"""Tells which process has which world open, without opening any."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

from dsr.network.keys import BASE, Keys
from dsr.network.transport import Subscription
from dsr.replication.peers import MAX_PEERS
from dsr.worlds.registry import records

if TYPE_CHECKING:
    from dsr.memory import Memory

_NONE = ""
"""Stands for the channel of the base."""


class WorldPresence:
    """Follows which replicas of each world announce themselves, the base's included.

    Args:
        memory: of the base.
    """

    def __init__(self, memory: Memory) -> None:
        self._memory = memory
        self._tokens: dict[str, set[str]] = {}
        self._watches: dict[str, Subscription] = {}
        self.follow()

    def follow(self) -> None:
        """Take in which worlds there are now."""
        channels = {record.channel: record.info.name for record in records(self._memory.replica.graph)}
        keys = {channel: Keys(self._memory.graph_name, name, channel) for channel, name in channels.items()}
        keys[_NONE] = self._memory.keys
        for channel in self._watches.keys() - keys.keys():
            self._watches.pop(channel).close()
        for channel in keys.keys() - self._watches.keys():
            self._watches[channel] = self._watch(channels.get(channel, BASE), keys[channel])

    def agents(self, but: Collection[str] = ()) -> dict[str, list[str]]:
        """Names of those who have each world open, by world, without those in `but`."""
        names = [info.name for info in self._memory.worlds()]
        return {
            name: sorted({token.split("/")[-2] for token in tuple(self._tokens.get(name, ()))}.difference(but))
            for name in names
        }  # fmt: skip

    def close(self) -> None:
        """Listen no longer."""
        for watch in self._watches.values():
            watch.close()
        self._watches = {}

    def _watch(self, world: str, keys: Keys) -> Subscription:
        present = self._tokens[world] = set()

        def note(token: str, alive: bool) -> None:
            if not alive:
                present.discard(token)
            elif len(present) < MAX_PEERS:
                present.add(token)

        return self._memory.transport.watch_presence(keys.presence(), note)
