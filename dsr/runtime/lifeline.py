"""A process that was launched ends, with all it started, when its launcher is gone: even by `kill -9`.

The launcher holds the writing end of the process's standard input. What it writes there are orders to a process that
several agents share (dsr/runtime/orders.py); to all others it never writes. When the launcher dies, the
kernel closes that end and the process reads an end of file. This works on every POSIX system and whichever thread
of the launcher started the process (`PR_SET_PDEATHSIG` follows the thread instead).
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Mapping

from dsr.clock import WALL_CLOCK
from dsr.network.rendezvous import remove_leftover_claim

LAUNCHED = "DSR_LAUNCHED"
"""Environment variable of a launched process: its standard input is its lifeline; how often it was started before."""
_MOST_AT_ONCE = 1 << 16  # bytes
_GRACE = 6.0  # s to end in an orderly way
_CLOSING, _PERIOD = 60, 0.05  # so many times so many s for the files of a process that was killed to be closed


def follow_launcher(
    environment: Mapping[str, str], stop: threading.Event, take: Callable[[bytes], None] = lambda written: None
) -> threading.Event:
    """If this process was launched, set `stop` when the launcher is gone; end the hard way if that is not enough.

    Args:
        environment: of this process.
        stop: ends it in good order.
        take: gets what the launcher writes, piece by piece, in a thread of its own.

    Returns:
        What is set before `stop` if that is why.
    """
    gone = threading.Event()
    if environment.get(LAUNCHED):
        threading.Thread(target=_wait_for_end, args=(gone, stop, take), name="lifeline", daemon=True).start()
    return gone


def clear_up_after_launcher(graph: str) -> None:
    """Remove what a launcher left that is gone; the kernel may still be closing its files, one after the other."""
    for _ in range(_CLOSING):
        if not remove_leftover_claim(graph):
            return
        WALL_CLOCK.wait(threading.Event(), _PERIOD)


def _wait_for_end(gone: threading.Event, stop: threading.Event, take: Callable[[bytes], None]) -> None:
    with contextlib.suppress(OSError):
        while written := os.read(sys.stdin.fileno(), _MOST_AT_ONCE):
            take(written)
    gone.set()
    stop.set()
    WALL_CLOCK.wait(threading.Event(), _GRACE)
    if os.getpgrp() == os.getpid():
        os.killpg(os.getpgrp(), signal.SIGKILL)
    os._exit(1)
