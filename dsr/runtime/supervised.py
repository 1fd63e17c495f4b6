"""One agent process under supervision: started in a session of its own, restarted with back-off, stopped."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

from dsr.clock import Clock
from dsr.runtime.agent_process import EXIT_USAGE
from dsr.runtime.lifeline import LAUNCHED

FIRST_BACKOFF = 0.2
"""s until the first restart; doubles with each."""
LAST_BACKOFF = 5.0
"""s, the longest wait."""
HEALTHY_AFTER = 10.0
"""s of running after which the back-off starts again from the first."""
_TAIL = 1 << 14  # bytes of a log in which its last lines are looked for


class Supervised:
    """Keeps one process running.

    The process leads a session of its own, so that Ctrl-C in the terminal reaches only the launcher; whatever it
    started is in its process group and ends with it. Its standard input is its lifeline (dsr/runtime/lifeline.py).

    Args:
        command: the program and its arguments.
        log_file: gets its output; appended to at each restart.
        environment: of the process.
        restart: start it again when it crashed.
    """

    def __init__(
        self,
        command: Sequence[str],
        log_file: Path,
        *,
        clock: Clock,
        environment: Mapping[str, str],
        restart: bool = True,
    ) -> None:
        self.log_file = log_file
        self.restarts = 0
        self.exit_code: int | None = None
        """Of the last process that ended; negative for a signal."""
        self.ended = False
        """It is not running and will not be started again."""
        self._command = list(command)
        self._clock = clock
        self._environment = {**environment, "PYTHONUNBUFFERED": "1"}
        self._restart = restart
        self._process: subprocess.Popen[bytes] | None = None
        self._started = 0.0
        self._start_at: float | None = None
        self._backoff = FIRST_BACKOFF

    @property
    def pid(self) -> int | None:
        """Id of the running process; None while there is none."""
        return self._process.pid if self._process else None

    def start(self) -> None:
        """Start the process."""
        with self.log_file.open("ab") as log:
            self._process = subprocess.Popen(
                self._command,
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=subprocess.STDOUT,
                env={**self._environment, LAUNCHED: str(self.restarts)},
                start_new_session=True,
            )
        self._started = self._clock.monotonic()
        self._start_at = None

    def poll(self) -> None:
        """Notice that the process ended; start it again when that is due."""
        if self._process is not None and self._has_exited(self._process):
            self._reap(self._process)
            self._after_exit()
        elif self._start_at is not None and self._clock.monotonic() >= self._start_at:
            self.restarts += 1
            self.start()

    def terminate(self) -> None:
        """Ask the process to end; it is not started again."""
        self.ended = True
        self._start_at = None
        if self._process is not None:
            with contextlib.suppress(ProcessLookupError):
                self._process.terminate()

    def has_ended(self) -> bool:
        """Whether no process is left, after `terminate`."""
        if self._process is not None and self._has_exited(self._process):
            self._reap(self._process)
        return self._process is None

    def kill(self) -> None:
        """End the process and all it started at once."""
        self.ended = True
        if self._process is not None:
            self._reap(self._process)

    def _has_exited(self, process: subprocess.Popen[bytes]) -> bool:
        """Whether it has, without reaping it: until then nobody else can get its process group's number."""
        return os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None

    def _reap(self, process: subprocess.Popen[bytes]) -> None:
        """Kill what is left of the process group and collect the exit code."""
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
        self.exit_code = process.wait()
        if process.stdin is not None:
            process.stdin.close()
        self._process = None

    def _after_exit(self) -> None:
        """Plan the next start, unless it ended well, cannot be helped, or should not be restarted."""
        now = self._clock.monotonic()
        if self.exit_code in (0, EXIT_USAGE) or not self._restart:
            self.ended = True
            return
        if now - self._started > HEALTHY_AFTER:
            self._backoff = FIRST_BACKOFF
        self._start_at = now + self._backoff
        self._backoff = min(2 * self._backoff, LAST_BACKOFF)

    def last_lines(self, most: int = 12) -> str:
        """The last lines of the process's log, at most `most`."""
        try:
            with self.log_file.open("rb") as log:
                log.seek(max(0, self.log_file.stat().st_size - _TAIL))
                lines = log.read().decode(errors="replace").splitlines()
        except OSError:
            return ""
        return "\n".join(lines[-most:])
