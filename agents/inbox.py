"""Messages from the bus that wait for an agent's next tick, bounded in number."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

from dsr.clock import Clock
from dsr.network.transport import Transport


class Message(NamedTuple):
    """A message as it arrived."""

    stamp: float
    """Time (s) when the message arrived"""
    key: str
    payload: bytes


class Inbox:
    """Collects the messages on its keys until they are taken; beyond `most`, the oldest are dropped and counted."""

    def __init__(self, bus: Transport, keys: str | Iterable[str], clock: Clock, most: int) -> None:
        self.dropped = 0
        """Messages lost because nobody took them in time."""
        self._clock = clock
        self._waiting: deque[Message] = deque(maxlen=most)
        keys = [keys] if isinstance(keys, str) else keys
        self._subscriptions = [bus.subscribe(key, self._receive) for key in keys]

    def take(self) -> list[Message]:
        """Return all messages since the last call, in the order in which they came."""
        return [self._waiting.popleft() for _ in range(len(self._waiting))]

    def close(self) -> None:
        """Stop collecting."""
        for subscription in self._subscriptions:
            subscription.close()

    def _receive(self, key: str, payload: bytes) -> None:
        if len(self._waiting) == self._waiting.maxlen:
            self.dropped += 1
        self._waiting.append(Message(self._clock.now(), key, payload))
