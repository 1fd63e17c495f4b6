"""Many runs of scenarios in lockstep, on all cores: workers that may crash or hang without harm to the rest."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Iterator, Sequence
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from pathlib import Path
from tempfile import TemporaryDirectory

import msgspec

from agents.scenario.run.staging import HandFinder, Policy, Sensor
from agents.scenario.run.sweep_worker import SweepAnswer, SweepJob, work
from dsr.clock import WALL_CLOCK

LIMIT = 900.0
"""s of real time that one run may take"""
_LOOK_PERIOD = 1.0  # s between two looks for workers that hang
_GRACE = 5.0  # s for a worker to end
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
_context = multiprocessing.get_context("spawn")


class RunOutcome(msgspec.Struct, frozen=True, kw_only=True):
    """The outcome of one run."""

    scenario: str
    seed: int
    sensor: Sensor
    policy: Policy | None
    hands: HandFinder | None = None
    """How hands were found in images, if the run was told so."""
    passed: bool
    failed: list[str]
    """The expectations that did not hold, without the findings."""
    found: list[str]
    """Findings in place of the expectations, in words."""
    crash: str = ""
    """Why there is no result."""
    metrics: dict[str, float] = {}
    curves: dict[str, list[tuple[float, float]]] = {}
    """See `Result`."""
    notes: list[str] = []
    wall_s: float
    """s of real time that the run took"""


class Sweep:
    """Runs jobs in worker processes. A context manager: nothing is left behind after it.

    Args:
        jobs: what to run.
        workers: number of processes.
        limit: s of real time after which a run is given up.
    """

    def __init__(self, jobs: Sequence[SweepJob], workers: int, limit: float = LIMIT) -> None:
        self._jobs = deque(jobs)
        self._limit = limit
        self._folder = TemporaryDirectory(prefix="dsr-sweep-")
        self._workers: list[_Worker] = []
        self._count = min(workers, len(jobs))

    def __enter__(self) -> Sweep:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def outcomes(self) -> Iterator[RunOutcome]:
        """Yield the outcome of each job, as they come."""
        self._workers = [_Worker(Path(self._folder.name) / f"{number}.log") for number in range(self._count)]
        for worker in self._workers:
            self._give(worker)
        while busy := [worker for worker in self._workers if worker.job is not None]:
            ready = wait([worker.connection for worker in busy], _LOOK_PERIOD)
            for worker in busy:
                if worker.connection in ready:
                    yield worker.take()
                elif worker.elapsed > self._limit:
                    yield worker.give_up(f"took more than {self._limit:.0f} s of real time")
                if worker.job is None:
                    self._give(worker)

    def close(self) -> None:
        """End all workers at once; harmless when repeated."""
        while self._workers:
            self._workers.pop().end()
        self._folder.cleanup()

    def _give(self, worker: _Worker) -> None:
        """Give an idle worker the next job; without any it ends."""
        if self._jobs:
            worker.start(self._jobs.popleft())
        else:
            worker.end()


class _Worker:
    """A process that does one job after the other; started anew after a crash."""

    def __init__(self, log: Path) -> None:
        self.job: SweepJob | None = None
        self.connection: Connection
        self._log = log
        self._process: SpawnProcess | None = None
        self._began = 0.0

    @property
    def elapsed(self) -> float:
        """Seconds since its job began"""
        return WALL_CLOCK.monotonic() - self._began

    def start(self, job: SweepJob) -> None:
        """Begin a job."""
        if self._process is None or not self._process.is_alive():
            self._launch()
        self.job, self._began = job, WALL_CLOCK.monotonic()
        with contextlib.suppress(OSError):  # it died just now: seen when its answer is taken
            self.connection.send_bytes(msgspec.msgpack.encode(job))

    def take(self) -> RunOutcome:
        """The outcome of its job, which is there; a crash if the process died."""
        try:
            answer = msgspec.msgpack.decode(self.connection.recv_bytes(), type=SweepAnswer)
        except (EOFError, OSError):
            return self.give_up(self._last_words())
        result = answer.result
        if result is None:
            return self._outcome(crash=answer.reason)
        failed = [verdict for verdict in result.expectations if not verdict.passed]
        return self._outcome(
            passed=result.passed,
            failed=[verdict.text for verdict in failed],
            found=[verdict.actual for verdict in failed],
            metrics=result.metrics,
            curves=result.curves,
            notes=result.notes,
        )

    def give_up(self, reason: str) -> RunOutcome:
        """The outcome of a job that will not end; the process is ended."""
        self.end()
        return self._outcome(crash=reason)

    def end(self) -> None:
        """End the process with all that it started; harmless when repeated."""
        process, self._process = self._process, None
        if process is None:
            return
        if process.pid is not None:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(process.pid, signal.SIGKILL)
        with contextlib.suppress(ProcessLookupError):
            process.kill()
        process.join(_GRACE)
        self.connection.close()

    def _launch(self) -> None:
        self.end()
        self.connection, other = _context.Pipe()
        self._process = _context.Process(target=work, args=(other, str(self._log)), name="sweep worker")
        with _one_thread_each():
            self._process.start()
        other.close()

    def _outcome(self, *, crash: str = "", **fields: object) -> RunOutcome:
        assert self.job is not None
        job, self.job = self.job, None
        values = {"passed": False, "failed": [], "found": [], **fields}
        about = {
            "scenario": job.name, "seed": job.seed, "sensor": job.sensor, "policy": job.policy, "hands": job.hands,
        }  # fmt: skip
        return msgspec.convert({**about, **values, "crash": crash, "wall_s": self.elapsed}, RunOutcome)

    def _last_words(self) -> str:
        """Why the process died, as far as it can be known."""
        code = None
        if self._process is not None:
            self._process.join(_GRACE)
            code = self._process.exitcode
        how = f"signal {-code}" if code is not None and code < 0 else f"exit code {code}"
        lines = self._log.read_text(errors="replace").splitlines() if self._log.exists() else []
        said = next((f": {line.strip()}" for line in reversed(lines) if line.strip()), "")
        return f"the process ended with {how}{said}"


@contextlib.contextmanager
def _one_thread_each() -> Iterator[None]:
    """Let numerical libraries of processes started meanwhile use one core each."""
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update({name: "1" for name, value in before.items() if value is None})
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
