"""Reads a hostile file in a process with little memory and time, and tells what became of it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

from benchmarks.attacks.files.reading import REFUSED


class Reading(NamedTuple):
    """What became of one reading."""

    ended_well: bool
    """Whether the file was read, or refused with a clear error."""
    said: str
    """The end of what the reader printed."""
    seconds: float
    """CPU seconds."""
    peak: int
    """Greatest resident memory of the reader, bytes."""


def read_limited(file: Path) -> Reading:
    """Read `file` in a child process."""
    command = [sys.executable, "-m", "benchmarks.attacks.files.reading", str(file)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as child:
        assert child.stdout is not None
        said = child.stdout.read().decode(errors="replace").strip()
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
    return Reading(
        child.returncode in (0, REFUSED), said[-500:], usage.ru_utime + usage.ru_stime, usage.ru_maxrss * 1024
    )
