"""Values that no such attribute has: all replicas read them as taken away, and nobody need expect them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dsr import Pose, SchemaError
from dsr.crdt.delta import TOMBSTONE, Add, Delta, Write
from dsr.crdt.pieces import START, Piece
from dsr.graph.schema import BUILT_IN, MAX_NUMBER, AttributeType
from dsr.network.keys import Keys
from dsr.replication.piece_wire import decode_piece, encode_piece
from dsr.replication.values import fitted
from dsr.replication.wire import decode_delta, decode_kept, encode_delta
from tests.dsr.conftest import Net

FAR = 10.0 * MAX_NUMBER
MISFITS: list[tuple[str, Any]] = [
    ("mass", "heavy"), ("mass", True), ("mass", b"1"), ("mass", (1.0,)), ("mass", FAR), ("mass", -FAR),
    ("mass", 1 << 62),
    ("note", 7), ("note", b"text"), ("seen", 1.0), ("seen", True), ("present", 1), ("size", (1.0,)), ("size", ()),
    ("size", (1.0, FAR, 1.0)), ("joint_positions", "1,2"), ("pose", 7), ("pose", Pose((0, FAR, 0))),
    ("pose", Pose((0, 0, 0), stamp=FAR)), ("pose", Pose((0, 0, 0)).with_covariance(FAR * np.eye(6))),
]  # fmt: skip
FITTING: list[tuple[str, Any]] = [
    ("mass", 0.5), ("mass", -MAX_NUMBER), ("note", ""), ("seen", -7), ("present", False), ("size", (1.0, 2.0, 3.0)),
    ("joint_positions", ()), ("pose", Pose((1, 2, 3), stamp=1e9)), ("mass", TOMBSTONE), ("color_of_mine", b"anything"),
]  # fmt: skip


def write(attribute: str, value: Any) -> Write:
    return Write(("a-1", 1), attribute, 1, "a-1", ("a-1", 2), value)


def read(attribute: str, value: Any) -> list[Any]:
    """A value as it comes in a delta, alone and beside others, in a piece, and from a file."""
    one = Delta(writes=[write(attribute, value)])
    more = Delta([Add(("a-1", 1), "n", "cube")], [*one.writes, write("other", 1)])
    deltas = [decode_delta(encode_delta(one)), decode_delta(encode_delta(more)), decode_kept(encode_delta(one))]
    piece = decode_piece(encode_piece(Piece(START, writes=one.writes, whole=[])))
    return [each.writes[0].value for each in (*deltas, piece)]


@pytest.mark.parametrize(("attribute", "value"), MISFITS, ids=str)
def test_what_no_such_attribute_has_is_taken_away(attribute: str, value: Any) -> None:
    assert read(attribute, value) == [TOMBSTONE] * 4
    message = encode_delta(Delta(writes=[write(attribute, value)]))
    assert decode_delta(message).misfits == 1
    two = Delta(writes=[write(attribute, value), write("note", 7), write("note", "")])
    assert decode_delta(encode_delta(two)).misfits == 2


@pytest.mark.parametrize(("attribute", "value"), FITTING, ids=str)
def test_what_fits_stays(attribute: str, value: Any) -> None:
    assert read(attribute, value) == [value] * 4
    assert decode_delta(encode_delta(Delta(writes=[write(attribute, value)]))).misfits == 0


def test_an_integer_is_a_float_where_one_is_wanted() -> None:
    value = fitted("mass", 2)
    assert value == 2.0 and type(value) is float


def test_each_built_in_attribute_takes_what_its_own_schema_takes(net: Net) -> None:
    a, b = net.join("a"), net.join("b")
    given: dict[str, Any] = {
        "bool": True, "int": 1, "float": 0.5, "str": "x", "bytes": b"x", "pose": Pose((1, 0, 0)),
    }  # fmt: skip
    values = {name: given.get(kind.kind, (0.5,) * (kind.length or 2)) for name, kind in BUILT_IN.items()}
    a.add_node("n", "cube", **values)
    net.pump(1.0)
    assert dict(b.node("n")) == dict(a.node("n")) == values


def test_all_replicas_read_it_so_and_tell_who_wrote_it(net: Net, caplog: pytest.LogCaptureFixture) -> None:
    a, evil = net.join("a"), net.network.connect("evil")
    a.replica.synchroniser.nobody_there()
    a.add_node("n", "cube", mass=1.0)
    net.pump(0.1)
    (owner,) = a.node("n").created
    for counter, value in enumerate(("heavy", "very heavy"), 1):
        bad = Write(owner, "mass", 1 << 61, "evil-1", ("evil-1", counter), value)
        delta = Delta(writes=[bad], context=[("evil-1", counter, counter)])
        evil.publish(Keys("g").delta("evil-1"), encode_delta(delta))
    net.pump(1.0)
    late = net.join("late")
    net.pump(2.0)
    for memory in (a, late):
        assert "mass" not in memory.node("n") and memory.node("n").get("mass", 7.0) == 7.0
    assert [record.args for record in caplog.records if "another kind" in record.msg] == [("evil-1",)]
    late.update_node("n", mass=2.0)
    net.pump(1.0)
    assert a.node("n")["mass"] == 2.0


def test_what_others_would_not_read_is_not_written(net: Net) -> None:
    a = net.join("a")
    a.add_node("n", "cube")
    for values in ({"mass": FAR}, {"size": (1.0, FAR, 1.0)}):
        with pytest.raises(SchemaError, match="expected numbers up to 1e"):
            a.update_node("n", **values)  # type: ignore[arg-type]
    a.schema.register_attribute("wealth", AttributeType("float"))
    a.update_node("n", wealth=FAR)
    assert a.node("n")["wealth"] == FAR
