"""Signals that end a process in good order: an event is set from a thread of its own, never from the handler."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
from collections.abc import Iterator

ENDING = (signal.SIGINT, signal.SIGTERM)


@contextlib.contextmanager
def set_on_signals(stop: threading.Event) -> Iterator[None]:
    """Within it, SIGINT and SIGTERM set `stop`; only for the main thread.

    A handler runs between two instructions of the main thread, which may just then hold the lock of the very event:
    setting it there could wait for that lock for ever. The interpreter therefore writes the signal's number into a pipe
    (`signal.set_wakeup_fd`), and the thread that reads it sets the event.
    """
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    follower = threading.Thread(target=_follow, args=(reading, stop), name="signals", daemon=True)
    follower.start()
    earlier = signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    handlers = {number: signal.signal(number, lambda *_: None) for number in ENDING}
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(earlier)
        os.close(writing)
        follower.join()


def _follow(reading: int, stop: threading.Event) -> None:
    while number := os.read(reading, 1):
        if number[0] in ENDING:
            stop.set()
    os.close(reading)
