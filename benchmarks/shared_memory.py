"""Removes shared memory that Zenoh leaves behind: its library tidies up only when a next session opens.

Every process that has a segment mapped holds a lock on its file. A file that no living process but this one has
locked belongs to nobody else, so this process may remove it when it ends. Of processes that end together each would
leave that to the others: so they do it one at a time, and each waits until the one before it is really gone.
"""

from __future__ import annotations

import fcntl
import os
import threading
from pathlib import Path

from dsr.clock import WALL_CLOCK

_FOLDER = Path("/dev/shm")
_LOCKS = Path("/proc/locks")
_PATIENCE = 1.0  # s to wait for others that end
_PERIOD = 0.01  # s


def remove_leftovers() -> None:
    """Remove segments that no other process uses; call it last. Does nothing where Linux's folders are missing."""
    if not (_FOLDER.is_dir() and _LOCKS.exists()):
        return
    _queue_to_end()
    used = _locked_by_others()
    for file in _FOLDER.glob("*.zenoh"):
        try:
            if _identity(file) not in used:
                file.unlink()
        except OSError:
            continue  # somebody else was faster, or it is another user's


def _queue_to_end() -> None:
    """Take a lock that is given back by the death of this process, if it is free in time."""
    descriptor = os.open(_FOLDER, os.O_RDONLY)
    deadline = WALL_CLOCK.monotonic() + _PATIENCE
    while WALL_CLOCK.monotonic() < deadline:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            WALL_CLOCK.wait(threading.Event(), _PERIOD)
        else:
            return


def _identity(file: Path) -> str:
    """How the kernel's list of locks calls a file: device and inode."""
    status = file.stat()
    return f"{os.major(status.st_dev):02x}:{os.minor(status.st_dev):02x}:{status.st_ino}"


def _locked_by_others() -> set[str]:
    """Files on which processes other than this one hold a lock; lines are `1: FLOCK ADVISORY READ pid file 0 EOF`."""
    fields = (line.split() for line in _LOCKS.read_text().splitlines())
    return {words[5] for words in fields if len(words) > 5 and words[1] == "FLOCK" and words[4] != str(os.getpid())}
