"""Fast Downward as a process of its own: started, asked, read by its files and exit code, ended on our time limit.

It is GPL-3 and is never imported: the package up-fast-downward only tells where its program lies. Its own limits count
processor time and do not bound how long it takes, so we end it ourselves, with its children; they stand behind ours
for the case that this process dies first.

A process takes as long as it takes. To make runs on a manual clock repeatable, its result is taken there at a fixed
time after its start, and waited for then; time stands still meanwhile.
"""

from __future__ import annotations

import contextlib
import importlib.util
import math
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from dsr.clock import Clock, ManualClock
from planner.config import PlannerConfig
from planner.errors import PlanningError, SolverFailed, SolverMissing, Unsolvable

PACKAGE = "up_fast_downward"
INSTALL = "pip install 'dsr-memory[planning]'"
UNSOLVABLE = (10, 11)
"""Exit codes: the translator, or the search, has proved that there is no plan."""
_COMPLETE = "; cost ="
"""Begins the last line of a plan file that was written to its end."""
_TAIL = 6  # lines of output in an error


def find_solver() -> Path:
    """The driver script. Raises `SolverMissing`, which says how to install it."""
    spec = importlib.util.find_spec(PACKAGE)
    for folder in (spec.submodule_search_locations or ()) if spec else ():
        program = Path(folder) / "downward" / "fast-downward.py"
        if program.is_file():
            return program
    raise SolverMissing(f"the solver Fast Downward is not installed; run: {INSTALL}")


def probe() -> str:
    """Name and version, as the solver itself says. Raises `SolverMissing`, or `SolverFailed` if it does not start."""
    program = [sys.executable, str(find_solver()), "--version"]
    found = subprocess.run(program, capture_output=True, text=True, timeout=PlannerConfig().solver_limit, check=False)
    lines = found.stdout.splitlines()
    if found.returncode != 0 or not lines:
        raise SolverFailed(f"the solver does not start: {_tail(found.stdout + found.stderr)}")
    return lines[0]


@dataclass(frozen=True)
class SolverAnswer:
    """The result of the solver."""

    plan: str
    """Text of the plan file."""
    output: str
    """The text that the solver printed."""
    seconds: float
    """Duration of the search, on the planner's clock (s)."""


class Solver:
    """One run of the solver. Use `poll` until it gives a solution; `close` ends it at any time.

    Args:
        domain: file of the domain.
        problem: text of the problem.
        clock: for the time limit.
        limit: s
        delay: s of a manual clock after which the result is there.

    Raises:
        SolverMissing: if it is not installed.
        SolverFailed: if it cannot be started.
    """

    def __init__(self, domain: Path, problem: str, clock: Clock, *, limit: float, delay: float = 0.0) -> None:
        program = find_solver()
        self._clock, self._limit, self._delay = clock, limit, delay
        self._closed = False
        self._folder = Path(tempfile.mkdtemp(prefix="dsr-planner-"))
        try:
            (self._folder / "problem.pddl").write_text(problem, encoding="utf-8")
            shutil.copyfile(domain, self._folder / "domain.pddl")
            cpu = f"--overall-time-limit={math.ceil(2.0 * limit)}s"
            with (self._folder / "output").open("wb") as output:
                self._process = subprocess.Popen(
                    [sys.executable, str(program), cpu, "--alias", "lama-first", "domain.pddl", "problem.pddl"],
                    cwd=self._folder,
                    stdin=subprocess.DEVNULL,
                    stdout=output,
                    stderr=subprocess.STDOUT,
                    start_new_session=True,
                )
        except OSError as error:
            shutil.rmtree(self._folder, ignore_errors=True)
            raise SolverFailed(f"the solver cannot be started: {error}") from error
        self._started = clock.monotonic()

    def poll(self) -> SolverAnswer | None:
        """The solution, or None while it is at work. After an answer it is closed.

        Raises:
            Unsolvable: if there is no plan.
            SolverFailed: if it broke off or took longer than the limit.
        """
        elapsed = self._clock.monotonic() - self._started
        if isinstance(self._clock, ManualClock):
            if elapsed < self._delay:
                return None
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(self._limit)
        code = self._process.poll()
        if code is None and elapsed < self._limit and not isinstance(self._clock, ManualClock):
            return None
        try:
            return self._result(code, elapsed)
        finally:
            self.close()

    def close(self) -> None:
        """End it with its children, and remove its files; harmless when repeated."""
        if self._closed:
            return
        self._closed = True
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGKILL)  # its group; the children may outlive it
        self._process.wait()
        shutil.rmtree(self._folder, ignore_errors=True)

    def _result(self, code: int | None, elapsed: float) -> SolverAnswer:
        output = _text(self._folder / "output")
        plan = _text(self._folder / "sas_plan")
        if _COMPLETE in plan:  # whatever the exit code says: it is 23 if time ran out after a plan was written
            return SolverAnswer(plan, output, elapsed)
        if code is None:
            raise SolverFailed(f"the solver found no plan in {self._limit:g} s and was ended")
        if code in UNSOLVABLE:
            raise Unsolvable(f"there is no plan: the solver has tried everything (exit code {code})")
        raise SolverFailed(f"the solver broke off with exit code {code}: {_tail(output)}")


def _text(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""


def _tail(output: str) -> str:
    lines = [line.strip() for line in output.splitlines() if line.strip()]
    return " | ".join(lines[-_TAIL:]) or "it printed nothing"


def solve(domain: Path, problem: str, clock: Clock, *, limit: float) -> SolverAnswer:
    """Run the solver to its end: for measurements and tests. Raises what `Solver` raises, and `PlanningError`."""
    solver = Solver(domain, problem, clock, limit=limit)
    try:
        solver._process.wait(limit)
    except subprocess.TimeoutExpired:
        solver.close()
        raise SolverFailed(f"the solver found no plan in {limit:g} s and was ended") from None
    solution = solver.poll()
    if solution is None:
        raise PlanningError("the solver has ended without an answer")
    return solution
