"""Runs groups one after the other, each in fresh processes that end with it, whatever happens."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import msgspec

from benchmarks.group import Curve, Group, Measured, Message, Missing, Step
from benchmarks.progress import Progress
from benchmarks.rows import Row, Spec, median_row
from benchmarks.shared_memory import remove_leftovers
from benchmarks.workers import BenchmarkError
from dsr.runtime.lifeline import LAUNCHED

_GRACE = 3.0  # s for the processes of a group to end by themselves
_decoder = msgspec.json.Decoder(Message)


class Findings(msgspec.Struct):
    """What was measured so far."""

    rows: list[Row] = []
    curves: dict[str, Any] = {}
    """Data of the plots, by name."""
    missing: set[str] = set()
    """Modules of peers that are not installed."""


@contextlib.contextmanager
def private_runtime() -> Iterator[None]:
    """Let the measured graphs meet nobody else, and leave nothing behind."""
    with tempfile.TemporaryDirectory(prefix="dsr-bench-") as folder:
        before = os.environ.get("XDG_RUNTIME_DIR")
        os.environ["XDG_RUNTIME_DIR"] = folder
        try:
            yield
        finally:
            os.environ.pop("XDG_RUNTIME_DIR")
            if before is not None:
                os.environ["XDG_RUNTIME_DIR"] = before
            remove_leftovers()


def measure(
    group: Group, specs: Sequence[Spec], findings: Findings, *, quick: bool, repeat: int, progress: Progress
) -> None:
    """Add the rows `specs` of a group to the findings, as medians of `repeat` runs.

    Raises:
        BenchmarkError: if the group's process fails or leaves out a row.
    """
    runs: dict[str, list[Row]] = {spec.row: [] for spec in group.specs}
    wanted = {spec.row for spec in specs}
    for number in range(repeat):
        again = f", run {number + 1} of {repeat}" if repeat > 1 else ""
        for message in _messages(group, quick=quick):
            match message:
                case Step(text):
                    progress.step(text + again)
                case Measured(row):
                    runs[row.row].append(row)
                    if row.row in wanted:
                        progress.row(row)
                case Curve(name, data):
                    findings.curves[name] = data
                case Missing(module):
                    findings.missing.add(module)
    findings.rows += [median_row(spec, runs[spec.row]) for spec in specs if runs[spec.row]]


def _messages(group: Group, *, quick: bool) -> Iterator[Message]:
    """What the group's process reports. Its standard input is its lifeline."""
    command = [sys.executable, "-m", "benchmarks.process", group.name, *(["--quick"] if quick else [])]
    environment = {**os.environ, LAUNCHED: "0", "PYTHONPATH": _search_path()}
    with tempfile.TemporaryFile() as complaints:
        process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=complaints, env=environment,
            start_new_session=True,
        )  # fmt: skip
        try:
            assert process.stdout is not None
            yield from (_decoder.decode(line) for line in process.stdout)
            if process.wait() != 0:
                complaints.seek(0)
                reason = complaints.read().decode(errors="replace").strip()
                raise BenchmarkError(f"group {group.name!r} failed: {reason}")
        finally:
            _end(process)


def _end(process: subprocess.Popen[bytes]) -> None:
    """End the process and all that it started."""
    with contextlib.suppress(ProcessLookupError):
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGTERM)
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(_GRACE)
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            pipe.close()


def _search_path() -> str:
    """Where modules were found in this process, so that it finds the same ones."""
    root = str(Path(__file__).parents[1])
    return os.pathsep.join([root, *filter(None, [os.environ.get("PYTHONPATH")])])
