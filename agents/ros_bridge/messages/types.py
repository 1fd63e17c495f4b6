"""The message types of a release of ROS 2: their hashes, and messages made, encoded as CDR and decoded."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from agents.ros_bridge.errors import RosMessageError
from agents.ros_bridge.messages import definitions
from dsr.errors import suggest

DISTROS = ("humble", "iron", "jazzy", "kilted", "lyrical")
"""Releases of ROS 2 whose messages are known"""
NO_HASH = "TypeHashNotSupported"
"""What stands for the hash of a type in Humble, which has none"""
_WITHOUT_HASHES = ("humble",)

_LITTLE, _BIG = b"\x00\x01", b"\x00\x00"
"""Encapsulations that ROS uses: plain CDR of either byte order"""
_HEADER = 4
"""Bytes of the encapsulation, two of which are options without meaning here"""
_EMPTY = [("structure_needs_at_least_one_member", (Nodetype.BASE, ("uint8", 0)))]
"""Fields of a message without fields"""
_DATA_AT_END = {"sensor_msgs/msg/Image": 0, "sensor_msgs/msg/CompressedImage": 0, "sensor_msgs/msg/PointCloud2": 1}
"""Types with a large field `data` of bytes: how many bytes follow the data"""
_NO_DATA = np.zeros(0, np.uint8)
_REFUSALS = (SerdeError, struct.error, ValueError, TypeError, AttributeError, IndexError, KeyError, OverflowError)
"""What the encoder and decoder raise for values and bytes that do not fit"""
_DTYPES = {"bool": "bool", "byte": "int8", "char": "uint8"}

Fields = list[tuple[str, Any]]


class RosTypes:
    """All types of one release, see `types_of`."""

    def __init__(self, distro: str) -> None:
        if distro not in DISTROS:
            raise RosMessageError(f"no release of ROS 2 is called {distro!r}; {suggest(distro, DISTROS)}")
        self.distro = distro
        self._store = get_typestore(Stores(f"ros2_{distro}"))
        actions = definitions.actions(distro)
        found = dict(_messages(definitions.MESSAGES))
        for name, parts in definitions.SERVICES.items():
            found |= _service(name, *(_fields(part, name) for part in parts))
        for name, (goal, result, feedback) in actions.items():
            found |= _action(name, *(_fields(part, name) for part in (goal, result, feedback)))
        self._store.register({name: ([], fields) for name, fields in found.items() if name not in self._store.types})
        self._services = {name.removesuffix("_Request") for name in self._store.types if name.endswith("_Request")}
        self._actions = set(actions)
        self._hashes = _hash_store(self._store, self._services, self._actions)
        self._known_hashes: dict[str, str] = {}

    def __contains__(self, type: str) -> bool:
        """Whether a message, service or action type is known."""
        return type in self._store.types or type in self._services or type in self._actions

    def __iter__(self) -> Iterator[str]:
        """The names of all message types."""
        return iter(self._store.types)

    def fields(self, type: str) -> Fields:
        """Names and kinds of the fields of a message type, in order, as `rosbags` describes them."""
        self._class(type)
        return list(self._store.fielddefs[type][1])

    def hash(self, type: str) -> str:
        """`RIHS01_...` of a message, service or action type; `NO_HASH` for a release that has none."""
        if type not in self:
            raise self._unknown(type)
        if self.distro in _WITHOUT_HASHES:
            return NO_HASH
        if type not in self._known_hashes:
            self._known_hashes[type] = self._hashes.hash_rihs01(type)
        return self._known_hashes[type]

    def definition(self, type: str) -> str:
        """The definition of a message type and all types in it, as `ros2msg` schemas of MCAP files have it.

        Raises:
            RosMessageError: for an unknown type, or a part of a service or action, which have no such definition.
        """
        if type not in self._store.types or "/msg/" not in type:
            raise self._unknown(type)
        return self._store.generate_msgdef(type, ros_version=2)[0]

    def new(self, type: str, /, **values: Any) -> Any:
        """A message with these fields; all others are zero or empty. Raises `RosMessageError` for an unknown field."""
        cls = self._class(type)
        fields = dict(self._store.fielddefs[type][1])
        if unknown := sorted(values.keys() - fields.keys()):
            raise RosMessageError(f"{type} has no field {unknown[0]!r}; {suggest(unknown[0], fields)}")
        return cls(*(self._value(kind, values, name) for name, kind in fields.items()))

    def encode(self, type: str, message: Any) -> bytes:
        """A message as CDR, little endian. Raises `RosMessageError` for values that do not fit."""
        self._class(type)
        try:
            if type in _DATA_AT_END:
                return self._encode_large(type, message, _DATA_AT_END[type])
            return bytes(self._store.serialize_cdr(message, type, little_endian=True))
        except _REFUSALS as error:
            raise RosMessageError(f"no {type} can be made of these values: {error}") from error

    def decode(self, type: str, cdr: bytes | memoryview) -> Any:
        """The message that CDR of either byte order holds; arrays of numbers are views into `cdr` where they can be.

        No more is allocated than a small multiple of the length of `cdr`, whatever lengths it claims. Bytes behind the
        message are ignored, as ROS does: `rclpy.serialization.serialize_message` and DDS leave some there.

        Raises:
            RosMessageError: for bytes that are no such message.
        """
        self._class(type)
        try:
            definition = self._store.get_msgdef(type)
            read = {_LITTLE: definition.deserialize_cdr_le, _BIG: definition.deserialize_cdr_be}[bytes(cdr[:2])]
            message, end = read(memoryview(cdr)[_HEADER:], 0, definition.cls, self._store)
        except _REFUSALS as error:
            raise RosMessageError(f"{len(cdr)} bytes are no {type}: {_said(error)}") from error
        if end > len(cdr) - _HEADER:
            raise RosMessageError(f"{len(cdr)} bytes are no {type}: {end + _HEADER - len(cdr)} are missing")
        return message

    def from_ros1(self, type: str, message: bytes) -> bytes:
        """The CDR of a message in the encoding of ROS 1. Raises `RosMessageError` for bytes that are none."""
        self._class(type)
        try:
            return bytes(self._store.ros1_to_cdr(message, type))
        except _REFUSALS as error:
            raise RosMessageError(f"{len(message)} bytes are no {type} of ROS 1: {error}") from error

    def _encode_large(self, type: str, message: Any, after: int) -> bytes:
        """Copies the data once only, which takes a third of the time for a VGA image."""
        data = np.ascontiguousarray(message.data, np.uint8).reshape(-1)
        around = self._store.serialize_cdr(replace(message, data=_NO_DATA), type, little_endian=True)
        end = len(around) - after
        return b"".join((around[: end - 4], struct.pack("<I", data.nbytes), data.data, around[end:]))

    def _value(self, kind: Any, values: dict[str, Any], name: str) -> Any:
        node, inner = kind
        given = values.get(name)
        if node == Nodetype.NAME:
            return self.new(inner) if given is None else given
        if node == Nodetype.BASE:
            zero = "" if inner[0] == "string" else False if inner[0] == "bool" else 0.0 if "float" in inner[0] else 0
            return zero if given is None else given
        (of, what), length = inner
        number = length if node == Nodetype.ARRAY else 0
        if of == Nodetype.BASE and what[0] != "string":
            dtype = _DTYPES.get(what[0], what[0])
            try:
                return np.zeros(number, dtype) if given is None else np.ascontiguousarray(given, dtype).reshape(-1)
            except (ValueError, TypeError, OverflowError) as error:
                raise RosMessageError(f"{name}: {error}") from error
        if given is not None:
            return given
        return ["" if of == Nodetype.BASE else self.new(what) for _ in range(number)]

    def _class(self, type: str) -> Callable[..., Any]:
        try:
            return self._store.types[type]
        except KeyError:
            raise self._unknown(type) from None

    def _unknown(self, type: str) -> RosMessageError:
        known = [*self._store.types, *self._services, *self._actions]
        return RosMessageError(f"no type of ROS 2 {self.distro} is called {type!r}; {suggest(type, known, most=0)}")


def _said(error: Exception) -> str:
    return "no encapsulation that is known" if isinstance(error, KeyError) else str(error)


@cache
def types_of(distro: str) -> RosTypes:
    """The types of a release, made once. Raises `RosMessageError` for an unknown release."""
    return RosTypes(distro)


def _fields(text: str, owner: str) -> Fields:
    """Of a list of fields; types without a package are messages of that of `owner`."""
    name = f"{owner.partition('/')[0]}/msg/_"
    return list(get_types_from_msg(text.replace(";", "\n"), name)[name][1])


def _messages(texts: dict[str, str]) -> Iterable[tuple[str, Fields]]:
    for name, text in texts.items():
        yield name, _fields(text, name)


def _service(name: str, request: Fields, response: Fields) -> dict[str, Fields]:
    return {f"{name}_Request": request or _EMPTY, f"{name}_Response": response or _EMPTY}


def _action(name: str, goal: Fields, result: Fields, feedback: Fields) -> dict[str, Fields]:
    """The messages of an action, and of the services and the topic that carry it."""
    goal_id = ("goal_id", (Nodetype.NAME, "unique_identifier_msgs/msg/UUID"))
    stamp = ("stamp", (Nodetype.NAME, "builtin_interfaces/msg/Time"))
    accepted = ("accepted", (Nodetype.BASE, ("bool", 0)))
    status = ("status", (Nodetype.BASE, ("int8", 0)))

    def part(kind: str) -> tuple[str, Any]:
        return kind.lower(), (Nodetype.NAME, f"{name}_{kind}")

    return {
        f"{name}_Goal": goal or _EMPTY,
        f"{name}_Result": result or _EMPTY,
        f"{name}_Feedback": feedback or _EMPTY,
        f"{name}_FeedbackMessage": [goal_id, part("Feedback")],
        **_service(f"{name}_SendGoal", [goal_id, part("Goal")], [accepted, stamp]),
        **_service(f"{name}_GetResult", [goal_id], [status, part("Result")]),
    }


def _hash_store(store: Typestore, services: set[str], actions: set[str]) -> Typestore:
    """The types as they are hashed: `char` is `uint8`, and services and actions are structures of their messages."""
    hashed = Typestore()
    found: dict[str, Fields] = {
        name: [(field, _hashed(kind)) for field, kind in fields] for name, (_, fields) in store.fielddefs.items()
    }

    def message(field: str, type: str) -> tuple[str, Any]:
        return field, (Nodetype.NAME, type)

    for name in services:
        request, response, event = (f"{name}_{part}" for part in ("Request", "Response", "Event"))
        found[event] = [
            message("info", "service_msgs/msg/ServiceEventInfo"),
            ("request", (Nodetype.SEQUENCE, ((Nodetype.NAME, request), 1))),
            ("response", (Nodetype.SEQUENCE, ((Nodetype.NAME, response), 1))),
        ]
        found[name] = [
            message("request_message", request), message("response_message", response),
            message("event_message", event),
        ]  # fmt: skip
    for name in actions:
        found[name] = [
            message("goal", f"{name}_Goal"), message("result", f"{name}_Result"),
            message("feedback", f"{name}_Feedback"), message("send_goal_service", f"{name}_SendGoal"),
            message("get_result_service", f"{name}_GetResult"),
            message("feedback_message", f"{name}_FeedbackMessage"),
        ]  # fmt: skip
    hashed.fielddefs = {name: ([], fields) for name, fields in found.items()}
    return hashed


def _hashed(kind: Any) -> Any:
    node, inner = kind
    if node == Nodetype.BASE:
        return (node, ("uint8", inner[1])) if inner[0] == "char" else kind
    if node == Nodetype.NAME:
        return kind
    return node, (_hashed(inner[0]), inner[1])
