"""Joining a working memory over Zenoh: find the other processes, open a session, wait for the content."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable

from dsr import rendezvous
from dsr.clock import WALL_CLOCK, Clock
from dsr.memory import Guard, Memory, new_rid
from dsr.schema import Schema
from dsr.zenoh_transport import ZenohTransport


def connect(
    graph: str,
    agent: str,
    *,
    connect: Iterable[str] = (),
    schema: Schema | None = None,
    clock: Clock = WALL_CLOCK,
    guard: Guard | None = None,
    timeout: float = 5.0,
) -> Memory:
    """Join the working memory `graph` over Zenoh and wait until all of it is here.

    The other processes of this user on this machine are found by the graph's name; the first one simply
    begins. The memory owns its transport: closing it leaves the network.

    Args:
        graph: name of the graph; processes that use another name never meet.
        agent: what this process is called.
        connect: further endpoints, such as `tcp/HOST:7447` of a Zenoh router.
        schema: the vocabulary; the built-in one if None.
        clock: for stamps and waiting.
        guard: called before each write, see `Guard`.
        timeout: s to wait for the present content of the graph.

    Raises:
        ConfigError: for a name that cannot be used.
        TransportError: if the network cannot be used, or peers are there but none answers in time.
    """
    rid = new_rid(agent)
    routers = list(connect)
    with contextlib.ExitStack() as resources:
        transport, registration = open_transport(graph, rid, routers, has_memory=True)
        resources.callback(transport.close)
        resources.callback(registration.close)
        memory = Memory(
            graph, agent, transport=transport, clock=clock, schema=schema, guard=guard, rid=rid, threaded=True,
            elders=lambda: _living_replicas(graph, registration.elders),
        )  # fmt: skip
        memory.on_close(resources.pop_all().close)
        resources.callback(memory.close)
        memory.wait_joined(timeout, alone=not routers)
        resources.pop_all()
    return memory


def _living_replicas(graph: str, elders: list[rendezvous.Member]) -> list[str]:
    """Replica ids of those among `elders` that hold a memory and still live, in the same order."""
    living = rendezvous.members(graph) if elders else []
    return [elder.rid for elder in elders if elder.has_memory and elder in living]


def open_transport(
    graph: str, rid: str, connect: Iterable[str] = (), *, has_memory: bool = False
) -> tuple[ZenohTransport, rendezvous.Registration]:
    """A Zenoh transport that meets the graph's other processes; the registration makes it be found by later ones."""
    endpoint = f"tcp/127.0.0.1:{rendezvous.free_port()}"
    registration = rendezvous.Registration(graph, rid, endpoint, has_memory=has_memory)
    try:
        elders = [elder.endpoint for elder in registration.elders]
        return ZenohTransport(endpoint, [*elders, *connect]), registration
    except BaseException:
        registration.close()
        raise
