"""Joining a working memory over Zenoh: find the other processes, open a session, wait for the content."""

from __future__ import annotations

import atexit
import contextlib
import logging
import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from dsr.clock import WALL_CLOCK, Clock
from dsr.errors import ConfigError, ListenError, TransportError
from dsr.graph.access import Guard, guard_in
from dsr.graph.schema import Schema
from dsr.memory import Memory, new_rid
from dsr.network import rendezvous
from dsr.network.keys import Keys, check_interest
from dsr.network.transport import Transport

if TYPE_CHECKING:
    from dsr.security.identity import Identity

SECURITY = "DSR_SECURITY"
"""Environment variable: the security folder that everything uses which is told no other."""

INTEREST = "DSR_INTEREST"
"""Environment variable: names of parts, comma-separated, or "*" for all, which everything holds that is told no other.
"""

_log = logging.getLogger("dsr")
_PORT_ATTEMPTS = 5
"""A free port may be taken by somebody else before it is ours."""


def connect(
    graph: str,
    agent: str,
    *,
    connect: Iterable[str] = (),
    schema: Schema | None = None,
    clock: Clock = WALL_CLOCK,
    guard: Guard | None = None,
    timeout: float = 5.0,
    security: str | Path | None = None,
    begin: bool = False,
    must_exist: bool | None = None,
    interest: Iterable[str] | None = None,
) -> Memory:
    """Join the working memory `graph` over Zenoh and wait until all of it is here.

    The other processes of this user on this machine are found by the graph's name; the first one simply
    begins. One that does not answer is waited for, for it may hold what nobody else does. The memory owns its
    transport: closing it leaves the network. What is open when the program ends is closed.

    Args:
        graph: name of the graph; processes that use another name never meet.
        agent: what this process is called.
        connect: further endpoints, such as `tcp/HOST:7447` of a Zenoh router.
        schema: the vocabulary; the built-in one if None.
        clock: for stamps and waiting.
        guard: called before each write, see `Guard`.
        timeout: s to wait without anything of the graph's present content arriving.
        security: folder with the certificate of `agent` (`dsr security init`); by default, what the environment
            variable DSR_SECURITY names, if anything. Then only others with a certificate are met, and a write that
            the policy does not grant raises `AgentError`.
        begin: begin with what is here by then if some who hold the graph do not answer; the rest comes when they do.
        must_exist: whether somebody else must hold the graph. By default a warning says if nobody does; False
            means that the graph may begin here, without a word.
        interest: listed parts of the graph to hold, beside what is in no part, see `Memory.hold_part`; "*" for all. By
            default those that the environment variable DSR_INTEREST names. Without either the memory can hold none;
            with an empty interest it can later.

    Raises:
        ConfigError: for a name that cannot be used, an agent without a valid certificate, or if the graph must exist
            and nobody holds it.
        PartNotFoundError: if a part of this interest is not listed; the environment may name parts that will be.
        TransportError: if the network cannot be used, or some who hold the graph do not answer in time: says which.
    """
    rid = new_rid(agent)
    routers = list(connect)
    wanted, strict = (asked_for(), False) if interest is None else (check_interest(interest), True)
    identity = identity_of(agent, security)
    with contextlib.ExitStack() as resources:
        transport, registration = open_transport(
            graph, rid, routers, has_memory=identity is None or not identity.grant.read_only, identity=identity
        )
        resources.callback(transport.close)
        resources.callback(registration.close)
        memory = Memory(
            graph, agent, transport=transport, clock=clock, schema=schema, guard=_guard(guard, identity),
            gate=identity.gate() if identity else None, rid=rid, threaded=True,
            holders=lambda: _holders(graph, registration), interest=None if wanted is None else (),
        )  # fmt: skip
        memory.replica.on_new_id = registration.rename
        memory.on_close(resources.pop_all().close)
        atexit.register(memory.close)
        memory.on_close(lambda: atexit.unregister(memory.close))
        resources.callback(memory.close)
        _wait_joined(memory, timeout, all_known=not routers, begin=begin, secured=identity is not None)
        if must_exist is not False and not memory.peers:
            _tell_alone(graph, must_exist=must_exist is True)
        if wanted is not None:
            memory.hold_part(*wanted, timeout=timeout, unlisted=not strict)
        resources.pop_all()
    return memory


def asked_for(default: Iterable[str] | None = None) -> tuple[str, ...] | None:
    """The interest that the environment names, or else the default. Raises `ConfigError` for what no part is called."""
    told = interest_of(os.environ.get(INTEREST))
    if told is not None or default is None:
        return told
    return check_interest(default)


def interest_of(text: str | None) -> tuple[str, ...] | None:
    """The names in a text with commas between; None for none. Raises `ConfigError` for what no part is called."""
    return None if text is None else check_interest(name.strip() for name in text.split(",") if name.strip())


def _tell_alone(graph: str, *, must_exist: bool) -> None:
    """Say that nobody else holds a graph. Raises `ConfigError` if somebody must."""
    others = [name for name in rendezvous.graphs() if name != graph]
    running = f"running on this machine: {', '.join(others) or 'none'}"
    if must_exist:
        raise ConfigError(f"nobody holds graph {graph!r}; {running}")
    _log.warning("nobody else is in graph %r, which begins here, empty; %s", graph, running)


def _wait_joined(memory: Memory, timeout: float, *, all_known: bool, begin: bool, secured: bool) -> None:
    try:
        memory.wait_joined(timeout, all_known=all_known, begin=begin)
    except TransportError as error:
        if secured and not memory.peers:
            raise TransportError(f"{error}; are their certificates of another authority than ours?") from error
        raise


def identity_of(agent: str, security: str | Path | None = None) -> Identity | None:
    """Load the identity of `agent` from the security folder, or from the one that the environment names;

    None without any.

    Raises `ConfigError` if it has no valid certificate there.
    """
    folder = security or os.environ.get(SECURITY)
    if not folder:
        return None
    from dsr.security.identity import load_identity

    return load_identity(folder, agent)


def _guard(guard: Guard | None, identity: Identity | None) -> Guard | None:
    """Both what the agent declares and what the policy grants it."""
    if identity is None:
        return guard
    return _Both(guard, identity.guard, identity.check_part)


@dataclass(frozen=True)
class _Both:
    """The guard of what an agent declares, if it has one, and that of what it is granted: a write must pass both."""

    declared: Guard | None
    granted: Guard
    check_part: Callable[[str], None]

    def __call__(self, element: str, kind: str, attributes: Iterable[str]) -> None:
        names = tuple(attributes)
        if self.declared is not None:
            self.declared(element, kind, names)
        self.granted(element, kind, names)

    def in_world(self, world: str) -> _Both:
        """The guards in another world."""
        return _Both(guard_in(self.declared, world), self.granted, self.check_part)


def _holders(graph: str, registration: rendezvous.Registration) -> list[str]:
    """Replica ids of all others that hold a memory and live, also of those that came later; none if we are the first.

    Those later ones may have learned from seed peers that died before we did.
    """
    if not any(seed_peer.has_memory for seed_peer in registration.seed_peers):
        return []
    return [member.rid for member in rendezvous.members(graph) if member.has_memory and member.rid != registration.rid]


def open_transport(
    graph: str,
    rid: str,
    connect: Iterable[str] = (),
    *,
    has_memory: bool = False,
    identity: Identity | None = None,
) -> tuple[Transport, rendezvous.Registration]:
    """A Zenoh transport that meets the graph's other processes; the registration makes it be found by later ones.

    With `connect`, it joins the routers there and passes on between them and the processes of this machine. With an
    `identity` it takes part in a secured graph. Raises `ConfigError` if the others are not secured alike.
    """
    routers = list(connect)
    for _ in range(_PORT_ATTEMPTS - 1):
        with contextlib.suppress(ListenError):
            return _open_at_free_port(graph, rid, routers, has_memory, identity)
    return _open_at_free_port(graph, rid, routers, has_memory, identity)


def _open_at_free_port(
    graph: str, rid: str, connect: list[str], has_memory: bool, identity: Identity | None
) -> tuple[Transport, rendezvous.Registration]:
    from dsr.network.zenoh_transport import ZenohTransport

    protocol = "tls" if identity else "tcp"
    endpoint = f"{protocol}/127.0.0.1:{rendezvous.free_port()}"
    registration = rendezvous.Registration(graph, rid, endpoint, has_memory=has_memory)
    try:
        endpoints = [*(seed_peer.endpoint for seed_peer in registration.seed_peers), *connect]
        _check_protocol(graph, protocol, endpoints)
        if identity is None:
            return ZenohTransport(endpoint, endpoints, routing=bool(connect)), registration
        from dsr.security.renewal import watch_certificate  # needs `cryptography`, which is an extra

        transport = ZenohTransport(endpoint, endpoints, identity.zenoh, routing=bool(connect))
        watch_certificate(transport, identity)
        return identity.own_transport(transport, Keys(graph), rid), registration
    except BaseException:
        registration.close()
        raise


def _check_protocol(graph: str, protocol: str, endpoints: Iterable[str]) -> None:
    """Raise `ConfigError` for an endpoint that a process with our kind of security can never reach."""
    for endpoint in endpoints:
        if endpoint.startswith("tls/") and protocol != "tls":
            raise ConfigError(f"graph {graph!r} is secured ({endpoint}): give --security FOLDER or set {SECURITY}")
        if protocol == "tls" and not endpoint.startswith("tls/"):
            raise ConfigError(f"graph {graph!r} is not secured ({endpoint}), but this process is; unset {SECURITY}?")
