"""Lets a server that reads standard input end with a signal: the thread that reads could not be woken otherwise."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
from collections.abc import Callable, Iterator
from types import FrameType

_CHUNK = 65536
"""Bytes that are passed on at once: as many as a pipe of Linux holds"""
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextlib.contextmanager
def input_that_ends() -> Iterator[None]:
    """Within the context, standard input ends at Ctrl-C and the like, as if whoever writes to it had closed it.

    Raises `KeyboardInterrupt` at the end of the context if a signal came. Only for the main thread.
    """
    original, (taken, given) = os.dup(0), os.pipe()
    os.dup2(taken, 0)
    os.close(taken)
    end, came = _once(given), list[int]()

    def on_signal(number: int, _: FrameType | None) -> None:
        came.append(number)
        end()

    heeded = [number for number in _SIGNALS if signal.getsignal(number) is not signal.SIG_IGN]
    before = {number: signal.signal(number, on_signal) for number in heeded}
    threading.Thread(target=_pass_on, args=(original, given, end), name="standard input", daemon=True).start()
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        end()
    if came:
        raise KeyboardInterrupt


def _pass_on(source: int, destination: int, end: Callable[[], None]) -> None:
    """Copy bytes until one of the two is closed."""
    with contextlib.suppress(OSError):
        while data := os.read(source, _CHUNK):
            while data:
                data = data[os.write(destination, data) :]
    end()


def _once(descriptor: int) -> Callable[[], None]:
    """Closes a descriptor when it is called first."""
    left = [descriptor]

    def close() -> None:
        with contextlib.suppress(IndexError, OSError):
            os.close(left.pop())

    return close
