"""What rmw_zenoh_cpp puts on the wire besides messages: keys, liveliness tokens, QoS, gids, attachments.

Written after rmw_zenoh 0.2.4 to 0.10 (`liveliness_utils.cpp`, `attachment_helpers.cpp`, `rmw_publisher_data.cpp`).
"""

from __future__ import annotations

import struct
from typing import Literal

import msgspec
import xxhash

from agents.ros_bridge.errors import RosMessageError
from agents.ros_bridge.link.link import Qos
from agents.ros_bridge.messages.names import dds_type, ros_type

Kind = Literal["node", "publisher", "subscriber", "service", "client"]

ADMIN = "@ros2_lv"
"""First part of all liveliness tokens"""
GID_BYTES = 16

_CODES: dict[Kind, str] = {"node": "NN", "publisher": "MP", "subscriber": "MS", "service": "SS", "client": "SC"}
_KINDS = {code: kind for kind, code in _CODES.items()}
_NODE_PARTS = 9
_TOPIC_PARTS = 13
"""Later releases may add parts at the end."""
_DEFAULT_DEPTH = 42
"""Of QoS that does not tell one"""
_BEST_EFFORT, _TRANSIENT_LOCAL = "2", "1"
_KEEP_ALL = "2"
_REST_OF_QOS = ":,:,:,,"
"""No deadline, no lifespan, automatic liveliness"""
_ATTACHMENT = struct.Struct(f"<qqB{GID_BYTES}s")
_OLD_ATTACHMENT = b"sequence_number"
"""Name that rmw_zenoh wrote before each number up to 0.1.1 (Humble), 0.2.3 (Jazzy) and 0.5 (Rolling)"""
_MOST_DEPTH = 1 << 31
_LONGEST = 4096
"""Characters of a token: DDS, and so ROS, allows 255 for each of its names"""


class Entity(msgspec.Struct, frozen=True):
    """What a liveliness token tells about a node, or about a publisher, subscriber, service or client of it."""

    kind: Kind
    domain: int
    session: str
    """Zenoh id of the process"""
    node_id: int
    id: int
    """Number within the session; that of the node itself for a node"""
    node: str
    """Full name, for example `/camera/driver`"""
    topic: str = ""
    """Of the topic or service; empty for a node, like the rest"""
    type: str = ""
    """As ROS calls it; as DDS does, if it is none of ROS"""
    hash: str = ""
    qos: Qos = Qos()

    def token(self) -> str:
        """The key of its liveliness token."""
        namespace, _, name = self.node.rpartition("/")
        parts = [
            ADMIN, str(self.domain), self.session, str(self.node_id), str(self.id), _CODES[self.kind],
            "%", _mangled(namespace or "/"), name,
        ]  # fmt: skip
        if self.kind != "node":
            parts += [_mangled(self.topic), _on_the_wire(self.type), self.hash, qos_key(self.qos)]
        return "/".join(parts)

    def key(self) -> str:
        """The key of its messages or requests."""
        return f"{self.domain}/{self.topic.strip('/')}/{_on_the_wire(self.type)}/{self.hash}"


def read_token(key: str) -> Entity | None:
    """What a liveliness token tells; None if it is none of ROS, or malformed."""
    parts = key.split("/") if len(key) <= _LONGEST else []
    kind = _KINDS.get(parts[5]) if len(parts) >= _NODE_PARTS else None
    if kind is None or parts[0] != ADMIN or not all(parts):
        return None
    if kind != "node" and len(parts) < _TOPIC_PARTS:
        return None
    try:
        domain, node_id, own_id = _number(parts[1]), _number(parts[3]), _number(parts[4])
        node = f"{parts[7].replace('%', '/').rstrip('/')}/{parts[8].replace('%', '/').lstrip('/')}"
        if kind == "node":
            return Entity(kind, domain, parts[2], node_id, own_id, node)
        topic = parts[9].replace("%", "/")
        qos = read_qos(parts[12])
    except ValueError:
        return None
    return Entity(kind, domain, parts[2], node_id, own_id, node, topic, ros_type(parts[10]), parts[11], qos)


def qos_key(qos: Qos) -> str:
    """QoS as a token has it: only what differs from reliable, volatile, the last 42."""
    reliability = "" if qos.reliable else _BEST_EFFORT
    durability = _TRANSIENT_LOCAL if qos.transient_local else ""
    depth = "" if qos.depth == _DEFAULT_DEPTH else str(qos.depth)
    return f"{reliability}:{durability}:,{depth}{_REST_OF_QOS}"


def read_qos(text: str) -> Qos:
    """QoS that a token tells; raises `ValueError` if it is malformed."""
    reliability, durability, history, *_ = text.split(":")
    kept, _, depth = history.partition(",")
    if kept == _KEEP_ALL:
        depth = str(_MOST_DEPTH - 1)
    return Qos(
        reliable=reliability != _BEST_EFFORT,
        transient_local=durability == _TRANSIENT_LOCAL,
        depth=_number(depth) if depth else _DEFAULT_DEPTH,
    )


def gid(token: str) -> bytes:
    """The 16 bytes by which the entity with this token is named in attachments."""
    return xxhash.xxh3_128_intdigest(token.encode()).to_bytes(GID_BYTES, "little")


def attachment(number: int, stamp: int, gid: bytes) -> bytes:
    """What goes with a message, request or response: its number from 1, the time in ns, and who sent it."""
    return _ATTACHMENT.pack(number, stamp, GID_BYTES, gid)


def read_attachment(data: bytes) -> tuple[int, int, bytes]:
    """Number, time (ns) and gid of an attachment; raises `RosMessageError` if it is malformed."""
    if len(data) != _ATTACHMENT.size or data[16] != GID_BYTES:
        raise RosMessageError(f"{len(data)} bytes are no attachment of rmw_zenoh")
    number, stamp, _, sender = _ATTACHMENT.unpack(data)
    return number, stamp, sender


def is_old_attachment(data: bytes) -> bool:
    """Whether this is the form of rmw_zenoh before 0.2.4, which neither later releases nor we read."""
    return _OLD_ATTACHMENT in data[:20]


def _on_the_wire(type: str) -> str:
    return dds_type(type) if "/" in type else type


def _number(text: str) -> int:
    """A number of a token; raises `ValueError` if it is none."""
    value = int(text) if text.isascii() and text.isdigit() and len(text) <= len(str(_MOST_DEPTH)) else -1
    if not 0 <= value < _MOST_DEPTH:
        raise ValueError(f"{text!r} is no number of a token")
    return value


def _mangled(name: str) -> str:
    return name.replace("/", "%")
