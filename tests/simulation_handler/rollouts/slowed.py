"""Workers that are slow on purpose: at their start, or with each job; they go on when they are told to."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import pytest

from simulation_handler.physics.rollouts import process as process_module

_WORKER = """#!{python}
import os, pathlib, sys, threading

def wait():
    while not pathlib.Path({flag!r}).exists():
        threading.Event().wait(0.02)

if {starts}:
    wait()
from simulation_handler.physics.rollouts import worker
from simulation_handler.physics.rollouts.engine import Engine

run = Engine.run

def slowed(self, scene, seconds):
    {jobs}
    return run(self, scene, seconds)

Engine.run = slowed
sys.argv = sys.argv[-2:]
worker.main()
"""
_JOBS = {"run": "pass", "wait": "wait()", "spin": "while True: pass", "die": "os._exit(1)"}


def slow_down(
    monkeypatch: pytest.MonkeyPatch,
    folder: Path,
    *,
    starts: bool = False,
    jobs: Literal["run", "wait", "spin", "die"] = "run",
) -> Callable[[], None]:
    """Let workers that are started from now on wait before they start, or before each job; returns what ends that."""
    flag, script = folder / "go_on", folder / "worker"
    script.write_text(_WORKER.format(python=sys.executable, flag=str(flag), starts=starts, jobs=_JOBS[jobs]))
    script.chmod(0o755)
    monkeypatch.setattr(process_module.sys, "executable", str(script))
    return flag.touch
