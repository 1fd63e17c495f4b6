"""Checks the resources that the operating system gives a process, and explains in words when one runs out."""

from __future__ import annotations

import ctypes
import errno
import resource
import sys

ADDRESS_SPACE = 3 << 29
"""Bytes of address space (`ulimit -v`) that a process takes at least: libraries reserve 1.1 GiB on two cores."""
DESCRIPTORS = 48
"""Open files (`ulimit -n`) that a process needs at least: a graph of ten processes takes 40."""

KEPT = 32 << 20
"""Bytes of freed memory that stay at the end of each heap at most, for what is allocated next.

An image of 640 x 480 px with all that is worked out from it takes 10 MB. Threads that allocate much have heaps of
their own.
"""
_LARGEST_KEPT = 8 << 20
"""Bytes of one block up to which it is in a heap, where a smaller one beyond it may keep it: the largest array that is
worked out from an image, with three numbers of 8 bytes for each pixel, takes 7.4 MB."""
_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3  # numbers of glibc for its parameters

_SHORT = {
    errno.ENOSPC: "the disk is full",
    errno.EDQUOT: "the disk quota is used up",
    errno.EMFILE: "this process may open no more files; raise the limit: ulimit -n 4096",
    errno.ENFILE: "this machine may open no more files",
    errno.ENOMEM: "there is no more memory",
    errno.EAGAIN: "this user may start no more processes or threads (ulimit -u)",
}
_MEMORY = "there is not enough memory, or too little of it is allowed (ulimit -v)"


def shortage(error: BaseException) -> str | None:
    """Name the resource that ran out when `error` was raised, in words; None if the error is of another kind."""
    if isinstance(error, MemoryError):
        return _MEMORY
    if isinstance(error, RuntimeError) and "can't start new thread" in str(error):
        return f"no more threads can be started: {_MEMORY}"
    if isinstance(error, ImportError) and "failed to map segment" in str(error):
        return f"a library cannot be loaded: {_MEMORY}"
    if isinstance(error, OSError) and error.errno in _SHORT:
        return f"{error.filename}: {_SHORT[error.errno]}" if error.filename else _SHORT[error.errno]
    return None


def keep_freed_memory() -> None:
    """Let this process use freed memory again instead of giving it back: the system clears each page that it gives.

    That takes more time than most of what is done with an image. Only glibc can be told so.
    """
    tell = getattr(ctypes.CDLL(None), "mallopt", None)
    if tell is not None:
        tell(_TRIM_THRESHOLD, KEPT)
        tell(_MMAP_THRESHOLD, _LARGEST_KEPT)


def exit_if_short() -> None:
    """End this process with exit code 1 if its limits are so low that libraries would crash it; say which."""
    for limit, needed, name, unit in (
        (resource.RLIMIT_AS, ADDRESS_SPACE, "address space (ulimit -v)", "bytes"),
        (resource.RLIMIT_NOFILE, DESCRIPTORS, "open files (ulimit -n)", "files"),
    ):
        allowed = resource.getrlimit(limit)[0]
        if allowed != resource.RLIM_INFINITY and allowed < needed:
            sys.stderr.write(f"the limit on {name} is {allowed} {unit}; dsr needs at least {needed}\n")
            raise SystemExit(1)
