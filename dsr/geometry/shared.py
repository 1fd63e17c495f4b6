"""Bytes that processes of one machine read in place: anonymous files (memfd), sealed so that nobody can change them.

Such a file has no name that could be left behind, and goes with the last process that has it open. A reader opens it
through `/proc` by its holder's process and descriptor, and checks that it is one of these before it reads: where it is
comes from the network. What it holds is checked by whoever asked, by hash.
"""

from __future__ import annotations

import fcntl
import mmap
import os
import weakref
from pathlib import Path

import msgspec

_NAME = "dsr-blob"
_LINK = f"/memfd:{_NAME} (deleted)"
_SEALS = fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_WRITE | fcntl.F_SEAL_SEAL if hasattr(
    fcntl, "F_SEAL_WRITE"
) else 0  # fmt: skip


class SharedPlace(msgspec.Struct, frozen=True, array_like=True):
    """The place of bytes in shared memory, for readers on the same machine."""

    process: int
    descriptor: int
    """File descriptor of the shared memory in the holder's process."""
    length: int


class SharedBytes:
    """A mesh in shared memory, at the process that offers it. Raises `OSError` where memory cannot be shared."""

    def __init__(self, data: bytes | memoryview) -> None:
        if not hasattr(os, "memfd_create") or not _SEALS:
            raise OSError("this system has no memfd_create")
        descriptor = os.memfd_create(_NAME, os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
        weakref.finalize(self, os.close, descriptor).atexit = False
        view = memoryview(data)
        while view:
            view = view[os.write(descriptor, view) :]
        fcntl.fcntl(descriptor, fcntl.F_ADD_SEALS, _SEALS)
        self.place = SharedPlace(os.getpid(), descriptor, len(data))
        """For readers."""


def read_in_place(place: SharedPlace) -> memoryview:
    """The bytes there, which stay while anything refers to them.

    Raises:
        OSError: if they are not to be had here: the holder runs elsewhere, as somebody else, or has ended.
    """
    path = f"/proc/{place.process:d}/fd/{place.descriptor:d}"
    if str(Path(path).readlink()) != _LINK:
        raise OSError(f"{path} holds no shared bytes")
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
    try:
        if fcntl.fcntl(descriptor, fcntl.F_GET_SEALS) & _SEALS != _SEALS:
            raise OSError(f"{path} could change while it is read")
        if place.length <= 0 or os.fstat(descriptor).st_size != place.length:
            raise OSError(f"{path} has not {place.length} bytes")
        return memoryview(mmap.mmap(descriptor, place.length, prot=mmap.PROT_READ))
    finally:
        os.close(descriptor)
