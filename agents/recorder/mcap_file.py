"""MCAP files of messages: writing them so that a kill loses little, reading them as far as they go.

The format is described at https://mcap.dev/spec. Everything else here is independent of it.
"""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, cast

import lz4.frame
import zstandard
from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, Header, Message, Metadata, Schema
from mcap.stream_reader import CRCValidationError, StreamReader, breakup_chunk
from mcap.writer import CompressionType, Writer

from agents.recorder.channels import ChannelKind, kind_of
from dsr.errors import ConfigError

PROFILE = "dsr"
_MAGIC = b"\x89MCAP0\r\n"
_METADATA = "dsr"
_CHUNK_SIZE = 1 << 20
_LARGEST_RECORD = 1 << 30  # a greater length is damage, not data
LARGEST_CHUNK = 1 << 29
"""Bytes of a chunk when it is unpacked: a snapshot of the largest graph fits."""
_MOST_RECORDS = 1 << 20
"""Records of a chunk: those of its smallest messages take ten times as much in memory."""
_LENGTH = struct.Struct("<BQ")
_DAMAGE = (McapError, CRCValidationError, zstandard.ZstdError, struct.error, UnicodeDecodeError, MemoryError)


class RecordingError(ConfigError):
    """A file that is no recording of ours."""


class RecordedMessage(NamedTuple):
    """One recorded message."""

    stamp: float
    """Time (s) when the message arrived"""
    topic: str
    """The key without the graph's root, such as `d/arm_controller-5f0c12aa`."""
    payload: bytes


class RecordedSchema(NamedTuple):
    """What a file says of the messages of a topic."""

    name: str
    encoding: str
    """Of the description: `text`, or `ros2msg` in bags of ROS 2"""
    data: bytes


class RecordingWriter:
    """Appends messages to a new MCAP file.

    Args:
        path: the file; it must not exist.
        metadata: stored at the beginning.
    """

    def __init__(self, path: Path, metadata: Mapping[str, str]) -> None:
        self.path = path
        self._file = path.open("xb")
        self._writer = cast(Any, Writer(self._file, chunk_size=_CHUNK_SIZE, compression=CompressionType.ZSTD))
        self._schemas: dict[ChannelKind, int] = {}
        self._channels: dict[str, int] = {}
        self._flushed = False
        self.unflushed = 0
        """Messages that a kill, or a disk without room, would still cost."""
        try:
            self._writer.start(profile=PROFILE, library="dsr")
            self._writer.add_metadata(_METADATA, dict(metadata))
            self._writer.flush()
        except OSError:
            self.abandon()
            raise

    def write(self, record: RecordedMessage) -> None:
        """Add a message; it is safe after the next `flush`."""
        time = round(record.stamp * 1e9)
        self.unflushed += 1
        self._writer.add_message(self._channel(record.topic), time, record.payload, time)

    @property
    def size(self) -> int:
        """Bytes of the file until now, without what was not flushed."""
        return self._file.tell()

    def flush(self) -> None:
        """Hand everything so far to the operating system: a kill of this process does not lose it."""
        self._writer.flush()
        self._flushed = True
        self.unflushed = 0

    def abandon(self) -> None:
        """Close the file as far as it was written; one that was never flushed holds nothing and is removed."""
        with contextlib.suppress(OSError):
            self._file.close()
        if not self._flushed:
            self.path.unlink(missing_ok=True)

    def close(self) -> None:
        """Write the index and close the file."""
        try:
            self._writer.finish()
        finally:
            self._file.close()

    def _channel(self, topic: str) -> int:
        if topic not in self._channels:
            kind = kind_of(topic)
            if kind not in self._schemas:
                self._schemas[kind] = self._writer.register_schema(kind.schema, "text", kind.text.encode())
            self._channels[topic] = self._writer.register_channel(topic, kind.encoding, self._schemas[kind])
        return self._channels[topic]


class FilePiece(NamedTuple):
    """Messages that were written together."""

    position: int
    """Bytes before it in the file."""
    records: list[RecordedMessage]
    packed: int
    """Bytes of the file that hold them, compressed"""


class RecordingFile:
    """Reads one MCAP file from its beginning; iterate over it once, then look at the findings.

    Args:
        path: of the file.
        profile: of its messages; by default that of our recordings.

    Raises:
        RecordingError: if the file cannot be read or has another profile.
    """

    def __init__(self, path: Path, profile: str = PROFILE) -> None:
        self.path = path
        self._profile = profile
        self.complete = False
        """Whether reading came to the proper end of the file."""
        self.problems: list[str] = []
        """What was cut off or damaged."""
        self.metadata: dict[str, str] = {}
        self.read_bytes = 0
        """How far reading came."""
        self.schemas: dict[str, RecordedSchema] = {}
        """Of the messages read until now, by topic"""
        self._topics: dict[int, str] = {}
        self._kinds: dict[int, RecordedSchema] = {}
        try:
            self.size = path.stat().st_size
            with path.open("rb") as file:
                start = file.read(len(_MAGIC))
        except OSError as error:
            raise RecordingError(f"{path}: cannot be read: {error.strerror}") from error
        if start != _MAGIC[: len(start)]:
            raise RecordingError(f"{path}: no MCAP file, it begins with {start!r}, expected {_MAGIC!r}")

    def __iter__(self) -> Iterator[RecordedMessage]:
        """The messages in the order they were written; damaged parts are left out."""
        for piece in self.pieces():
            yield from piece.records

    def pieces(self, position: int = 0) -> Iterator[FilePiece]:
        """The messages in pieces, one in memory at a time.

        Args:
            position: where to begin, that of a piece; all before it must have been read once, for the topics' names.
        """
        with self.path.open("rb") as file:
            file.seek(position)
            source = _WholeReads(file, position)
            try:
                yield from self._read_pieces(source)
                self.complete = True
            except _CutError:
                self.problems.append(f"never closed or cut off, after {self.size} bytes")
            except _DAMAGE as error:
                self.problems.append(f"not readable from byte {source.position} on ({_text(error)})")
            self.read_bytes = source.position

    def _read_pieces(self, source: _WholeReads) -> Iterator[FilePiece]:
        reader = StreamReader(
            source,  # type: ignore[arg-type]
            skip_magic=source.position > 0,
            emit_chunks=True,
            record_size_limit=_LARGEST_RECORD,
        )
        begun = source.position
        for record in reader.records:
            if isinstance(record, Chunk):
                yield FilePiece(begun, list(self._unpack(record, source.position)), len(record.data))
            elif isinstance(record, Header) and record.profile != self._profile:
                bag = "; `dsr replay` and `dsr record export` take bags of ROS 2" if record.profile == "ros2" else ""
                expected = f"expected {self._profile!r}{bag}"
                raise RecordingError(f"{self.path}: an MCAP file of profile {record.profile!r}, {expected}")
            elif isinstance(record, Metadata) and record.name == _METADATA:
                self.metadata = record.metadata
            elif (message := self._noted(record)) is not None:
                yield FilePiece(begun, [message], len(message.payload))
            begun = source.position

    def _unpack(self, chunk: Chunk, end: int) -> Iterator[RecordedMessage]:
        """The messages of a chunk; topics by channel are known from it and the ones before."""
        try:
            records = breakup_chunk(_unpacked(chunk), validate_crc=True)
        except _DAMAGE as error:
            self.problems.append(f"the part before byte {end} is damaged ({_text(error)})")
            return
        yield from filter(None, map(self._noted, records))

    def _noted(self, record: object) -> RecordedMessage | None:
        """The message that a record is, if its channel is known; schemas and channels are remembered."""
        if isinstance(record, Message) and record.channel_id in self._topics:
            return RecordedMessage(record.log_time / 1e9, self._topics[record.channel_id], record.data)
        if isinstance(record, Schema):
            self._kinds[record.id] = RecordedSchema(record.name, record.encoding, record.data)
        elif isinstance(record, Channel):
            self._topics[record.id] = record.topic
            if record.schema_id in self._kinds:
                self.schemas[record.topic] = self._kinds[record.schema_id]
        return None


def _unpacked(chunk: Chunk) -> Chunk:
    """The chunk without compression. Raises `McapError` or `ZstdError` for one that is far larger than it may be."""
    data = chunk.data
    if chunk.compression == "zstd":
        told = zstandard.frame_content_size(data)
        if max(told, chunk.uncompressed_size) > LARGEST_CHUNK:
            raise McapError(f"a chunk of {max(told, chunk.uncompressed_size)} bytes; at most {LARGEST_CHUNK}")
        data = zstandard.decompress(data, chunk.uncompressed_size)
    elif chunk.compression == "lz4":
        data = _from_lz4(data, chunk.uncompressed_size)
    elif chunk.compression:
        raise McapError(f"a chunk compressed by {chunk.compression!r}; expected 'zstd' or 'lz4'")
    position = count = 0
    while position < len(data):
        position += _LENGTH.size + _LENGTH.unpack_from(data, position)[1]
        count += 1
        if count > _MOST_RECORDS:
            raise McapError(f"a chunk of more than {_MOST_RECORDS} records")
    return replace(chunk, compression="", data=data)


def _from_lz4(data: bytes, size: int) -> bytes:
    """Unpack `size` bytes. Raises `McapError` if they are more than a chunk may have, or not as many."""
    if size > LARGEST_CHUNK:
        raise McapError(f"a chunk of {size} bytes; at most {LARGEST_CHUNK}")
    try:
        unpacked: bytes = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
    except (RuntimeError, ValueError, EOFError) as error:
        raise McapError(f"a chunk that is no LZ4: {error}") from error
    if len(unpacked) != size:
        raise McapError(f"a chunk of {len(unpacked)} bytes; it says {size}")
    return unpacked


class _CutError(Exception):
    """The file ends within a record."""


class _WholeReads:
    """A file whose `read` gives all the bytes asked for or raises `_CutError`."""

    def __init__(self, file: BinaryIO, position: int) -> None:
        self._file = file
        self.position = position
        """Bytes of the file before the next read."""

    def read(self, count: int) -> bytes:
        """The next `count` bytes. Raises `struct.error` for a number that no record has."""
        if count > _LARGEST_RECORD:
            raise struct.error(f"a length of {count} bytes")
        data = self._file.read(count)
        if len(data) < count:
            raise _CutError
        self.position += count
        return data


def _text(error: BaseException) -> str:
    return str(error) or type(error).__name__
