"""The identity of this process in a secured working memory: certificate, grant and rules of a security folder."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dsr.clock import WALL_CLOCK, Clock
from dsr.errors import AgentError
from dsr.graph.access import WriteGuard
from dsr.network.keys import Keys, agent_of
from dsr.network.transport import Transport
from dsr.security.authority import SecurityFolder
from dsr.security.configuration import zenoh_settings
from dsr.security.gate import Gate
from dsr.security.policy import AccessPolicy, Grant, read_policy
from dsr.security.silent_transport import SilentTransport


@dataclass(frozen=True)
class Identity:
    """An agent with a valid certificate."""

    agent: str
    grant: Grant
    policy: AccessPolicy
    zenoh: dict[str, Any]
    """Settings of its Zenoh session."""
    files: SecurityFolder
    """The folder with the agent's certificate."""

    def trusts(self, rid: str) -> bool:
        """Whether replica `rid` may speak for others."""
        grant = self.policy.agents.get(agent_of(rid))
        return grant is not None and grant.trusted

    def own_transport(self, transport: Transport, keys: Keys, rid: str) -> Transport:
        """Restrict the transport for replica `rid` of this agent: a read-only one stays silent."""
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

    def check_part(self, part: str) -> None:
        """Raise `AgentError` if others would refuse all writes into a part of the graph."""
        if not self.grant.includes_part(part):
            raise AgentError(f"{self.agent!r} may not write into part {part!r} by the security policy; "
                             f"granted: {', '.join(self.grant.parts) or 'none'}")  # fmt: skip


def load_identity(folder: str | Path, agent: str, clock: Clock = WALL_CLOCK) -> Identity:
    """The identity of `agent` in a security folder.

    Raises `ConfigError` if the folder has no policy, or the agent no valid certificate in it.
    """
    files = SecurityFolder(Path(folder))
    policy = read_policy(files.policy)
    grant = policy.grant(agent)
    files.check(agent, clock.now())
    return Identity(agent, grant, policy, zenoh_settings(files, policy, agent), files)
