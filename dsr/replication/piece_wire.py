"""The versioned encoding of requests for missing changes, and of the pieces that answer them; see `wire.py`.

Request: [version, replica id, context, place, insists]
Piece:   [version, replica ids, adds, writes, kept, examined, whole or nil, begin, end or nil, joined, waits for]
  adds, writes   as in a delta
  kept           [replica, counter, ...] flat; examined and whole [replica, first, last, ...] flat
  place          [replica id, counter, attribute]: begin and end likewise; waits for: [replica id, ...]
"""

from __future__ import annotations

from typing import Annotated

import msgspec

from dsr.crdt.context import CausalContext
from dsr.crdt.pieces import Piece, Place
from dsr.errors import WireError
from dsr.network.decoding import decoded
from dsr.replication.wire import (
    MAX_NAME,
    MAX_STRUCTURE,
    MOST_CHANGES,
    MOST_NUMBERS,
    AddRow,
    CounterOrZero,
    Indexes,
    Name,
    Names,
    Natural,
    WriteRow,
    add_rows,
    check_length,
    check_structure,
    encoder,
    to_adds,
    to_context,
    to_dots,
    to_ranges,
    to_writes,
    write_rows,
)

VERSION = 1
_Text = Annotated[str, msgspec.Meta(max_length=MAX_NAME)]
_Place = tuple[_Text, CounterOrZero, _Text]


class Request(msgspec.Struct, frozen=True):
    """A request for one piece of another replica's content."""

    replica: str
    """Id of the replica that asks."""
    seen: CausalContext
    begin: Place
    """Place where the wanted piece begins."""
    insists: bool = False
    """Whether an answer is wanted also of one who has not joined itself."""


class _Request(msgspec.Struct, array_like=True, gc=False):
    version: int
    replica: Name
    seen: list[tuple[Name, int, int]]
    begin: _Place
    insists: bool


class _Piece(msgspec.Struct, array_like=True, gc=False):
    version: int
    replicas: Annotated[list[Name], MOST_CHANGES]
    adds: Annotated[list[AddRow], MOST_CHANGES]
    writes: Annotated[list[WriteRow], MOST_CHANGES]
    kept: Annotated[list[Natural], MOST_NUMBERS]
    examined: Annotated[list[Natural], MOST_NUMBERS]
    whole: Annotated[list[Natural], MOST_NUMBERS] | None
    begin: _Place
    end: _Place | None
    joined: bool
    waits_for: Names


class _Head(msgspec.Struct, array_like=True, gc=False):
    """The beginning of a request."""

    version: int
    replica: Name


_heads = msgspec.msgpack.Decoder(_Head)
_requests = msgspec.msgpack.Decoder(_Request)
_pieces = msgspec.msgpack.Decoder(_Piece)


def encode_request(request: Request) -> bytes:
    """A request as bytes."""
    seen = list(request.seen.ranges())
    return encoder.encode(_Request(VERSION, request.replica, seen, request.begin, request.insists))


def decode_request(payload: bytes) -> Request:
    """The request in `payload`. Raises `WireError` unless all of it is valid."""
    return decoded(payload, f"request of {len(payload)} bytes", _read_request)


def asker_of(payload: bytes) -> str:
    """Read the id of the replica that sent a request; empty for a malformed request."""
    try:
        return decoded(payload, "request", _heads.decode).replica
    except WireError:
        return ""


def _read_request(payload: bytes) -> Request:
    if len(payload) > MAX_STRUCTURE:
        raise ValueError(f"more than {MAX_STRUCTURE} bytes")
    message = _requests.decode(payload)
    _check_version(message.version)
    return Request(message.replica, to_context(message.seen), message.begin, message.insists)


def encode_piece(piece: Piece) -> bytes:
    """A piece as bytes."""
    index = Indexes()
    adds = add_rows(index, piece.adds)
    writes = write_rows(index, piece.writes)
    kept, examined = index.flat(piece.kept), index.flat_ranges(piece.examined)
    whole = None if piece.whole is None else index.flat_ranges(piece.whole)
    return encoder.encode(
        (
            VERSION, list(index), adds, writes, kept, examined, whole, piece.begin, piece.end, piece.joined,
            piece.waits_for,
        )
    )  # fmt: skip


def decode_piece(payload: bytes) -> Piece:
    """The piece in `payload`. Raises `WireError` unless all of it is valid."""
    return decoded(payload, f"reply of {len(payload)} bytes", _read_piece)


def _read_piece(payload: bytes) -> Piece:
    check_length(payload)
    message = _pieces.decode(payload)
    _check_version(message.version)
    check_structure(payload, message.writes)
    if message.end is not None and message.end <= message.begin:
        raise ValueError("a piece that ends before it begins")
    names = message.replicas
    return Piece(
        message.begin,
        message.end,
        to_adds(names, message.adds),
        to_writes(names, message.writes),
        to_dots(names, message.kept),
        to_ranges(names, message.examined),
        None if message.whole is None else to_ranges(names, message.whole),
        message.joined,
        message.waits_for,
    )


def _check_version(version: int) -> None:
    if version != VERSION:
        raise ValueError(f"version {version}, this is version {VERSION}")
