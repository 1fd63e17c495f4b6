"""Copies of a checkout in a temporary folder, and pytest runs in them."""

from __future__ import annotations

import contextlib
import io
import json
import os
import shutil
import signal
import subprocess
import sys
import tarfile
import tempfile
import threading
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import psutil

from dsr.errors import DsrError

_REPLACED = ("tests", "benchmarks")
"""What is taken from another revision: the tests, and what they import beside the packages."""


_STARTING = 60.0
"""s that pytest may take to start and to import what is tested, before its first test begins."""
_LOOK = 0.05
"""s between two looks whether a test has begun."""


class MutationError(DsrError):
    """Mutants cannot be tried like this."""


@dataclass(frozen=True)
class Outcome:
    """What a run of pytest told."""

    code: int | None
    """Its exit code; none if its time was over."""
    notes: list[dict[str, Any]]
    """Lines of the plugin."""

    @property
    def last_begun(self) -> str:
        """The test that ran when the run ended."""
        return next((note["begun"] for note in reversed(self.notes) if "begun" in note), "")

    @property
    def failed(self) -> list[str]:
        """Tests that failed, and files that could not be collected."""
        return [note["failed"] for note in self.notes if "failed" in note]


class Sandbox:
    """A copy of a checkout. A context manager: afterwards nothing of it is left.

    Copied is what git knows or would add, with what was changed meanwhile; without git, everything. `tests_from` is a
    revision whose tests replace the present ones. Raises `MutationError` if there is no such revision.
    """

    def __init__(self, checkout: Path, tests_from: str | None = None) -> None:
        self._folder = Path(tempfile.mkdtemp(prefix="mutants-"))
        self.root = self._folder / "dsr"
        self._process: subprocess.Popen[bytes] | None = None
        self._is_closed = False
        self._lock = threading.Lock()
        """No process begins once it is closed."""
        try:
            _copy(checkout, self.root)
            if tests_from is not None:
                _replace(checkout, self.root, tests_from)
            (self._folder / "plugin").mkdir()
            shutil.copy(Path(__file__).with_name("pytest_plugin.py"), self._folder / "plugin/mutants_plugin.py")
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End what runs, and remove the copy. From any thread; harmless when repeated."""
        with self._lock:
            self._is_closed = True
            if self._process is not None:
                _end(self._process)
        shutil.rmtree(self._folder, ignore_errors=True)

    def pytest(
        self, files: Iterable[str], tests: Iterable[str] = (), *, seconds: float, file_seconds: float | None = None
    ) -> Outcome:
        """Run tests of these files until the first failure, for at most so many s and what starting takes.

        Args:
            files: relative to the root.
            tests: only these, in this order; all, if there are none.
            seconds: after the first test began; afterwards everything is ended.
            file_seconds: if given, go on after failures, note which functions each test runs, and leave a file after
                so many s.
        """
        for name in ("tmp", "run"):
            shutil.rmtree(self._folder / name, ignore_errors=True)
            (self._folder / name).mkdir(mode=0o700)
        shutil.rmtree(self.root / ".hypothesis", ignore_errors=True)  # what failed once is not tried first later
        notes, order = self._folder / "run/notes", self._folder / "run/order"
        order.write_text(json.dumps({"notes": str(notes), "tests": list(tests), "file_seconds": file_seconds}))
        notes.touch()
        environment = {
            **os.environ,
            "PYTHONDONTWRITEBYTECODE": "1",
            "PYTHONPATH": f"{self.root}:{self._folder / 'plugin'}",
            "TMPDIR": str(self._folder / "tmp"),
            "XDG_RUNTIME_DIR": str(self._folder / "run"),
            "MUTANTS_ORDER": str(order),
        }
        command = [
            sys.executable,
            "-m",
            "pytest",
            "-q",
            "-p",
            "no:cacheprovider",
            "-p",
            "mutants_plugin",
            "--hypothesis-seed=0",
        ]
        command += ["--timeout=60"] if file_seconds is not None else ["-x"]
        with self._lock:
            if self._is_closed:
                raise MutationError("the copy is closed")
            self._process = subprocess.Popen(
                [*command, *files], cwd=self.root, env=environment, start_new_session=True,
                stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            )  # fmt: skip
        try:
            _wait_begun(self._process, notes)
            code = self._process.wait(seconds)
        except subprocess.TimeoutExpired:
            code = None
        finally:
            _end(self._process)
        *whole, _ = notes.read_text().split("\n")  # who is ended may have written half a line
        return Outcome(code, [json.loads(line) for line in whole])


def _wait_begun(process: subprocess.Popen[bytes], notes: Path) -> None:
    """Wait until a test has begun, for as long as starting may take."""
    for _ in range(round(_STARTING / _LOOK)):
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(_LOOK)
            return
        if notes.stat().st_size:
            return


def _end(process: subprocess.Popen[bytes]) -> None:
    """End a process with all that it started."""
    try:
        started = psutil.Process(process.pid).children(recursive=True)
    except psutil.NoSuchProcess:
        started = []
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    for child in started:
        with contextlib.suppress(psutil.NoSuchProcess):
            child.kill()


def _copy(checkout: Path, root: Path) -> None:
    listed = _git(checkout, "ls-files", "-z", "--cached", "--others", "--exclude-standard")
    if listed is None:
        shutil.copytree(checkout, root, symlinks=True)
        return
    for name in listed.decode().split("\0"):
        file = checkout / name
        if name and file.is_file():
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(file, root / name)


def _replace(checkout: Path, root: Path, revision: str) -> None:
    for name in _REPLACED:
        archive = _git(checkout, "archive", revision, name)
        if archive is None:
            raise MutationError(f"{revision}: no such revision with a folder {name}/")
        shutil.rmtree(root / name, ignore_errors=True)
        with tarfile.open(fileobj=io.BytesIO(archive)) as files:
            files.extractall(root, filter="data")


def _git(folder: Path, *arguments: str) -> bytes | None:
    """What git prints; none if it refuses."""
    done = subprocess.run(["git", *arguments], cwd=folder, capture_output=True, check=False)
    return done.stdout if done.returncode == 0 else None
