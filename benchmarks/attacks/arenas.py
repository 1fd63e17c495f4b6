"""Where attacks run: real Zenoh sessions on the loopback interface, or a network in memory on a clock of its own."""

from __future__ import annotations

import contextlib
import os
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import dsr
from benchmarks.attacks.attack import GRAPH, Raw
from benchmarks.ports import reserved_port
from dsr import LocalNetwork, ManualClock, Memory
from dsr.clock import WALL_CLOCK
from dsr.graph.access import WriteGuard
from dsr.memory import new_rid
from dsr.network import rendezvous
from dsr.network.keys import Keys
from dsr.network.zenoh_transport import ZenohTransport
from dsr.security.authority import SecurityFolder
from dsr.security.configuration import zenoh_settings
from dsr.security.gate import Gate
from dsr.security.policy import Grant, checked, read_policy, write_policy

JOIN_PATIENCE = 20.0
"""s that a memory may take to join; machines that run attacks may be busy."""
_STEP = 0.05
"""s between two looks at a condition, and of one step in memory."""


class ZenohArena:
    """Memories and raw peers with Zenoh sessions of their own; use `zenoh_arena`."""

    def __init__(self, folder: SecurityFolder | None) -> None:
        self.secured = folder is not None
        self._folder = folder
        self._closing = contextlib.ExitStack()

    def now(self) -> float:
        """See `Arena`."""
        return WALL_CLOCK.now()

    def join(self, agent: str) -> Memory:
        """See `Arena`."""
        memory = dsr.connect(GRAPH, agent, timeout=JOIN_PATIENCE, security=self._folder.path if self._folder else None)
        self._closing.callback(memory.close)
        return memory

    def raw(self, agent: str) -> Raw:
        """See `Arena`; its session controls no access."""
        settings = {}
        if self._folder is not None:
            settings = zenoh_settings(self._folder, read_policy(self._folder.policy), agent)
            settings.pop("access_control", None)
        endpoint = f"{'tls' if self._folder else 'tcp'}/127.0.0.1:{reserved_port()}"
        transport = ZenohTransport(endpoint, rendezvous.endpoints(GRAPH), settings)
        self._closing.callback(transport.close)
        return Raw(new_rid(agent), transport, Keys(GRAPH))

    def wait(self, seconds: float) -> None:
        """See `Arena`."""
        WALL_CLOCK.wait(threading.Event(), seconds)

    def eventually(self, condition: Callable[[], object], seconds: float) -> bool:
        """See `Arena`."""
        deadline = WALL_CLOCK.monotonic() + seconds
        while not (holds := condition()) and WALL_CLOCK.monotonic() < deadline:
            self.wait(_STEP)
        return bool(holds)

    def close(self) -> None:
        """End all that joined."""
        self._closing.close()


@contextlib.contextmanager
def zenoh_arena(grants: Mapping[str, Grant] | None = None) -> Iterator[ZenohArena]:
    """A new arena that meets no other graph of this machine; secured with certificates if there are `grants`."""
    before = os.environ.get("XDG_RUNTIME_DIR")
    with tempfile.TemporaryDirectory() as runtime:
        os.environ["XDG_RUNTIME_DIR"] = runtime
        arena = ZenohArena(_certificates(Path(runtime) / "keys", grants) if grants else None)
        try:
            yield arena
        finally:
            arena.close()
            if before is None:
                del os.environ["XDG_RUNTIME_DIR"]
            else:
                os.environ["XDG_RUNTIME_DIR"] = before


def _certificates(path: Path, grants: Mapping[str, Grant]) -> SecurityFolder:
    folder = SecurityFolder(path)
    folder.create(WALL_CLOCK.now())
    for agent in grants:
        folder.issue(agent, WALL_CLOCK.now())
    write_policy(folder.policy, checked(grants))
    return folder


class LocalArena:
    """The same in memory: no process, no thread, no waiting.

    In a secured one each memory has its gate and guard; that keys belong to certificates is Zenoh's part, so an attack
    must keep to the keys of its agent.
    """

    def __init__(self, grants: Mapping[str, Grant] | None = None) -> None:
        self.secured = bool(grants)
        self._policy = checked(grants) if grants else None
        self._clock = ManualClock(WALL_CLOCK.now())
        self._network = LocalNetwork(self._clock, seed=1)
        self._memories: list[Memory] = []

    def now(self) -> float:
        """See `Arena`."""
        return self._clock.now()

    def join(self, agent: str) -> Memory:
        """See `Arena`."""
        policy, transport = self._policy, self._network.connect(agent)
        gate = Gate(policy) if policy else None
        guard = WriteGuard(agent, policy.agents[agent].writes) if policy else None
        memory = Memory(GRAPH, agent, transport=transport, clock=self._clock, gate=gate, guard=guard)
        if not self._memories:
            memory.replica.synchroniser.nobody_there()
        self._memories.append(memory)
        self.wait(1.0)
        return memory

    def raw(self, agent: str) -> Raw:
        """See `Arena`."""
        return Raw(new_rid(agent), self._network.connect(agent), Keys(GRAPH))

    def wait(self, seconds: float) -> None:
        """See `Arena`."""
        self.eventually(lambda: False, seconds)

    def eventually(self, condition: Callable[[], object], seconds: float) -> bool:
        """See `Arena`."""
        for _ in range(max(1, round(seconds / _STEP))):
            self._clock.advance(_STEP)
            for memory in self._memories:
                memory.flush()
            self._network.deliver()
            for memory in self._memories:
                memory.poll()
            if condition():
                return True
        return False
