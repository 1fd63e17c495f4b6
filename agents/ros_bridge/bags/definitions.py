"""Whether a bag means by the name of a type what we do."""

from __future__ import annotations

from typing import Any

from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat, Nodetype
from rosbags.typesys import TypesysError, get_types_from_idl, get_types_from_msg

from agents.ros_bridge.messages.types import RosTypes

_HEADER = "std_msgs/msg/Header"
_COUNTER = "seq"
"""Field of ROS 1 headers that ROS 2 has not"""
_FILE = f"{'=' * 80}\n"
"""Stands before each file of an IDL definition"""
_BASE_ALIASES = {"char": "uint8", "byte": "uint8", "octet": "uint8"}

Definitions = dict[str, Any]


def complaint(types: RosTypes, type: str, definition: MessageDefinition) -> str:
    """Why messages of a type cannot be read, as the bag defines it; empty if they can."""
    if type not in types:
        return "its type is not known"
    try:
        theirs = _read(definition, type)
    except (TypesysError, AssertionError, ValueError) as error:
        return f"the definition of its type cannot be read ({error})"
    return "" if theirs is None or _is_same(types, theirs, type) else "its type has other fields than ours"


def _read(definition: MessageDefinition, type: str) -> Definitions | None:
    """What the bag says; None if it says nothing."""
    if definition.format == MessageDefinitionFormat.NONE:
        return None
    if definition.format == MessageDefinitionFormat.MSG:
        return {name: fields for name, (_, fields) in get_types_from_msg(definition.data, type).items()}
    found: Definitions = {}
    for part in definition.data.split(_FILE):
        text = part.partition("\n")[2] if part.startswith("IDL: ") else part
        if text.strip():
            found |= {name: fields for name, (_, fields) in get_types_from_idl(text).items()}
    return found


def _is_same(types: RosTypes, theirs: Definitions, type: str) -> bool:
    """Names may differ in the case of letters: ROS 1 has `K` where ROS 2 has `k`."""
    if type not in theirs or type not in types:
        return type in types  # a bag may leave out what everybody has
    ours = [(name.lower(), kind) for name, kind in types.fields(type)]
    found = [(name.lower(), kind) for name, kind in theirs[type]]
    if type == _HEADER:
        found = [field for field in found if field[0] != _COUNTER]
    return len(ours) == len(found) and all(
        name == other and _is_same_kind(types, theirs, kind, their_kind)
        for (name, kind), (other, their_kind) in zip(ours, found, strict=True)
    )


def _is_same_kind(types: RosTypes, theirs: Definitions, ours: Any, found: Any) -> bool:
    (node, inner), (their_node, their_inner) = ours, found
    if node != their_node:
        return False
    if node == Nodetype.BASE:
        one, other = inner[0], their_inner[0]
        return bool(_BASE_ALIASES.get(one, one) == _BASE_ALIASES.get(other, other))
    if node == Nodetype.NAME:
        return bool(inner == their_inner) and _is_same(types, theirs, inner)
    if node == Nodetype.ARRAY and inner[1] != their_inner[1]:
        return False
    return _is_same_kind(types, theirs, inner[0], their_inner[0])
