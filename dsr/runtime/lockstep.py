"""Lockstep: all agents of a system in one process, on a manual clock, as fast as the machine allows.

Each agent has its own replica of the memory and its own link to an in-memory network. At every instant at which
agents are due, they tick in the declared order; after each, what it sent is delivered. With the same agents and
the same seed, two runs are equal bit for bit.
"""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from functools import partial
from types import TracebackType

from dsr.agent import make_agent
from dsr.clock import ManualClock
from dsr.errors import AgentError, ConfigError, DsrError, suggest
from dsr.graph.access import WriteGuard, check_writers
from dsr.memory import Memory
from dsr.network.keys import Keys
from dsr.network.local_transport import LocalNetwork
from dsr.network.transport import Transport
from dsr.runtime.resources import keep_freed_memory
from dsr.runtime.runner import Runner, Schedule
from dsr.runtime.system import AgentSpec

_ROUNDS = 3
"""Exchanges that a newcomer needs: who is there, request and reply, merge."""


@dataclass(frozen=True)
class _Running:
    """One running agent."""

    runner: Runner
    schedule: Schedule
    bus: Transport
    memory: Memory | None


class Lockstep:
    """Runs agents in lockstep. A context manager.

    Args:
        agents: in the order in which they tick when due at the same time.
        graph: name of the graph.
        clock: moved forward by this class only.
        seed: of the run; each agent gets one of its own from it.
        strict: an exception in a tick ends the run, rather than being counted as in a process.
        later: names of agents that do not begin yet; `restart` starts them.

    Raises:
        ConfigError: for a wrong configuration, or writers that exclude each other.
    """

    def __init__(
        self,
        agents: Iterable[AgentSpec],
        *,
        graph: str = "lockstep",
        clock: ManualClock | None = None,
        seed: int = 0,
        strict: bool = False,
        later: Collection[str] = (),
    ) -> None:
        keep_freed_memory()
        self._specs = {spec.name: spec for spec in agents}
        check_writers({name: spec.kind.writes for name, spec in self._specs.items()})
        self.clock = clock or ManualClock()
        self.network = LocalNetwork(self.clock, seed=seed)
        self.keys = Keys(graph)
        self._memories: list[Memory] = []
        self._seed = seed
        self._strict = strict
        self.memory = self._join("observer", "observer", None)
        """A replica of its own, for whoever sets the scene and watches the run."""
        self.bus = self.memory.transport
        """Its link, for traffic outside the graph."""
        self._running: dict[str, _Running] = {}
        self._starts: Counter[str] = Counter()
        self._woken: set[str] = set()
        try:
            for spec in self._specs.values():
                if spec.name not in later:
                    self._start(spec)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Lockstep:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def run_for(self, seconds: float, on_step: Callable[[float], bool | None] | None = None) -> bool:
        """`run_until` that many seconds from now."""
        return self.run_until(self.clock.now() + seconds, on_step)

    def run_until(self, end: float, on_step: Callable[[float], bool | None] | None = None) -> bool:
        """Run all ticks due before `end` (s) and set the clock to it.

        `on_step(now)` is called after each instant with ticks; if it returns True the run pauses there.
        Returns whether it did.
        """
        while self._running:
            due = min(running_agent.schedule.due for running_agent in self._running.values())
            if due >= end:
                break
            self.clock.advance_to(max(due, self.clock.now()))
            self._step(due)
            if on_step is not None and on_step(due):
                return True
        self.clock.advance_to(max(end, self.clock.now()))
        return False

    def suspend(self, seconds: float) -> None:
        """Let time pass (s) in which nobody ticks, as on a machine that sleeps; those ticks are left out."""
        self.clock.advance(seconds)
        for running_agent in self._running.values():
            running_agent.schedule.take(self.clock.now())

    def runner(self, name: str) -> Runner:
        """The running agent called `name` with its counts. Raises `AgentError` if it is not running."""
        return self._running_agent(name).runner

    def restart(self, name: str) -> None:
        """Start an agent that was killed, or has not begun, as a new replica. Raises `AgentError` if it is running."""
        if name in self._running:
            raise AgentError(f"agent {name!r} is running")
        self._start(self._spec(name))

    def kill(self, name: str) -> None:
        """End an agent as `kill -9` would: nothing that it has not sent is sent any more."""
        running_agent = self._running_agent(name)
        del self._running[name]
        self._memories = [memory for memory in self._memories if memory is not running_agent.memory]
        running_agent.bus.close()
        with contextlib.suppress(DsrError):  # it can no longer reach anybody, only release what it took
            running_agent.runner.agent.teardown()

    def close(self) -> None:
        """Tear all agents down, last one first; harmless when repeated."""
        while self._running:
            _, running_agent = self._running.popitem()
            running_agent.runner.teardown()
            if running_agent.memory is not None:
                running_agent.memory.close()
            running_agent.bus.close()
        self.memory.close()

    def _start(self, spec: AgentSpec) -> None:
        name = spec.name
        self._starts[name] += 1
        rid = f"{name}-{self._starts[name]}"
        interest = spec.kind.interest if spec.interest is None else spec.interest
        guard = WriteGuard(name, spec.kind.writes)
        memory = self._join(name, rid, guard, interest) if spec.kind.uses_memory else None
        bus = memory.transport if memory else self.network.connect(rid)
        agent = make_agent(
            spec.kind,
            name=name,
            config=spec.config,
            bus=bus,
            keys=self.keys,
            clock=self.clock,
            memory=memory,
            seed=self._seed,
        )
        agent.wake = partial(self._woken.add, name)
        runner = Runner(agent, rid=rid, strict=self._strict)
        try:
            runner.setup()
        except Exception:
            runner.teardown()
            raise
        self._running[name] = running_agent = _Running(runner, Schedule(self.clock.now(), agent.rate_hz), bus, memory)
        self._pass_on(running_agent)

    def _spec(self, name: str) -> AgentSpec:
        if name not in self._specs:
            raise ConfigError(f"no agent {name!r}; {suggest(name, self._specs)}")
        return self._specs[name]

    def _running_agent(self, name: str) -> _Running:
        if name not in self._running:
            raise AgentError(f"agent {self._spec(name).name!r} is not running")
        return self._running[name]

    def _join(self, name: str, rid: str, guard: WriteGuard | None, interest: tuple[str, ...] | None = None) -> Memory:
        """A new replica that holds what the others know, who take in first what they were sent."""
        self.network.deliver()
        for memory in self._memories:
            memory.poll()
        transport = self.network.connect(rid)
        memory = Memory(
            self.keys.graph, name, transport=transport, clock=self.clock, guard=guard, rid=rid, interest=interest
        )
        came, sync = -1, memory.replica.synchroniser
        while came < sync.pieces:
            came = sync.pieces
            for _ in range(_ROUNDS):
                self.network.deliver()
                memory.poll()
        memory.wait_joined(0.0, all_known=not memory.peers)
        self._memories.append(memory)
        return memory

    def _step(self, now: float) -> None:
        """Tick every agent that is due at `now`."""
        self.memory.flush()
        self.network.deliver()
        for name in self._specs:
            running_agent = self._running.get(name)
            if running_agent is not None and self._is_up(name, running_agent, now):
                running_agent.runner.tick(now)
                self._pass_on(running_agent)
        self.memory.poll()
        self.network.deliver()

    def _is_up(self, name: str, running_agent: _Running, now: float) -> bool:
        """Whether an agent ticks at `now`: it is due, or was woken; it has then merged what has arrived."""
        due = running_agent.schedule.due <= now
        if due:
            running_agent.schedule.take(now)
        if running_agent.memory is not None and (due or running_agent.runner.agent.reactive):
            running_agent.memory.poll()
        woken = name in self._woken
        self._woken.discard(name)
        return due or woken

    def _pass_on(self, running_agent: _Running) -> None:
        """Deliver what an agent sent."""
        if running_agent.memory is not None:
            running_agent.memory.flush()
        self.network.deliver()
