"""A thread that carries out one command after the other; of those that wait, the newest wins."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable

from dsr.errors import DsrError

_log = logging.getLogger("dsr.ros")


class Lane:
    """Commands of one kind; whoever gives one never waits.

    Args:
        name: of the thread.
    """

    def __init__(self, name: str) -> None:
        self._condition = threading.Condition()
        self._next: Callable[[], None] | None = None
        self._busy = False
        self._closed = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def do(self, command: Callable[[], None]) -> None:
        """Carry out a command next, instead of the one that waits."""
        with self._condition:
            self._next = command
            self._condition.notify_all()

    @property
    def superseded(self) -> bool:
        """Whether a newer command waits, or the lane is to end: the present one may give up."""
        return self._next is not None or self._closed

    def wait_idle(self, timeout: float) -> bool:
        """Wait until nothing is to be done, at most `timeout` s; for those who end, and tests."""
        with self._condition:
            return self._condition.wait_for(lambda: self._next is None and not self._busy, timeout)

    def close(self, timeout: float) -> None:
        """Let the present command end, within `timeout` s, and take no more; harmless when repeated."""
        with self._condition:
            self._closed = True
            self._condition.notify_all()
        self._thread.join(timeout)

    def _run(self) -> None:
        while True:
            with self._condition:
                self._busy = False
                self._condition.notify_all()
                self._condition.wait_for(lambda: self._next is not None or self._closed)
                if self._next is None:
                    return
                command, self._next, self._busy = self._next, None, True
            try:
                command()
            except DsrError as error:
                _log.error("%s: %s", self._thread.name, error)
