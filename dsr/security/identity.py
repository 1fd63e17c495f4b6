"""Who this process is in a secured working memory: its certificate, grant and rules, loaded from a security folder."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dsr.clock import WALL_CLOCK, Clock
from dsr.errors import AgentError, TransportError
from dsr.graph.access import WriteGuard
from dsr.network.keys import Keys, agent_of
from dsr.network.transport import (
    Chunks,
    Mailbox,
    MessageHandler,
    PresenceHandler,
    Qos,
    RequestHandler,
    Subscription,
    Transport,
)
from dsr.security.authority import SecurityFolder
from dsr.security.configuration import zenoh_settings
from dsr.security.gate import Gate
from dsr.security.policy import Grant, Policy, read_policy


class _Nothing:
    def close(self) -> None: ...


class SilentTransport:
    """Passes on what arrives; what the replica says to keep others in step is not sent, all else is refused."""

    shares_memory = False

    def __init__(self, transport: Transport, keys: Keys, rid: str) -> None:
        self._transport = transport
        self._root = f"{keys.root}/"
        self._rid = rid

    @property
    def trouble(self) -> str:
        """See `Transport.trouble`."""
        return self._transport.trouble

    def publish(self, key: str, payload: bytes, qos: Qos = Qos.RELIABLE) -> None:
        """Raise `TransportError`, but for the replica's own upkeep, which is left out."""
        *_, kind, sender = key.split("/")  # in whichever world; the ids of its replicas there begin with ours
        upkeep = key.startswith(self._root) and kind in ("d", "rt", "dig") and sender.startswith(self._rid)
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


@dataclass(frozen=True)
class Identity:
    """An agent with a valid certificate."""

    agent: str
    grant: Grant
    policy: Policy
    zenoh: dict[str, Any]
    """Settings of its Zenoh session."""
    files: SecurityFolder
    """Where its certificate is."""

    def trusts(self, rid: str) -> bool:
        """Whether that replica may speak for others."""
        grant = self.policy.agents.get(agent_of(rid))
        return grant is not None and grant.trusted

    def own_transport(self, transport: Transport, keys: Keys, rid: str) -> Transport:
        """What replica `rid` of this agent may use of its transport: a read-only one stays silent."""
        return SilentTransport(transport, keys, rid) if self.grant.read_only else transport

    def gate(self) -> Gate:
        """A new gate for a replica of this agent."""
        return Gate(self.policy)

    def guard(self, element: str, kind: str, attributes: Iterable[str]) -> None:
        """Raise `AgentError` for a write that the other replicas would refuse; see `dsr.memory.Guard`."""
        if self.grant.read_only:
            raise AgentError(f"the certificate of {self.agent!r} is read-only: it cannot write a {kind}")
        try:
            WriteGuard(self.agent, self.grant.writes)(element, kind, attributes)
        except AgentError as error:
            raise AgentError(f"{error} in the security policy; see: dsr security show") from None


def load_identity(folder: str | Path, agent: str, clock: Clock = WALL_CLOCK) -> Identity:
    """The identity of `agent` in a security folder.

    Raises `ConfigError` if the folder has no policy, or the agent no valid certificate in it.
    """
    files = SecurityFolder(Path(folder))
    policy = read_policy(files.policy)
    grant = policy.grant(agent)
    files.check(agent, clock.now())
    return Identity(agent, grant, policy, zenoh_settings(files, policy, agent), files)
