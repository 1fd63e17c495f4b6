"""Starts the agents of a system in processes, waits until they are ready, restarts crashed ones, stops all.

    with Launcher(load_system("tabletop"), folder) as launcher:
        launcher.wait_ready()
        launcher.run(stop)

Nothing happens behind the caller's back: `poll`, which the waiting methods call, does the supervision.
"""

from __future__ import annotations

import contextlib
import logging
import os
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType

import msgspec

from dsr.clock import WALL_CLOCK
from dsr.connecting import SECURITY, asked_for, connect
from dsr.errors import AgentError, TransportError
from dsr.files.private_files import FOLDER_MODE
from dsr.network.keys import ALL
from dsr.network.rendezvous import lock_claim
from dsr.persistence.content import GraphContent
from dsr.persistence.world_keeper import WorldKeeper
from dsr.runtime.contention import longest_waited
from dsr.runtime.forked import PYTHON, Process, fork_ahead
from dsr.runtime.launched import Launched, Program, Seat, SharedProgram, exit_text
from dsr.runtime.orders import StartAgent
from dsr.runtime.status import Heard, State, StatusBoard
from dsr.runtime.supervised import Supervised
from dsr.runtime.system import AgentSpec, System

LAUNCHER = "launcher"
"""Name under which a launcher takes part in its graph."""
POLL_PERIOD = 0.05
"""s between two looks at the processes."""
STOP_PATIENCE = 5.0
"""s that agents get to tear down until they are killed."""
_MOST_NAMES = 100

_log = logging.getLogger("dsr.runtime.launcher")


class AgentRow(msgspec.Struct, frozen=True):
    """The row of one agent in the status table."""

    agent: str
    state: str
    """A `State`, or "silent" (not heard for a while), "restarting", "ended", or "no status" (never heard)."""
    pid: int | None
    heard: Heard | None
    """The newest status of the running process."""
    restarts: int
    last_error: str

    @property
    def is_ready(self) -> bool:
        """Whether the agent had a good tick."""
        return self.state in (State.READY, State.DEGRADED)


class Launcher:
    """Runs a system. A context manager: entering starts the processes, leaving stops them.

    Args:
        system: what to run. If somebody else already launched a system on that graph, a fresh name is taken:
            see `graph`.
        folder: gets the log file of each agent, and stands for "{run}" in their configurations; made if missing.
        seed: of the run.
        router: endpoint of a Zenoh router to join, `tcp/HOST:7447`; None for this machine alone.
        log_level: of the agents.
        security: folder with the certificates of the launcher and all agents; by default, what the environment
            names, see `dsr.connect`.
        content: what the graph holds before the agents start, if no state is restored.
        state: folder in which the graph survives: restored from it before the agents start, and kept there.
        fork: start the processes for the first time by forks of this one, if it has no threads: they share the
            libraries that it has loaded.
    """

    def __init__(
        self,
        system: System,
        folder: Path,
        *,
        seed: int = 0,
        router: str | None = None,
        log_level: str = "info",
        security: Path | None = None,
        content: GraphContent | None = None,
        state: Path | None = None,
        fork: bool = False,
    ) -> None:
        self.folder = folder
        self.clock = WALL_CLOCK
        self._requested = system
        self.system = system
        self._seed = seed
        self._router = router
        self._log_level = log_level
        self._security = security
        self._content = content
        self._state = state
        self._fork = fork
        self._ahead: list[Process] = []
        self.restored = False
        """Whether the graph was restored."""
        self._resources = contextlib.ExitStack()
        self._processes: dict[str, Supervised] = {}

    @property
    def graph(self) -> str:
        """The graph's name."""
        return self.system.graph

    def __enter__(self) -> Launcher:
        try:
            self.start()
        except BaseException:
            self.stop()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def start(self) -> None:
        """Claim the graph's name, join its network and start all agents."""
        if self._fork:  # first of all: what is opened later is not theirs
            self._ahead = fork_ahead(len(self._requested.processes()))
        name = self._resources.enter_context(_claimed_name(self._requested.graph, self.folder))
        self.system = self._requested.on_graph(name).in_folder(self.folder)
        self.folder.mkdir(mode=FOLDER_MODE, parents=True, exist_ok=True)
        routers = [self._router] if self._router else ()
        interest = asked_for(None if self._state is None else ALL)  # what nobody holds is lost, and not kept
        self.memory = connect(
            name, agent=LAUNCHER, connect=routers, security=self._security, must_exist=False,
            interest=None if interest is None else (),
        )  # fmt: skip
        self._resources.callback(self.memory.close)
        if self._state is not None:
            self.restored = WorldKeeper(self.memory, self._state, interest=interest or ()).restored
        elif interest:
            self.memory.hold_part(*interest, unlisted=True)
        if self._content is not None and not self.restored:
            for left_out in self._content.put_into(self.memory):
                _log.warning("%s", left_out)
        self.board = StatusBoard(self.memory.transport, self.memory.keys, self.clock)
        self._resources.callback(self.board.close)
        environment = self._environment()
        if SECURITY in environment:  # who can read a process's memory has the keys of all agents in it
            self.system = self.system.apart(*(spec.name for spec in self.system.agents))
        launched = {
            name: agent
            for process, specs in self.system.processes().items()
            for name, agent in self._launched(process, specs, environment).items()
        }
        for spec in self.system.agents:
            self._processes[spec.name] = Supervised(launched[spec.name], clock=self.clock, restart=spec.restart)
        for supervised in self._processes.values():
            supervised.start()
        self._dismiss()

    def _launched(
        self, process: str, specs: Sequence[AgentSpec], environment: Mapping[str, str]
    ) -> dict[str, Launched]:
        """The agents of one process, yet to be started."""
        if len(specs) == 1:
            spec = specs[0]
            return {spec.name: Program(self._command(spec), self._log_file(spec.name), environment, self._ahead)}
        program = Program(self._shared_command(process), self._log_file(process), environment, self._ahead)
        shared = SharedProgram(process, program)
        return {spec.name: Seat(shared, self._order(spec)) for spec in specs}

    def _command(self, spec: AgentSpec) -> list[str]:
        command = [*PYTHON, "dsr.runtime", *self._beside(), spec.program, "--name", spec.name]
        if spec.interest is not None:
            command += ["--interest", ",".join(spec.interest)]
        return [*command, "--config", msgspec.json.encode(spec.config).decode(), *self._common_options()]

    def _shared_command(self, process: str) -> list[str]:
        return [*PYTHON, "dsr.runtime.shared_process", process, *self._beside(), *self._common_options()]

    def _order(self, spec: AgentSpec) -> StartAgent:
        return StartAgent(spec.name, spec.program, spec.config, str(self._log_file(spec.name)), 0, spec.interest)

    def _beside(self) -> list[str]:
        return ["--beside", str(self.system.folder)] if self.system.folder else []

    def _common_options(self) -> list[str]:
        options = ["--graph", self.graph, "--seed", str(self._seed), "--log-level", self._log_level]
        return options + (["--connect", self._router] if self._router else [])

    def _log_file(self, name: str) -> Path:
        return self.folder / f"{name}.log"

    def _environment(self) -> dict[str, str]:
        secured = {SECURITY: str(self._security.resolve())} if self._security else {}
        return {**os.environ, **secured}

    def poll(self) -> None:
        """Notice what ended and start it again when due. Call it every `POLL_PERIOD` or so."""
        for name, process in self._processes.items():
            before = process.runs
            process.poll()
            if before and not process.runs:
                _log.warning("agent %s ended with %s", name, exit_text(process.exit_code))
            elif process.runs and not before:
                _log.warning("agent %s was started again (restart %d)", name, process.restarts)

    def rows(self) -> list[AgentRow]:
        """The state of every agent, in the system's order."""
        return [self._row(name, process) for name, process in self._processes.items()]

    def _row(self, name: str, process: Supervised) -> AgentRow:
        heard = self.board.get(name)
        if heard is not None and (heard.status.pid, heard.status.restarts) != (process.pid, process.restarts):
            heard = None
        if process.pid is None:
            state = "ended" if process.ended else "restarting"
        elif heard is None:
            state = str(State.STARTING)
        else:
            state = "silent" if self.board.is_silent(name) else str(heard.status.state)
        error = heard.status.last_error if heard else ""
        if process.pid is None and process.exit_code:
            error = exit_text(process.exit_code)
        return AgentRow(name, state, process.pid, heard, process.restarts, error)

    def wait_ready(self, progress: Callable[[list[AgentRow]], None] = lambda rows: None) -> None:
        """Wait until every agent had a good tick; `progress` sees the rows about 20 times a second.

        Raises:
            AgentError: if one ended for good or took longer than its time limit, with the end of its log. Time in which
                its process waited for a processor of an overloaded machine does not count.
        """
        started = self.clock.monotonic()
        while True:
            self.poll()
            rows = self.rows()
            progress(rows)
            waiting = [row for row in rows if not row.is_ready]
            if not waiting:
                return
            for row in waiting:
                self._check_waiting(row, self.clock.monotonic() - started)
            self.clock.wait(threading.Event(), POLL_PERIOD)

    def _check_waiting(self, row: AgentRow, waited: float) -> None:
        limit = self.system.agent(row.agent).ready_timeout
        process = self._processes[row.agent]
        if process.ended:
            why = f"ended with {exit_text(process.exit_code)}"
        elif waited > limit + (queued := longest_waited(row.pid) if row.pid else 0.0):
            late = f" and {queued:.0f} s more, in which it waited for a processor" if queued >= 1.0 else ""
            why = f"was not ready within {limit:g} s{late} (state: {row.state}, {row.restarts} restarts)"
        else:
            return
        raise AgentError(f"agent {row.agent!r} {why}; the end of {process.log_file}:\n{process.last_lines()}")

    def run(self, stop: threading.Event, progress: Callable[[list[AgentRow]], None] = lambda rows: None) -> None:
        """Supervise until `stop` is set or every agent has ended; `progress` sees the rows about 20 times a second."""
        while not self.clock.wait(stop, POLL_PERIOD):
            self.poll()
            progress(self.rows())
            if all(process.ended for process in self._processes.values()):
                return

    def stop(self) -> None:
        """Stop all agents, killing those that do not end in `STOP_PATIENCE`; harmless when repeated."""
        try:
            self._dismiss()
            self._end_processes()
        finally:
            self._resources.close()

    def _dismiss(self) -> None:
        """End the processes that were forked and got nothing to do."""
        while self._ahead:
            self._ahead.pop().dismiss()

    def _end_processes(self) -> None:
        for process in self._processes.values():
            process.terminate()
        deadline = self.clock.monotonic() + STOP_PATIENCE
        left = dict(self._processes)
        while left and self.clock.monotonic() < deadline:
            left = {name: process for name, process in left.items() if not process.has_ended()}
            self.clock.wait(threading.Event(), POLL_PERIOD if left else 0.0)
        for name, process in left.items():
            if process.runs:
                _log.warning("agent %s did not stop and was killed", name)
            process.kill()


@contextlib.contextmanager
def _claimed_name(graph: str, folder: Path) -> Iterator[str]:
    """`graph`, or `graph-2` and so on if other launchers hold that name; ours as long as the context is open."""
    names = [graph, *(f"{graph}-{number}" for number in range(2, _MOST_NAMES))]
    for name in names:
        if lock := lock_claim(name):
            break
    else:
        raise TransportError(f"{len(names)} systems called {graph!r} run already")
    if name != graph:
        _log.warning("a system %r is running already; this one is %r", graph, name)
    try:
        lock.truncate(0)
        lock.write(f"{os.getpid()} {folder.resolve()}")
        lock.flush()
        yield name
    finally:
        Path(lock.name).unlink(missing_ok=True)
        lock.close()
