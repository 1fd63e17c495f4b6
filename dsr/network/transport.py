"""The interface of a network that the memory and the drivers use; every real or in-memory link implements it.

Keys are slash-separated (`dsr/v1/<graph>/d/<rid>`); in subscriptions `*` matches one part and `**`
any number of parts at the end. What comes on a pattern, or is announced as one, is dropped.

Handlers are called from the network's thread: they must return at once (put the message on a queue) and must not call
back into the transport. Only a subscription to the newest n messages has a thread of its own, in which its handler may
take its time.
"""

from __future__ import annotations

import enum
import functools
from collections.abc import Callable, Sequence
from typing import Protocol

Chunks = Sequence[bytes | memoryview]
"""A message in pieces; each piece is of bytes (format `B`)."""

MessageHandler = Callable[[str, bytes], None]
"""Called with (key, payload) of a message."""
BulkHandler = Callable[[str, bytes | memoryview], None]
"""Called with (key, payload) of a large message, which may lie in memory that its writer shares."""
RequestHandler = Callable[[str, bytes], bytes | None]
"""Called with (key, payload) of a request; returns the reply, or None to stay silent."""
PresenceHandler = Callable[[str, bool], None]
"""Called with (key, alive) when an announced key appears or goes."""


MAX_ASKERS = 64
"""Requests that may wait for whoever answers only one of each asker."""


class Qos(enum.Enum):
    """Quality of service of a message: what happens to it when a link is slow."""

    __hash__ = object.__hash__  # that of `Enum` is written in Python, and one is needed for each message

    RELIABLE = "reliable"
    """Kept and sent before everything else; the sender waits (deltas)."""
    STREAM = "stream"
    """Dropped when the link is congested; a newer one follows (poses, joint states, digests)."""
    BULK = "bulk"
    """Dropped when congested, lowest priority; for large messages (camera frames), see `publish_bulk`."""


class Subscription(Protocol):
    """A declaration that can be taken back."""

    def close(self) -> None:
        """Take the declaration back; harmless when repeated."""


class Mailbox(Protocol):
    """Holds the newest message of a key until it is taken."""

    def take(self) -> bytes | memoryview | None:
        """The newest message if it was not taken before. Raises `WireError` if what came is malformed."""

    def close(self) -> None:
        """Stop receiving; harmless when repeated."""


class Transport(Protocol):
    """A connection to the network."""

    @property
    def trouble(self) -> str:
        """Describe a problem of this connection in words, such as a certificate that ends; empty if there is none."""

    @property
    def shares_memory(self) -> bool:
        """Whether processes at its other ends may be on this machine, and read what one of them has in memory."""

    def publish(self, key: str, payload: bytes, qos: Qos = Qos.RELIABLE) -> None:
        """Send `payload` to all current subscribers of `key`, except those on this same connection."""

    def publish_bulk(self, key: str, chunks: Chunks) -> None:
        """Send a large message with `Qos.BULK`; the pieces are copied at most once for all readers on this machine."""

    def is_heard(self, key: str, qos: Qos = Qos.RELIABLE) -> bool:
        """Whether anybody elsewhere subscribes to `key` now, on which one would publish with `qos`."""

    def subscribe(self, key: str, handler: MessageHandler, *, newest: int | None = None) -> Subscription:
        """Call `handler` with each message on `key`; with `newest`, a slow handler skips all but the newest n."""

    def newest(self, key: str, notify: Callable[[], None]) -> Mailbox:
        """Receive the newest large message of `key`, without a copy where its writer is on this machine.

        `notify` is called from the network's thread whenever one has come.
        """

    def subscribe_bulk(self, key: str, handler: BulkHandler) -> Subscription:
        """Call `handler` with each large message on `key`, without a copy where its writer is on this machine.

        The handler is called from a thread of the subscription. A payload stays while it is referred to.
        """

    def serve(
        self, key: str, handler: RequestHandler, *, asker: Callable[[bytes], str] | None = None
    ) -> Subscription:
        """Answer requests on `key`. The handler may be called from any thread.

        With `asker`, which tells who sent a request, only the newest request of each is answered of those that wait,
        and no more than `MAX_ASKERS` wait: the others learn at once that no answer comes. Such answers are long, so a
        request on a pattern gets none: one short message would have everybody answer.
        """

    def request(
        self, key: str, payload: bytes, on_reply: MessageHandler, on_done: Callable[[], None], timeout: float
    ) -> None:
        """Ask whoever serves `key`, or all who serve a key that matches it.

        `on_reply` is called per answer, with the key that is served, then `on_done` exactly once (also on time-out).
        """

    def announce(self, key: str) -> Subscription:
        """Let others see `key` as alive until closed, or until this process dies."""

    def watch_presence(self, key: str, handler: PresenceHandler) -> Subscription:
        """Call `handler` for each announced key that matches: first the present ones, then each change."""

    def renew(self) -> None:
        """Declare the subscriptions and services again: a network that has changed may have forgotten them."""

    def pump(self) -> None:
        """Hand over what is under way, in a network where nothing moves by itself; elsewhere nothing is to be done."""

    def close(self) -> None:
        """Leave the network; harmless when repeated."""


def names_one(key: str) -> bool:
    """Whether `key` tells who sent what came on it: whoever is called by a pattern would be asked as all who match."""
    return "*" not in key


@functools.lru_cache(maxsize=4096)
def key_matches(pattern: str, key: str) -> bool:
    """Whether `key` matches `pattern` (`*` is one part, a final `**` any number of parts)."""
    wanted, parts = pattern.split("/"), key.split("/")
    if wanted[-1] == "**":
        wanted, parts = wanted[:-1], parts[: len(wanted) - 1]
    return len(wanted) == len(parts) and all(w in ("*", p) for w, p in zip(wanted, parts, strict=True))
