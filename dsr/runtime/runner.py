"""The life of one agent in either mode: setup, ticks, teardown; counts failures and tells its status."""

from __future__ import annotations

import contextlib
import math
import traceback
from collections import deque

from dsr.agent import Agent
from dsr.errors import AgentError, ConfigError, DsrError
from dsr.network.keys import agent_of
from dsr.network.transport import Qos
from dsr.runtime.activity import Activity
from dsr.runtime.contention import WARN_AFTER, Contention
from dsr.runtime.status import PERIOD, State, Status, encode_status

_SAMPLES = 200
_RATE_WINDOW = 3.0  # s
_LINGERS = 2.0  # s for which a process that crashed may still seem to be there


class Schedule:
    """The due times of the ticks at a rate: start + n / rate, without drift; ticks that came too late are left out."""

    def __init__(self, start: float, rate_hz: float) -> None:
        if not (math.isfinite(rate_hz) and rate_hz > 0):
            raise ConfigError(f"rate {rate_hz} Hz: expected a positive number")
        self._start = start
        self._rate = rate_hz
        self._next = 0

    @property
    def due(self) -> float:
        """Time of the next tick, s."""
        return self._start + self._next / self._rate

    def take(self, now: float) -> int:
        """Take the next tick at time `now`; returns how many due ones are left out after it."""
        following = max(self._next + 1, math.floor((now - self._start) * self._rate) + 1)
        missed = following - self._next - 1
        self._next = following
        return missed


class Runner:
    """Runs one agent and keeps the numbers of its status.

    Args:
        agent: made by `make_agent`.
        rid: the replica id, or what stands for it.
        pid: the process that it runs in, 0 in lockstep.
        restarts: how often it was started before.
        strict: let an exception in a tick out, rather than counting it.
    """

    def __init__(self, agent: Agent, *, rid: str, pid: int = 0, restarts: int = 0, strict: bool = False) -> None:
        self.agent = agent
        self.state = State.STARTING
        self.missed = 0
        self._rid = rid
        self._pid = pid
        self._restarts = restarts
        self._strict = strict
        self._errors = 0
        self._errors_in_a_row = 0
        self._last_error = ""
        self._known_errors: set[str] = set()
        self._ticks: deque[tuple[float, float]] = deque(maxlen=_SAMPLES)  # (end, duration), s
        self._told = -math.inf
        self._namesakes: dict[str, float] = {}  # s, since when others of the agent's name are there
        self._namesake = ""
        self._were_here: frozenset[str] | None = None
        """Replica ids of the processes with this agent's name that were there when it began."""
        self._activity = Activity(agent)
        self._contention = Contention() if pid else None  # in lockstep no machine is too slow
        self._warned = False

    def setup(self) -> None:
        """Set the agent up. A failure is logged and raised as a `DsrError`; `ConfigError` if no restart would help."""
        self.tell()
        try:
            self.agent.setup()
            if self.agent.uses_memory:
                self.agent.reads.check_names(self.agent.memory.schema)
                self.agent.writes.check_names(self.agent.memory.schema)
        except Exception as error:
            self._count(error)
            self._enter(State.FAILED)
            if isinstance(error, DsrError):
                raise
            raise AgentError(f"set-up failed: {self._last_error}") from error

    def tick(self, now: float) -> None:
        """Do one tick. A failure is logged and counted; `AgentError` after too many in a row."""
        begun = self.agent.clock.monotonic()
        try:
            with self.agent.memory.batch() if self.agent.uses_memory else contextlib.nullcontext():
                self.agent.tick(now)
        except Exception as error:
            if self._strict:
                raise
            self._count(error)
        else:
            self._errors_in_a_row = 0
        ended = self.agent.clock.monotonic()
        self._ticks.append((ended, ended - begun))
        self._after_tick(ended)

    def teardown(self) -> None:
        """Tear the agent down; a failure is only logged."""
        try:
            self.agent.teardown()
        except Exception as error:
            self._count(error)
        if self.state is not State.FAILED:
            self._enter(State.STOPPED)

    def _after_tick(self, ended: float) -> None:
        if self._errors_in_a_row >= max(1, self.agent.most_failures):
            self._enter(State.FAILED)
            failed = f"agent {self.agent.name!r}: {self._errors_in_a_row} ticks failed in a row"
            raise AgentError(f"{failed}; the last: {self._last_error}")
        if self._errors_in_a_row == 0:
            self._enter(State.DEGRADED if self._impairment else State.READY)
        elif self.state is not State.STARTING:
            self._enter(State.DEGRADED)
        if ended >= self.status_due:
            self.tell()

    @property
    def _impairment(self) -> str:
        """Why the agent works, but not as it should; empty if it does."""
        return self.agent.degraded or self._namesake or self.agent.bus.trouble

    @property
    def status_due(self) -> float:
        """Time of the next status, s on the monotonic clock."""
        return self._told + PERIOD

    def tell(self) -> None:
        """Publish the status."""
        agent = self.agent
        self._told = agent.clock.monotonic()
        self._look_for_namesakes()
        self._look_at_machine()
        agent.last_status = status = self.status()
        agent.bus.publish(agent.keys.status(agent.name), encode_status(status), Qos.STREAM)

    def _look_at_machine(self) -> None:
        """Note whether other work keeps this agent from its processor; say so once if that lasts."""
        if self._contention is None:
            return
        self._contention.note(self._told, self.missed)
        if self._contention.lasts >= WARN_AFTER and not self._warned:
            self._warned = True
            said = "this machine is overloaded: the agent waited %.0f %% of the last second for a processor, and left "
            self.agent.log.warning(said + "out ticks (logged once)", 100.0 * self._contention.waiting)

    def _look_for_namesakes(self) -> None:
        """Find other processes with this agent's name: each would take for its own what the other one has made.

        Who was here first goes on and says so. Who came later gives up: raises `AgentError`. A process that was here
        before, and crashed, may take a moment to be gone.
        """
        agent = self.agent
        if not agent.uses_memory or agent.memory.closed:
            return
        found = [rid for rid in agent.memory.peers if agent_of(rid) == agent.name]
        if self._were_here is None:
            self._were_here = frozenset(found)
        self._namesakes = {rid: self._namesakes.get(rid, self._told) for rid in found}
        rids = sorted(rid for rid, since in self._namesakes.items() if self._told - since >= _LINGERS)
        before = self._namesake
        self._namesake = f"another process has the name {agent.name!r}, too ({', '.join(rids)})" if rids else ""
        if not self._were_here.isdisjoint(rids):
            raise AgentError(f"{self._namesake}, and was here first; give this one another name with --name")
        if self._namesake and not before:
            agent.log.warning("%s; give one of them another with --name", self._namesake)

    def _enter(self, state: State) -> None:
        if state is not self.state:
            self.state = state
            self.tell()

    def _count(self, error: Exception) -> None:
        """Note a failure; log it if this kind is new, with its traceback unless it is a wrong configuration."""
        self._errors += 1
        self._errors_in_a_row += 1
        self._last_error = f"{type(error).__name__}: {error}"
        where = traceback.extract_tb(error.__traceback__)[-1:]
        kind = f"{type(error).__name__} at {where[0].filename}:{where[0].lineno}" if where else self._last_error
        if kind not in self._known_errors:
            self._known_errors.add(kind)
            shown = None if isinstance(error, ConfigError) else error
            self.agent.log.error("%s (logged once)", self._last_error, exc_info=shown)

    def status(self) -> Status:
        """The agent's present condition."""
        durations = sorted(duration for _, duration in self._ticks)
        return Status(
            agent=self.agent.name,
            rid=self._rid,
            pid=self._pid,
            state=self.state,
            rate_hz=self._rate(),
            tick_ms_p50=_quantile(durations, 0.5) * 1e3,
            tick_ms_p95=_quantile(durations, 0.95) * 1e3,
            missed=self.missed,
            behind=self._behind(),
            errors=self._errors,
            restarts=self._restarts,
            last_error=self._impairment or self._last_error,
            stamp=self.agent.clock.now(),
            clock=str(self.agent.memory.clocks) if self.agent.uses_memory else "",
            worlds=self._activity.uses(self.agent.clock.now()),
            counts={name: count for name, count in self.agent.counts.items() if count},
            waiting=self._contention.waiting if self._contention else 0.0,
            overloaded=self._contention is not None and self._contention.overloaded,
        )

    def _behind(self) -> float:
        agent = self.agent
        return agent.memory.behind if agent.uses_memory else 0.0

    def _rate(self) -> float:
        """Ticks a second over the last few seconds, and at least over the last two ticks."""
        ends = [end for end, _ in self._ticks]
        ends = [end for end in ends if end > ends[-1] - _RATE_WINDOW or end in ends[-2:]]
        return (len(ends) - 1) / (ends[-1] - ends[0]) if len(ends) > 1 else 0.0


def _quantile(ordered: list[float], fraction: float) -> float:
    return ordered[min(int(fraction * len(ordered)), len(ordered) - 1)] if ordered else 0.0
