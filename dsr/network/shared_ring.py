"""Large messages in memory that processes of one machine share: a writer's ring of slots, which readers hold in place.

A ring is an anonymous file (memfd): it has no name that could be left behind, and goes with the last process that has
it open, however that one dies. A reader opens it through `/proc` by its writer's process and descriptor.

Each slot has a lock, a byte range lock of the open file. A reader keeps a shared one while anything still refers to
what it was given, and a writer writes only where it gets the exclusive one. So no reader ever sees a message change,
however slow, stopped or dead it or the writer is: locks end with the process that holds them.
"""

from __future__ import annotations

import contextlib
import fcntl
import itertools
import mmap
import os
import secrets
import struct
import weakref
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np

from dsr.errors import WireError

SLOTS = 32
MOST_BYTES = 1 << 28
"""Bytes that one message may have, with the padding of its slot: an image of 16 million pixels with colour, depth and
more.
"""
_KEPT = 3
"""Newest messages that are never overwritten, so that a reader has the time to take hold of one."""
_MOST_HELD = 4
"""Messages that one reader may hold in place; it gets copies of further ones, so that it cannot use up the ring."""

_IDENTITY = 16
"""Bytes of a ring's identity: readers tell rings apart by it, and keep it of those that they cannot use."""
_NAME = "dsr-ring"
_LINK = f"/memfd:{_NAME} (deleted)"
_PAGE = mmap.PAGESIZE
_LOCK = struct.Struct("hhqqi4x")  # struct flock of Linux: type, whence, start, length, pid
_SEAL_FUTURE_WRITE = 0x10  # F_SEAL_FUTURE_WRITE of Linux 5.1, which `fcntl` does not name


class SlotDescriptor(msgspec.Struct, frozen=True, array_like=True):
    """The place of a message in a ring, for readers on the same machine."""

    process: int
    file_descriptor: int
    """File descriptor of the ring in the writer's process."""
    ring: Annotated[bytes, msgspec.Meta(min_length=_IDENTITY, max_length=_IDENTITY)]
    """Random; tells the ring from whatever else may have that descriptor."""
    slot_size: int
    slot: int
    sequence: int
    """Number of the message in its ring; the slot may hold a later message meanwhile."""
    length: int


class Ring:
    """The writer's end, for messages of up to `capacity` bytes. Raises `OSError` where memory cannot be shared."""

    def __init__(self, capacity: int) -> None:
        if not hasattr(os, "memfd_create"):
            raise OSError("this system has no memfd_create")
        self.slot_size = -(-capacity // _PAGE) * _PAGE
        if self.slot_size > MOST_BYTES:
            raise OSError(f"messages of {self.slot_size} bytes; at most {MOST_BYTES} are shared")
        self._id = secrets.token_bytes(_IDENTITY)
        self._file = _File(os.memfd_create(_NAME, os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING))
        size = _PAGE + SLOTS * self.slot_size  # what is not written to yet takes no memory
        os.ftruncate(self._file.descriptor, size)
        self._map = memoryview(mmap.mmap(self._file.descriptor, size))
        seals = fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_SEAL
        with contextlib.suppress(OSError):  # an older Linux
            fcntl.fcntl(self._file.descriptor, fcntl.F_ADD_SEALS, _SEAL_FUTURE_WRITE)
        fcntl.fcntl(self._file.descriptor, fcntl.F_ADD_SEALS, seals)
        self._map[: len(self._id)] = self._id
        self._sequences = _sequences(self._map)
        self._count = itertools.count(1)
        self._used: list[int] = []  # slots, the one with the newest message last

    def write(self, chunks: Sequence[bytes | memoryview]) -> SlotDescriptor | None:
        """Write a message given in pieces (of bytes); None if readers hold all slots in place."""
        for slot in self._candidates():
            if self._file.lock(slot, fcntl.F_WRLCK):
                break
        else:
            return None
        try:
            return self._write_into(slot, chunks)
        finally:
            self._file.lock(slot, fcntl.F_UNLCK)

    def _write_into(self, slot: int, chunks: Sequence[bytes | memoryview]) -> SlotDescriptor:
        self._sequences[slot] = 0  # for the case that this process dies half way
        begin = end = _PAGE + slot * self.slot_size
        for chunk in chunks:
            self._map[end : end + len(chunk)] = chunk
            end += len(chunk)
        sequence = self._sequences[slot] = next(self._count)
        self._used = [*(other for other in self._used if other != slot), slot]
        return SlotDescriptor(os.getpid(), self._file.descriptor, self._id, self.slot_size, slot, sequence, end - begin)

    def _candidates(self) -> Iterator[int]:
        """Slots that may be free, the oldest message first; one that was never used only after those."""
        yield from self._used[:-_KEPT]
        if len(self._used) < SLOTS:
            yield len(self._used)


class RingReader:
    """A reader's end of the ring that a descriptor names.

    Raises:
        OSError: if the ring is not to be had here: its writer runs elsewhere, as somebody else, or has ended.
    """

    def __init__(self, descriptor: SlotDescriptor) -> None:
        self.ring = descriptor.ring
        self._slot_size = descriptor.slot_size
        self._held: set[int] = set()
        path = f"/proc/{descriptor.process:d}/fd/{descriptor.file_descriptor:d}"
        if not 0 < self._slot_size <= MOST_BYTES:
            raise OSError(f"{path} has slots of {self._slot_size} bytes; expected 1 to {MOST_BYTES}")
        if str(Path(path).readlink()) != _LINK:  # before it is opened: a descriptor comes from the network
            raise OSError(f"{path} is no ring")
        self._file = _File(os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK))
        if not fcntl.fcntl(self._file.descriptor, fcntl.F_GET_SEALS) & fcntl.F_SEAL_SHRINK:
            raise OSError(f"{path} could be cut short while it is read")
        size = _PAGE + SLOTS * self._slot_size
        if os.fstat(self._file.descriptor).st_size != size:
            raise OSError(f"{path} is not a ring of {size} bytes")
        self._map = mmap.mmap(self._file.descriptor, size, prot=mmap.PROT_READ)
        if self._map[: len(self.ring)] != self.ring:
            raise OSError(f"{path} is another ring")
        self._sequences = _sequences(memoryview(self._map))

    def view(self, descriptor: SlotDescriptor) -> memoryview | None:
        """The message in place, which stays until nothing refers to it any more; None if it was overwritten.

        While `_MOST_HELD` others of this ring are held, it is a copy. Raises `WireError` for an impossible place.
        """
        slot = descriptor.slot
        if not (0 <= slot < SLOTS and 0 <= descriptor.length <= self._slot_size):
            raise WireError(f"{descriptor}: the ring has {SLOTS} slots of {self._slot_size} bytes")
        if slot in self._held or not self._file.lock(slot, fcntl.F_RDLCK):
            return None
        self._held.add(slot)
        lease = np.frombuffer(self._map, np.uint8, descriptor.length, _PAGE + slot * self._slot_size)
        weakref.finalize(lease, self._release, slot, os.getpid()).atexit = False
        if self._sequences[slot] != descriptor.sequence:
            return None
        return lease.data if len(self._held) <= _MOST_HELD else memoryview(lease.tobytes())

    def _release(self, slot: int, process: int) -> None:
        if os.getpid() == process:  # a forked child shares the lock, which is not its own to give back
            self._file.lock(slot, fcntl.F_UNLCK)
            self._held.discard(slot)


class _File:
    """A descriptor that is closed when nothing refers to it any more."""

    def __init__(self, descriptor: int) -> None:
        self.descriptor = descriptor
        weakref.finalize(self, os.close, descriptor).atexit = False

    def lock(self, slot: int, kind: int) -> bool:
        """Take (`F_RDLCK`, `F_WRLCK`) or give back (`F_UNLCK`) the lock of a slot; false if somebody is in the way."""
        request = _LOCK.pack(kind, os.SEEK_SET, slot, 1, 0)
        try:
            fcntl.fcntl(self.descriptor, fcntl.F_OFD_SETLK, request)
        except BlockingIOError:
            return False
        return True


def _sequences(view: memoryview) -> memoryview:
    """The numbers of the messages in the slots, which stand behind the ring's identity."""
    return view[_IDENTITY : _IDENTITY + 8 * SLOTS].cast("Q")
