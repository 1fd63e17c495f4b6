"""Tells which process has which world open, without opening any."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

from dsr.graph.shares import shared_by
from dsr.network.keys import BASE, Keys, agent_of
from dsr.network.transport import Subscription
from dsr.replication.peers import MAX_PEERS
from dsr.worlds.registry import records

if TYPE_CHECKING:
    from dsr.memory import Memory

MOST_FOLLOWED = 256
"""Worlds whose replicas are followed, each by a subscription: as many as the keeper of a state keeps."""
_NONE = ""
"""Stands for the channel of the base."""


class WorldPresence:
    """Follows which replicas of each world announce themselves, the base's included: of at most `MOST_FOLLOWED` worlds.

    Of more it follows as many of each agent's as of others.

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
        listed = list(records(self._memory.replica.graph))
        followed = shared_by(listed, MOST_FOLLOWED, lambda record: [agent_of(rid) for rid, _ in record.dots])
        channels = {record.channel: record.info.name for record in followed}
        keys = {channel: Keys(self._memory.graph_name, name, channel) for channel, name in channels.items()}
        keys[_NONE] = self._memory.keys
        for channel in self._watches.keys() - keys.keys():
            self._watches.pop(channel).close()
        for channel in keys.keys() - self._watches.keys():
            self._watches[channel] = self._watch(channels.get(channel, BASE), keys[channel])
        for world in self._tokens.keys() - {BASE, *channels.values()}:
            del self._tokens[world]

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
