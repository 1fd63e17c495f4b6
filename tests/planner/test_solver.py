"""Fast Downward as a process: found or not, ended on our clock, read by files and exit code."""

from __future__ import annotations

import logging
import sys
import threading
from pathlib import Path

import psutil
import pytest

from dsr.clock import WALL_CLOCK, ManualClock
from dsr.vocabulary.goals import parse_goal
from planner import solver
from planner.config import PlannerConfig
from planner.errors import SolverFailed, SolverMissing, Unsolvable
from planner.making import PlanMaker
from planner.solver import Solver, SolverAnswer, find_solver, probe, solve
from planner.state import read_state
from tests.planner.table import TOWERS, Run

DOMAIN = """(define (domain lamps) (:requirements :negative-preconditions) (:predicates (lit) (broken))
(:action light :parameters () :precondition (not (broken)) :effect (lit)))"""
PROBLEM = "(define (problem now) (:domain lamps) (:init {}) (:goal ({})))"


@pytest.fixture
def domain(tmp_path: Path) -> Path:
    file = tmp_path / "domain.pddl"
    file.write_text(DOMAIN)
    return file


@pytest.fixture
def fake(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A program in the solver's place; returns where to write it."""
    program = tmp_path / "fast-downward.py"
    monkeypatch.setattr(solver, "find_solver", lambda: program)
    return program


def wait_for(running: Solver) -> SolverAnswer:
    while (solution := running.poll()) is None:
        WALL_CLOCK.wait(threading.Event(), 0.02)
    return solution


def test_it_is_installed_and_tells_its_version() -> None:
    assert find_solver().name == "fast-downward.py"
    assert probe().startswith("Fast Downward")


def test_a_plan_with_what_the_solver_printed(domain: Path) -> None:
    running = Solver(domain, PROBLEM.format("", "lit"), WALL_CLOCK, limit=30.0)
    folder = running._folder
    solution = wait_for(running)
    assert solution.plan.splitlines()[0].strip() == "(light )" and "Solution found" in solution.output
    assert 0.0 < solution.seconds < 30.0
    assert not folder.exists()


def test_no_plan(domain: Path) -> None:
    with pytest.raises(Unsolvable, match=r"there is no plan: .* \(exit code 1[01]\)"):
        solve(domain, PROBLEM.format("(broken)", "lit"), WALL_CLOCK, limit=30.0)


def test_a_wrong_problem_shows_what_the_solver_said(domain: Path) -> None:
    with pytest.raises(SolverFailed, match=r"exit code 3[01].*dim"):
        solve(domain, PROBLEM.format("", "dim"), WALL_CLOCK, limit=30.0)


def test_a_missing_solver_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch, domain: Path) -> None:
    monkeypatch.setattr(solver, "PACKAGE", "no_such_package_at_all")
    with pytest.raises(SolverMissing, match=r"pip install 'dsr-memory\[planning\]'"):
        Solver(domain, "", WALL_CLOCK, limit=1.0)


def test_a_solver_that_takes_too_long_is_ended_with_its_children(fake: Path, domain: Path, tmp_path: Path) -> None:
    pids = tmp_path / "pids"
    fake.write_text(
        "import os, subprocess, sys, time\n"
        "child = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(600)'])\n"
        f"open({str(pids)!r}, 'w').write(f'{{os.getpid()}} {{child.pid}}\\n')\n"
        "time.sleep(600)\n"
    )
    running = Solver(domain, "", WALL_CLOCK, limit=2.0)
    while not (pids.exists() and pids.read_text().endswith("\n")):
        WALL_CLOCK.wait(threading.Event(), 0.02)
    with pytest.raises(SolverFailed, match="found no plan in 2 s and was ended"):
        wait_for(running)
    for pid in map(int, pids.read_text().split()):
        assert not is_alive(pid)


def is_alive(pid: int) -> bool:
    """Whether a process runs; one that has ended and that nobody has asked after yet does not."""
    for _ in range(100):
        try:
            state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
        except OSError:
            return False
        if state == "Z":
            return False
        WALL_CLOCK.wait(threading.Event(), 0.02)
    return True


def test_a_complete_plan_counts_whatever_the_exit_code(fake: Path, domain: Path) -> None:
    fake.write_text("open('sas_plan', 'w').write('(light)\\n; cost = 1 (unit cost)\\n'); raise SystemExit(23)")
    assert wait_for(Solver(domain, "", WALL_CLOCK, limit=30.0)).plan.startswith("(light)")


def test_half_a_plan_does_not(fake: Path, domain: Path) -> None:
    fake.write_text("open('sas_plan', 'w').write('(light)\\n'); print('oh dear'); raise SystemExit(23)")
    with pytest.raises(SolverFailed, match="broke off with exit code 23: oh dear"):
        wait_for(Solver(domain, "", WALL_CLOCK, limit=30.0))


def test_on_a_manual_clock_the_result_is_there_at_a_fixed_time(fake: Path, domain: Path) -> None:
    fake.write_text("import time; time.sleep(0.3); open('sas_plan', 'w').write('(light)\\n; cost = 1\\n')")
    clock = ManualClock()
    running = Solver(domain, "", clock, limit=30.0, delay=0.5)
    for _ in range(4):
        assert running.poll() is None
        clock.advance(0.1)
    clock.advance(0.1)
    solution = running.poll()
    assert solution is not None and solution.seconds == pytest.approx(0.5)


def test_closing_ends_it_at_once(fake: Path, domain: Path) -> None:
    fake.write_text("import time; time.sleep(600)")
    running = Solver(domain, "", WALL_CLOCK, limit=600.0)
    folder = running._folder
    running.close()
    running.close()
    assert not folder.exists() and not is_alive(running._process.pid)


def test_nothing_of_the_package_is_imported() -> None:
    probe()
    assert "up_fast_downward" not in sys.modules and "unified_planning" not in sys.modules


def test_who_waits_no_longer_for_a_plan_ends_the_solver() -> None:
    config = PlannerConfig()
    with Run() as run:
        maker = PlanMaker(WALL_CLOCK, config, logging.getLogger("maker"))
        before = psutil.Process().children()
        plan = maker.make(read_state(run.memory, config), parse_goal(TOWERS), [])
        next(plan)
        [solver] = [child for child in psutil.Process().children() if child not in before]
        plan.close()
        assert not solver.is_running()
