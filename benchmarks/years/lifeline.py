"""Kills a process at any of the moments at which it touches the world: each call of the network or the disk.

Between two such calls nothing that a process does can be seen from outside. So a kill at each of them is a kill at
every moment that matters.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

from dsr.network.local_transport import LocalTransport

_CALLS = ("publish", "request", "subscribe", "serve", "watch_presence", "announce", "is_heard", "renew")
"""What a memory calls of its transport."""


class KilledError(BaseException):
    """A process is dead: nothing that it would still do happens. No handler of errors may catch this."""


class Lifeline:
    """The life of one process.

    Args:
        kills: counts, over all processes, at which kinds of calls they were killed.
    """

    def __init__(self, kills: Counter[str]) -> None:
        self._kills = kills
        self._left: int | None = None
        self.cut = False
        """Whether the process is dead."""

    def arm(self, calls: int) -> None:
        """Let it die at the call after so many others."""
        self._left = calls

    def disarm(self) -> None:
        """Let it live."""
        self._left = None

    def reach(self, call: str) -> None:
        """Note that the process is about to make a call of this kind. Raises `KilledError` if it is or falls dead."""
        if self._left is not None and not self.cut:
            self._left -= 1
            if self._left < 0:
                self.cut = True
                self._kills[call] += 1
        if self.cut:
            raise KilledError(call)

    def watch(self, transport: LocalTransport) -> LocalTransport:
        """Let each call of a transport be a moment at which the process may die."""
        for name in _CALLS:
            setattr(transport, name, self._watched(name, getattr(transport, name)))
        return transport

    def _watched(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def watched(*arguments: Any, **options: Any) -> Any:
            self.reach(name)
            return call(*arguments, **options)

        return watched
