"""Files of records with checksums: whatever the moment of a crash, all records before it can be read.

A file begins with `HEADER`; each record is its length and its CRC-32 (two little-endian 32-bit numbers) and its bytes.
"""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import IO, NamedTuple

from dsr.files.data_files import read_file

HEADER = b"dsr-state 1\n"
_PREFIX = struct.Struct("<II")
MOST_BYTES = 1 << 32
"""Bytes that a file may have to be read: a million nodes take a tenth."""


class Records(NamedTuple):
    """The readable records of a file."""

    payloads: list[bytes]
    problem: str
    """Why the rest could not be read; empty if all was."""


def append_record(file: IO[bytes], payload: bytes) -> int:
    """Append one record; the bytes it takes. The caller makes sure that it reaches the disk."""
    file.write(_PREFIX.pack(len(payload), zlib.crc32(payload)) + payload)
    return _PREFIX.size + len(payload)


def read_records(file: Path) -> Records:
    """All records up to the first that is damaged. Raises `ConfigError` if it is no regular file, or cannot be read."""
    data = read_file(file, MOST_BYTES)
    if not data.startswith(HEADER):
        torn = HEADER.startswith(data)
        return Records([], "" if torn else "it is no state file of this version")
    payloads: list[bytes] = []
    position = len(HEADER)
    while position < len(data):
        start = position + _PREFIX.size
        length, checksum = _PREFIX.unpack(data[position:start]) if start <= len(data) else (0, -1)
        payload = data[start : start + length]
        if len(payload) < length or zlib.crc32(payload) != checksum:
            return Records(payloads, f"its last {len(data) - position} of {len(data)} bytes are damaged")
        payloads.append(payload)
        position = start + length
    return Records(payloads, "")
