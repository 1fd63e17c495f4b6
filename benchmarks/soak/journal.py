"""What a worker has written, in a file that outlives it: one record for each call that returned."""

from __future__ import annotations

import enum
import os
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

_LAYOUT = struct.Struct("<BxxxIdd")


class Kind(enum.IntEnum):
    """What kind of call it was."""

    COUNT = 0
    """The worker's own counter."""
    POSE = 1
    """The worker's own pose, a stream."""
    ADD = 2
    """A node of the worker's own was created."""
    REMOVE = 3
    """A node of the worker's own was removed."""
    SHARED = 4
    """A register that all workers write."""
    CONTENDED = 5
    """Something that others create, write and remove at the same time."""


class Record(NamedTuple):
    """A call that returned; times in s on the clock that all processes of a machine share."""

    kind: Kind
    number: int
    """Which of the worker's steps it belongs to; for `REMOVE`, the step that made the node."""
    started: float
    ended: float


class JournalWriter:
    """Appends records; what was appended survives `kill -9`."""

    def __init__(self, path: Path) -> None:
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)

    def append(self, record: Record) -> None:
        """Note a call that has just returned."""
        os.write(self._file, _LAYOUT.pack(*record))

    def close(self) -> None:
        """Close the file."""
        os.close(self._file)


def take_records(path: Path) -> Iterator[Record]:
    """All records, which are removed from the file; its writer must be dead or idle."""
    if not path.exists():
        return
    with path.open("r+b") as file:
        content = file.read()
        file.truncate(0)
    whole = len(content) - len(content) % _LAYOUT.size
    for kind, number, started, ended in _LAYOUT.iter_unpack(content[:whole]):
        yield Record(Kind(kind), number, started, ended)
