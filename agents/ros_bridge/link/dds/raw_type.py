"""Topics whose messages go through Cyclone DDS as the bytes that they are: encoded and decoded elsewhere.

The structure of a type is told all the same, because other participants compare it with theirs.
"""

from __future__ import annotations

from typing import Any

from cyclonedds.idl import make_idl_struct
from cyclonedds.idl import types as idl_types
from rosbags.interfaces import Nodetype

from agents.ros_bridge.messages.names import dds_type
from agents.ros_bridge.messages.types import RosTypes

_idl: Any = idl_types
"""Its generic types are made in ways that type checkers do not follow."""
_BASE = {
    "bool": bool, "byte": _idl.byte, "char": _idl.uint8, "string": str, "int8": _idl.int8, "uint8": _idl.uint8,
    "int16": _idl.int16, "uint16": _idl.uint16, "int32": _idl.int32, "uint32": _idl.uint32, "int64": _idl.int64,
    "uint64": _idl.uint64, "float32": _idl.float32, "float64": _idl.float64,
}  # fmt: skip


class RawMessage:
    """A message in CDR; stands where Cyclone DDS expects an object that it can encode and decode."""

    def __init__(self, cdr: bytes) -> None:
        self.cdr = cdr
        self.sample_info: Any = None
        """Set by Cyclone DDS on what arrives: when it was sent, and by whom."""

    def serialize(self, use_version_2: bool | None = None) -> bytes:
        """The bytes, as the writer asks for them."""
        return self.cdr

    @classmethod
    def deserialize(cls, data: bytes) -> RawMessage:
        """The message, as the reader makes it."""
        return cls(data)

    @classmethod
    def deserialize_key(cls, data: bytes) -> RawMessage:
        """A message without content: the end of a writer."""
        return cls(b"")


def raw_type(types: RosTypes, type: str) -> Any:
    """The class of the messages of a type, for example `tf2_msgs/msg/TFMessage`: an `IdlStruct`, as `RawMessage` is."""
    made = _struct(types, type, {})
    for name in ("__init__", "serialize", "deserialize", "deserialize_key"):
        setattr(made, name, vars(RawMessage)[name])
    return made


def _struct(types: RosTypes, type: str, known: dict[str, Any]) -> Any:
    if type not in known:
        fields = {name: _field(types, kind, known) for name, kind in types.fields(type)}
        name = dds_type(type).replace("::", ".")
        known[type] = make_idl_struct(name.rpartition(".")[2], name, fields, dataclassify=False)
    return known[type]


def _field(types: RosTypes, kind: Any, known: dict[str, Any]) -> Any:
    node, inner = kind
    if node == Nodetype.NAME:
        return _struct(types, inner, known)
    if node == Nodetype.BASE:
        name, bound = inner
        return _idl.bounded_str[bound] if name == "string" and bound else _BASE[name]
    of, length = inner
    element = _field(types, of, known)
    if node == Nodetype.ARRAY:
        return _idl.array[element, length]
    return _idl.sequence[element, length] if length else _idl.sequence[element]
