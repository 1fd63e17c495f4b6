"""Gives memory that holds nothing but zeros back to the kernel, which gives zeros again to whoever reads there.

Mesa's software OpenGL writes zeros into all of each buffer that it makes. pybullet has it make one of 128 MiB for the
shapes of a scene, which fill less than 1 MiB of it. Only Linux can do without the rest; elsewhere nothing happens.
"""

from __future__ import annotations

import contextlib
import ctypes
import mmap
import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

_LARGE = 32 << 20
"""Bytes from which a mapping is looked at: one of the libraries' large buffers, whatever else there is is smaller."""
_BLOCK = 1 << 20
"""Bytes that are given back together: small beside a buffer, and large beside a page, so that few calls do."""
_SMAPS = Path("/proc/self/smaps")
_HEADER = re.compile(r"([0-9a-f]+)-([0-9a-f]+) rw-p \S+ \S+ 0 *$")


class _Mapping(NamedTuple):
    """A private, anonymous, writable piece of this process's memory."""

    begin: int
    end: int
    resident: int
    """Bytes of it that are in memory."""


@contextlib.contextmanager
def zeros_given_back() -> Iterator[None]:
    """Give back the zeros in large pieces of memory that come into being within.

    Nobody may write there at the end, as in buffers of a library that only this thread calls.
    """
    before = _mappings()
    yield
    for mapping in _large_mappings():
        _give_back_zeros(mapping, before)


def _large_mappings() -> list[_Mapping]:
    """Those of which the larger part is in memory."""
    found = (mapping for mapping in _mappings() if mapping.end - mapping.begin >= _LARGE)
    return [mapping for mapping in found if mapping.resident > (mapping.end - mapping.begin) / 2]


def _mappings() -> list[_Mapping]:
    if not _SMAPS.exists():
        return []
    found: list[_Mapping] = []
    header = None
    for line in _SMAPS.read_text(encoding="utf-8", errors="replace").splitlines():
        if new := _HEADER.match(line):
            header = new
        elif header is not None and line.startswith("Rss:"):
            found.append(_Mapping(int(header[1], 16), int(header[2], 16), int(line.split()[1]) * 1024))
            header = None
    return found


def _give_back_zeros(mapping: _Mapping, before: Sequence[_Mapping]) -> None:
    """All but what lies in those that were there before, which the kernel may have joined with new ones."""
    libc = ctypes.CDLL(None, use_errno=True)
    # what is gone by now is an error there, and no crash
    with Path("/proc/self/mem").open("rb", buffering=0) as memory:
        for address in range(mapping.begin, mapping.end - _BLOCK + 1, _BLOCK):
            if any(address < other.end and other.begin < address + _BLOCK for other in before):
                continue
            with contextlib.suppress(OSError):
                block = os.pread(memory.fileno(), _BLOCK, address)
                if not np.frombuffer(block, np.uint8).any():
                    libc.madvise(ctypes.c_void_p(address), ctypes.c_size_t(_BLOCK), mmap.MADV_DONTNEED)
