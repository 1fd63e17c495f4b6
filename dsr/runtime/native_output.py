"""Keeps the output of native libraries (banners, progress) off standard output and standard error."""

from __future__ import annotations

import contextlib
import ctypes
import os
import sys
import threading
from collections.abc import Iterator

_STREAMS = (1, 2)
_one_at_a_time = threading.RLock()


@contextlib.contextmanager
def silenced() -> Iterator[None]:
    """Send what C code prints inside to nowhere, also what it only buffers. Python's output is lost too.

    Another thread that wants the same waits until this one is done.
    """
    with _one_at_a_time:
        yield from _silenced()


def _silenced() -> Iterator[None]:
    _flush()
    saved = [os.dup(number) for number in _STREAMS]
    null = os.open(os.devnull, os.O_WRONLY)
    try:
        for number in _STREAMS:
            os.dup2(null, number)
        yield
    finally:
        _flush()
        for number, copy in zip(_STREAMS, saved, strict=True):
            os.dup2(copy, number)
            os.close(copy)
        os.close(null)


def _flush() -> None:
    sys.stdout.flush()
    sys.stderr.flush()
    ctypes.CDLL(None).fflush(None)
