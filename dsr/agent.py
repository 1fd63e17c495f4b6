"""An agent: declared reads and writes, setup, tick, teardown. Subclass `Agent`; `dsr.main` makes it a program.

The same class runs as a process on the wall clock (`main`) and in lockstep with others on a manual clock, see
dsr/runtime/. It must therefore start no threads and never block: everything happens in `tick`.
"""

from __future__ import annotations

import logging
import zlib
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar

import msgspec
import numpy as np

from dsr.clock import Clock
from dsr.config.toml import convert
from dsr.errors import AgentError
from dsr.graph.access import Access
from dsr.network.keys import BASE, Keys, check_name
from dsr.network.transport import Transport

if TYPE_CHECKING:
    from dsr.memory import Memory

__all__ = ["Access", "Agent", "NoConfig", "make_agent"]


class NoConfig(msgspec.Struct, frozen=True):
    """The configuration of an agent that has nothing to configure."""


class Agent:
    """Base of all agents. The class attributes declare it; the runtime sets the instance's before `setup`."""

    name: str = ""
    """Unique within a graph; the class gives the default."""
    rate_hz: float = 10.0
    """Ticks a second."""
    reads: ClassVar[Any] = Access()
    """An `Access`; a class at home in other worlds may name these instead (see `dsr.worlds.Client`)."""
    writes: ClassVar[Any] = Access()
    """Node types, edge types and attributes that the agent may write; any other write raises `AgentError`."""
    publishes: ClassVar[tuple[str, ...]] = ()
    """Keys of the bus on which it publishes, below the graph's root: `device/arm/command`, `blob/**`. Only a secured
    graph holds it to them."""
    interest: ClassVar[tuple[str, ...] | None] = None
    """Parts of the graph that it holds, "*" for all, unless the system file or DSR_INTEREST says otherwise. With None
    and without these its memory can hold none."""
    uses_memory: ClassVar[bool] = True
    """False for one that only needs the bus: it gets no `memory`."""
    reactive: ClassVar[bool] = False
    """Whether changes of the graph wake the agent (see `wake`), and not only time."""
    shares_process: ClassVar[bool] = False
    """Whether the agent shares a process with others that do, unless the system file says otherwise: its ticks are
    short, and it calls no library that may crash or block."""
    libraries: ClassVar[tuple[str, ...]] = ()
    """Modules that `setup` imports, because whoever only looks at the class need not wait for them. A system does
    without an `optional` agent where one of them is not installed."""
    goal_libraries: ClassVar[tuple[str, ...]] = ()
    """Modules without which the agent runs and pursues no goal: a scenario with a mission is refused without them."""
    most_failures: ClassVar[int] = 25
    """Number of failed ticks in a row with which the agent gives up."""
    Config: ClassVar[type[Any]] = NoConfig
    """Type of the configuration: a frozen msgspec Struct whose fields all have defaults."""

    memory: Memory
    bus: Transport
    """The network, for traffic outside the graph: devices, truth."""
    keys: Keys
    clock: Clock
    config: Any
    log: logging.Logger
    seed: int
    """Seed for its random numbers: the run's, mixed with the agent's name."""
    degraded: str = ""
    """Why it does not work as well as it should, shown in its status; empty if it does."""
    counts: Mapping[str, int] = MappingProxyType({})
    """What it counts of its work since its start, by name, shown in its status; zeros are not shown."""
    last_status: object = None
    """The newest `dsr.runtime.status.Status` that was told about it; None before the first."""
    wake: Callable[[], None] = staticmethod(lambda: None)
    """Asks for a tick now rather than when the next is due; may be called in any thread, and returns at once."""

    @classmethod
    def configured(cls, config: Mapping[str, Any]) -> type[Agent]:
        """This class with what `config` changes in its declarations; most agents declare the same in any case."""
        return cls

    def world_names(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """The worlds that the agent reads and those that it writes, as it declares; it may open more."""
        writes: Access = self.writes
        at_home = writes != Access() and writes.includes_world(BASE)
        return (BASE,) if self.reads != Access() else (), (BASE,) if at_home else ()

    def setup(self) -> None:
        """Prepare. Nodes that it needs may not be there yet: that is for `tick` to cope with."""

    def tick(self, now: float) -> None:
        """Do a step of work at time `now` (s), `rate_hz` times a second."""

    def teardown(self) -> None:
        """Release what `setup` took; also called when `setup` or a tick failed."""


def make_agent(
    kind: type[Agent],
    *,
    name: str,
    config: Mapping[str, Any] | None = None,
    bus: Transport,
    keys: Keys,
    clock: Clock,
    memory: Memory | None,
    seed: int = 0,
) -> Agent:
    """An agent of class `kind`, ready for `setup`. Raises `ConfigError` for a wrong `config` or name."""
    if kind.uses_memory and memory is None:
        raise AgentError(f"agent {name!r} needs a memory")
    agent = kind()
    agent.name = check_name("agent name", name)
    agent.bus, agent.keys, agent.clock = bus, keys, clock
    agent.config = convert(dict(config or {}), kind.Config, f"configuration of agent {name!r}")
    agent.log = logging.getLogger(f"agent.{name}")
    agent.seed = _mix(seed, name)
    if memory is not None:
        agent.memory = memory
    return agent


def _mix(seed: int, name: str) -> int:
    """A seed of its own for each agent, so that no two draw the same noise."""
    return int(np.random.SeedSequence([seed, zlib.crc32(name.encode())]).generate_state(1)[0])
