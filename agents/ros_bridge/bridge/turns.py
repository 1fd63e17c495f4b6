"""Who works when: the tick, or a thread of the connection in between; and how long work rests after that."""

from __future__ import annotations

import contextlib
import math
import threading
from collections.abc import Callable, Iterator
from time import thread_time  # what work costs, however long others keep the processor

from dsr.clock import Clock, ManualClock

_REST = 10
"""Times as long as work took of a processor that somebody had asked for, until more is done before the next due tick:
so that a flood takes a tenth of a core"""


class Turns:
    """Lets the tick and the threads of the connection work one at a time.

    Args:
        clock: the agent's. On a manual one nothing is done between ticks: runs of one seed stay identical.
        wake: asks for a tick now; called in any thread.
    """

    def __init__(self, clock: Clock, wake: Callable[[], None]) -> None:
        self._clock, self._wake = clock, wake
        self._between = not isinstance(clock, ManualClock)
        self._lock = threading.Lock()
        self._rested = -math.inf
        """s, our monotonic time from which there may be work between ticks"""
        self._woken = False

    def notify(self) -> None:
        """Something came or changed: tick at once, unless work takes so long that it has to wait for the next tick."""
        if not self._woken and self._clock.monotonic() >= self._rested:
            self._woken = True
            self._wake()

    def do_now(self, work: Callable[[], None]) -> None:
        """Do `work` in this thread, if nobody works and all have rested; else as `notify`, and the tick does it.

        Another thread need not come to run before it is done, which may take as long as all else.
        """
        if not self._between or self._clock.monotonic() < self._rested or not self._lock.acquire(blocking=False):
            self.notify()
            return
        try:
            with self._resting():
                work()
        finally:
            self._lock.release()

    @contextlib.contextmanager
    def tick(self) -> Iterator[None]:
        """Within it, nobody else works; whoever notifies asks for one more tick."""
        with self._lock:
            woken, self._woken = self._woken, False
            with self._resting() if woken else contextlib.nullcontext():
                yield

    @contextlib.contextmanager
    def _resting(self) -> Iterator[None]:
        began = thread_time()
        try:
            yield
        finally:
            self._rested = self._clock.monotonic() + _REST * (thread_time() - began)
