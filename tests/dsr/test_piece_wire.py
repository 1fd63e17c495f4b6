"""Requests and pieces on the wire: golden bytes, and nothing malformed gets through."""

from __future__ import annotations

import msgpack
import pytest

from dsr.crdt.context import CausalContext
from dsr.crdt.delta import Add, Write
from dsr.crdt.pieces import START, Piece
from dsr.errors import WireError
from dsr.replication.piece_wire import Request, asker_of, decode_piece, decode_request, encode_piece, encode_request

PIECE = Piece(
    ("a", 3, ""),
    ("b", 1, "mass"),
    [Add(("a", 3), "cube_3", "cube")],
    [Write(("a", 3), "mass", 99, "a", ("a", 4), 0.25)],
    [("a", 9)],
    [("a", 3, 12)],
    [("a", 1, 12), ("b", 1, 2)],
    joined=False,
    waits_for=["c"],
)
GOLDEN_PIECE = bytes.fromhex(
    "9b01" "92a161a162"  # version, replicas
    "91960003a6637562655f33a4637562659090"  # adds
    "91980003a46d617373630000" "04cb3fd0000000000000"  # writes
    "920009" "9300030c" "9600010c010102"  # kept, examined, whole
    "93a16103a0" "93a16201a46d617373"  # begin, end
    "c2" "91a163"  # joined, waits for
)  # fmt: skip
REQUEST = Request("b", CausalContext([("a", 1, 2)]), ("a", 3, ""), insists=True)
GOLDEN_REQUEST = bytes.fromhex("9501" "a162" "9193a1610102" "93a16103a0" "c3")


def test_golden_bytes() -> None:
    assert encode_piece(PIECE).hex() == GOLDEN_PIECE.hex()
    assert encode_request(REQUEST).hex() == GOLDEN_REQUEST.hex()


def test_round_trip() -> None:
    assert decode_piece(GOLDEN_PIECE) == PIECE
    assert decode_request(GOLDEN_REQUEST) == REQUEST and asker_of(GOLDEN_REQUEST) == "b"


@pytest.mark.parametrize(
    "changes",
    [
        {0: 2}, {2: [[2, 3, "n", "cube", [], []]]}, {4: [0]}, {5: [0, 5, 4]}, {6: [0, 1]}, {7: ["a"]},
        {7: ["c", 1, ""]}, {8: ["a", 3, ""]}, {8: ["a", 2, ""]}, {8: ["a", -1, ""]}, {9: 1}, {10: [""]},
    ],
)  # fmt: skip
def test_malformed_pieces_are_refused(changes: dict[int, object]) -> None:
    fields = msgpack.unpackb(GOLDEN_PIECE)
    for place, value in changes.items():
        fields[place] = value
    with pytest.raises(WireError):
        decode_piece(msgpack.packb(fields))


@pytest.mark.parametrize("payload", [b"", b"\xc1", msgpack.packb([2, "b", [], list(START), True]), GOLDEN_PIECE])
def test_malformed_requests_are_refused(payload: bytes) -> None:
    with pytest.raises(WireError):
        decode_request(payload)


def test_who_asks_is_nobody_in_nonsense() -> None:
    assert asker_of(b"nonsense") == asker_of(b"") == ""
