"""One agent under supervision: started, started again with back-off when it crashed, stopped."""

from __future__ import annotations

from pathlib import Path

from dsr.clock import Clock
from dsr.runtime.launched import Launched
from dsr.runtime.orders import EXIT_USAGE

FIRST_BACKOFF = 0.2
"""s until the first restart; doubles with each."""
LAST_BACKOFF = 5.0
"""s, the longest wait."""
HEALTHY_AFTER = 10.0
"""s of running after which the back-off starts again from the first."""
_TAIL = 1 << 14  # bytes of a log in which its last lines are looked for


class Supervised:
    """Keeps one agent running.

    Args:
        launched: the agent, as a process or in one that it shares.
        clock: measures the waits.
        restart: start it again when it crashed.
    """

    def __init__(self, launched: Launched, *, clock: Clock, restart: bool = True) -> None:
        self.restarts = 0
        self.exit_code: int | None = None
        """How it ended when it last did; negative for a signal."""
        self.ended = False
        """It is not running and will not be started again."""
        self._launched = launched
        self._clock = clock
        self._restart = restart
        self._runs = False
        self._started = 0.0
        self._start_at: float | None = None
        self._backoff = FIRST_BACKOFF

    @property
    def log_file(self) -> Path:
        """File with what it says."""
        return self._launched.logs[0]

    @property
    def runs(self) -> bool:
        """Whether it was started and is not known to have ended."""
        return self._runs

    @property
    def pid(self) -> int | None:
        """Id of the process that it runs in; None while it does not run."""
        return self._launched.pid if self._runs else None

    def start(self) -> None:
        """Start it."""
        self._launched.start(self.restarts)
        self._runs = True
        self._started = self._clock.monotonic()
        self._start_at = None

    def poll(self) -> None:
        """Notice that it ended; start it again when that is due."""
        if self._runs and (code := self._launched.exit_code()) is not None:
            self._runs, self.exit_code = False, code
            self._after_exit(code)
        elif self._start_at is not None and self._clock.monotonic() >= self._start_at:
            self.restarts += 1
            self.start()

    def terminate(self) -> None:
        """Ask its process to end; it is not started again."""
        self.ended = True
        self._start_at = None
        self._launched.terminate()

    def has_ended(self) -> bool:
        """Whether no process is left, after `terminate`."""
        if self._runs and (code := self._launched.exit_code()) is not None:
            self._runs, self.exit_code = False, code
        return self._launched.is_gone()

    def kill(self) -> None:
        """End its process, and all that this one started, at once."""
        self.ended = True
        self._start_at = None
        self._launched.kill()
        self.has_ended()

    def _after_exit(self, code: int) -> None:
        """Plan the next start, unless it ended well, cannot be helped, or should not be restarted."""
        now = self._clock.monotonic()
        if code in (0, EXIT_USAGE) or not self._restart:
            self.ended = True
            return
        if now - self._started > HEALTHY_AFTER:
            self._backoff = FIRST_BACKOFF
        self._start_at = now + self._backoff
        self._backoff = min(2 * self._backoff, LAST_BACKOFF)

    def last_lines(self, most: int = 12) -> str:
        """The last lines of its logs, at most `most` of each."""
        return "\n".join(line for file in self._launched.logs for line in _last_lines(file, most))


def _last_lines(file: Path, most: int) -> list[str]:
    try:
        with file.open("rb") as log:
            log.seek(max(0, file.stat().st_size - _TAIL))
            return log.read().decode(errors="replace").splitlines()[-most:]
    except OSError:
        return []
