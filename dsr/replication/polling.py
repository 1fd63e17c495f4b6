"""One thread for all replicas of a memory, the base's and those of its worlds: it does the work that is due in each."""

from __future__ import annotations

import contextlib
import threading
from collections import deque
from collections.abc import Callable, Iterator

from dsr.clock import Clock
from dsr.threads import new_thread

TICK = 0.05
"""s between two rounds, in which every replica is polled."""
_PATIENCE = 2.0  # s to wait for a poll that does not end

Poll = Callable[[], None]
"""Does the work that is due, and raises nothing."""


class Poller:
    """Calls each poll regularly, and at once when it is asked for; runs a thread while there are any."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._polls: tuple[Poll, ...] = ()
        self._asked: deque[Poll] = deque()
        self._bell = threading.Event()
        self._changing = threading.Lock()
        self._polling = threading.Condition()
        self._current: Poll | None = None
        self._thread: threading.Thread | None = None

    def add(self, poll: Poll) -> None:
        """Call `poll` from now on, first at once."""
        with self._changing:
            self._polls = (*self._polls, poll)
            self._asked.append(poll)
            if self._thread is None:
                self._thread = new_thread(self._run, "dsr-sync")
                self._thread.start()
        self._bell.set()

    def ask(self, poll: Poll) -> None:
        """Have `poll` called at once; may be called in any thread, and returns at once."""
        self._asked.append(poll)
        self._bell.set()

    def remove(self, poll: Poll) -> None:
        """Do not call `poll` any more; waits until it has returned, unless that is where this is called."""
        with self._changing:
            self._polls = tuple(other for other in self._polls if other != poll)
            thread, ended = self._thread, not self._polls
            if ended:
                self._thread = None
        self._bell.set()
        if thread is None or thread is threading.current_thread():
            return
        with self._polling:
            self._polling.wait_for(lambda: self._current != poll, _PATIENCE)
        if ended:
            thread.join(_PATIENCE)

    def _run(self) -> None:
        due = self._clock.monotonic()
        while self._thread is threading.current_thread():
            self._clock.wait(self._bell, due - self._clock.monotonic())
            self._bell.clear()
            chosen = dict.fromkeys(self._taken())
            if self._clock.monotonic() >= due:
                chosen |= dict.fromkeys(self._polls)
                due = self._clock.monotonic() + TICK
            for poll in chosen:
                if self._begins(poll):
                    poll()
                    self._ends()

    def _begins(self, poll: Poll) -> bool:
        """Whether a poll is to be called, still; it is running then."""
        with self._polling:
            self._current = poll if poll in self._polls else None
            return self._current is not None

    def _ends(self) -> None:
        with self._polling:
            self._current = None
            self._polling.notify_all()

    def _taken(self) -> Iterator[Poll]:
        """What was asked for, taken out."""
        with contextlib.suppress(IndexError):
            while True:
                yield self._asked.popleft()
