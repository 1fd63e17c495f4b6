"""Bounds what `rosbags` unpacks: a few kB of a bag could else become more than the machine has.

`rosbags` has no option for this: its tables of decompressors are replaced, once, by bounded ones of the same results.
"""

from __future__ import annotations

import bz2
import shutil
import tempfile
from typing import Any, BinaryIO

import lz4.frame
import zstandard
from rosbags.rosbag1 import reader as ros1
from rosbags.rosbag2 import reader as ros2
from rosbags.rosbag2 import storage_mcap

from agents.recorder.mcap_file import LARGEST_CHUNK, RecordingError

_STEP = 1 << 20
"""Bytes that are unpacked at a time"""
_DISK_SHARE = 0.5
"""Of the free space of the temporary folder, that a file of a bag may take when it is unpacked"""


def from_zstd(data: bytes, most: int | None = None) -> bytes:
    """Unpack Zstandard. Raises `RecordingError` if there are more than `most` bytes in it, or fewer than it says."""
    most = LARGEST_CHUNK if most is None else most
    with zstandard.ZstdDecompressor().stream_reader(data, read_across_frames=True) as stream:
        parts, size = [], 0
        while part := stream.read(_STEP):
            parts.append(part)
            size += len(part)
            if size > most:
                raise _too_large(most)
    told = zstandard.frame_content_size(data) if data else 0
    if told > size:
        raise RecordingError(f"cut off: {size} of {told} bytes")
    return b"".join(parts)


def from_lz4(data: bytes, most: int | None = None) -> bytes:
    """Unpack an LZ4 frame. Raises `RecordingError` if there are more than `most` bytes in it."""
    return _bounded(lz4.frame.LZ4FrameDecompressor(), data, most)


def from_bz2(data: bytes, most: int | None = None) -> bytes:
    """Unpack bzip2. Raises `RecordingError` if there are more than `most` bytes in it."""
    return _bounded(bz2.BZ2Decompressor(), data, most)


def _bounded(decompressor: Any, data: bytes, most: int | None) -> bytes:
    most = LARGEST_CHUNK if most is None else most
    found: bytes = decompressor.decompress(data, max_length=most + 1)
    if len(found) > most:
        raise _too_large(most)
    if not decompressor.eof:
        raise RecordingError("cut off")
    return found


def _too_large(most: int) -> RecordingError:
    return RecordingError(f"a compressed piece of more than {most} bytes is not unpacked")


def _of_size(unpack: Any) -> Any:
    """What a chunk of MCAP says of its size is a bound, too."""

    def bounded(data: bytes, size: int) -> bytes:
        if size > LARGEST_CHUNK:
            raise _too_large(LARGEST_CHUNK)
        found: bytes = unpack(data, size)
        return found

    return bounded


class _BoundedFile:
    """A compressed file of which no more is read than the disk has room for."""

    def __init__(self, file: BinaryIO) -> None:
        self._stream = zstandard.ZstdDecompressor().stream_reader(file, read_across_frames=True)
        self._left = int(shutil.disk_usage(tempfile.gettempdir()).free * _DISK_SHARE)

    def __enter__(self) -> _BoundedFile:
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.close()  # type: ignore[no-untyped-call]

    def read(self, size: int = -1) -> bytes:
        found = self._stream.read(size if size > 0 else _STEP)
        self._left -= len(found)
        if self._left < 0:
            raise RecordingError("a compressed file needs more than half of the free space of the temporary folder")
        return found


class _Zstd:
    """Stands where `rosbags.rosbag2.reader` has its module `zstd`."""

    decompress = staticmethod(from_zstd)

    @staticmethod
    def open(file: BinaryIO, mode: str) -> _BoundedFile:
        return _BoundedFile(file)


def bound_rosbags() -> None:
    """Let `rosbags` unpack no more than this module allows; harmless when repeated."""
    storage_mcap.DECOMPRESSORS.update(zstd=_of_size(from_zstd), lz4=_of_size(from_lz4))
    ros1.decompressors.update(bz2=from_bz2, lz4=from_lz4)
    vars(ros2)["zstd"] = _Zstd
