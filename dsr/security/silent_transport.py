"""A transport that only listens and asks: for a read-only member of a secured graph."""

from __future__ import annotations

from collections.abc import Callable

from dsr.errors import TransportError
from dsr.network.keys import Keys, agent_of
from dsr.network.transport import (
    BulkHandler,
    Chunks,
    Mailbox,
    MessageHandler,
    PresenceHandler,
    Qos,
    RequestHandler,
    Subscription,
    Transport,
)


class _Nothing:
    def close(self) -> None: ...


class SilentTransport:
    """Passes on arriving messages; messages that keep others in step are not sent, all else is refused."""

    shares_memory = False

    def __init__(self, transport: Transport, keys: Keys, rid: str) -> None:
        self._transport = transport
        self._root = f"{keys.root}/"
        self._replicas = f"{agent_of(rid)}-"

    @property
    def trouble(self) -> str:
        """See `Transport.trouble`."""
        return self._transport.trouble

    def publish(self, key: str, payload: bytes, qos: Qos = Qos.RELIABLE) -> None:
        """Raise `TransportError`, but for the replica's own upkeep, which is left out."""
        *_, kind, sender = key.split("/")  # of whichever world or part
        upkeep = key.startswith(self._root) and kind in ("d", "rt", "dig") and sender.startswith(self._replicas)
        if not upkeep:
            raise _read_only(key)

    def is_heard(self, key: str, qos: Qos = Qos.RELIABLE) -> bool:
        """Nobody hears a reader."""
        return False

    def publish_bulk(self, key: str, chunks: Chunks) -> None:
        """Raise `TransportError`."""
        raise _read_only(key)

    def newest(self, key: str, notify: Callable[[], None]) -> Mailbox:
        """See `Transport.newest`."""
        return self._transport.newest(key, notify)

    def subscribe(self, key: str, handler: MessageHandler, *, newest: int | None = None) -> Subscription:
        """See `Transport.subscribe`."""
        return self._transport.subscribe(key, handler, newest=newest)

    def subscribe_bulk(self, key: str, handler: BulkHandler) -> Subscription:
        """See `Transport.subscribe_bulk`."""
        return self._transport.subscribe_bulk(key, handler)

    def serve(
        self, key: str, handler: RequestHandler, *, asker: Callable[[bytes], str] | None = None
    ) -> Subscription:
        """Do nothing: nobody would believe the answers."""
        return _Nothing()

    def request(
        self, key: str, payload: bytes, on_reply: MessageHandler, on_done: Callable[[], None], timeout: float
    ) -> None:
        """See `Transport.request`."""
        self._transport.request(key, payload, on_reply, on_done, timeout)

    def announce(self, key: str) -> Subscription:
        """Do nothing: others need not wait for a reader."""
        return _Nothing()

    def watch_presence(self, key: str, handler: PresenceHandler) -> Subscription:
        """See `Transport.watch_presence`."""
        return self._transport.watch_presence(key, handler)

    def renew(self) -> None:
        """See `Transport.renew`."""
        self._transport.renew()

    def pump(self) -> None:
        """See `Transport.pump`."""
        self._transport.pump()

    def close(self) -> None:
        """Leave the network."""
        self._transport.close()


def _read_only(key: str) -> TransportError:
    return TransportError(f"cannot publish on {key}: this certificate is read-only")
