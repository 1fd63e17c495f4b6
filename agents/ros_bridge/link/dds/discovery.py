"""Who is there, by the discovery of DDS and by what ROS nodes tell of themselves on `ros_discovery_info`."""

from __future__ import annotations

import re
from typing import Any, Literal

import numpy as np
from cyclonedds.builtin import (
    BuiltinDataReader,
    BuiltinTopicDcpsParticipant,
    BuiltinTopicDcpsPublication,
    BuiltinTopicDcpsSubscription,
)
from cyclonedds.core import InstanceState
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy
from cyclonedds.qos import Qos as DdsQos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic as DdsTopic
from cyclonedds.util import duration

from agents.ros_bridge.errors import RosMessageError
from agents.ros_bridge.link.dds.raw_type import raw_type
from agents.ros_bridge.link.link import Endpoint, Qos, Topic
from agents.ros_bridge.messages.names import ros_type
from agents.ros_bridge.messages.types import NO_HASH, RosTypes

_INFO = "rmw_dds_common/msg/ParticipantEntitiesInfo"
_TYPE_HASH = re.compile(rb"typehash=([^;]{0,256});")
_MOST = 20_000
"""Participants or endpoints that are looked at: robots have some hundreds"""
_MOST_PARTICIPANTS = 1000
"""Whose nodes are remembered: a machine has room for some hundred in a domain"""
_DEPTH_UNKNOWN = 0

Kind = Literal["publisher", "subscriber", "service", "client"]
_TOPIC, _REQUEST, _REPLY = "rt", "rq", "rr"
_KINDS: dict[tuple[str, bool], Kind] = {
    (_TOPIC, True): "publisher", (_TOPIC, False): "subscriber", (_REPLY, True): "service", (_REQUEST, True): "client",
}  # fmt: skip
"""By the first part of the DDS topic, and whether it is a writer. A service's reader and a client's are not listed."""
_SUFFIXES = {_REQUEST: ("Request", "_Request"), _REPLY: ("Reply", "_Response"), _TOPIC: ("", "")}


def dds_qos(qos: Qos, type_hash: str) -> DdsQos:
    """QoS as DDS has it."""
    policies: list[Any] = [
        Policy.Reliability.Reliable(duration(seconds=1)) if qos.reliable else Policy.Reliability.BestEffort,
        Policy.Durability.TransientLocal if qos.transient_local else Policy.Durability.Volatile,
        Policy.History.KeepLast(max(qos.depth, 1)),
        Policy.DataRepresentation(use_cdrv0_representation=True),
        Policy.IgnoreLocal.Participant,
    ]
    if type_hash != NO_HASH:
        policies.append(Policy.Userdata(f"typehash={type_hash};".encode()))
    return DdsQos(*policies)


class DdsDiscovery:
    """Reads what is visible, and tells others about our node."""

    def __init__(self, participant: DomainParticipant, node: str, types: RosTypes) -> None:
        self._types = types
        self._node = node
        self._gid = participant.guid.bytes
        self._participants = BuiltinDataReader(participant, BuiltinTopicDcpsParticipant)
        self._publications = BuiltinDataReader(participant, BuiltinTopicDcpsPublication)
        self._subscriptions = BuiltinDataReader(participant, BuiltinTopicDcpsSubscription)
        newest, of_all = (
            dds_qos(Qos(transient_local=True, depth=depth), types.hash(_INFO)) for depth in (1, _MOST_PARTICIPANTS)
        )
        topic = DdsTopic(participant, "ros_discovery_info", raw_type(types, _INFO))
        self._infos: DataReader[Any] = DataReader(participant, topic, of_all)  # they share one instance: it has no key
        self._own: DataWriter[Any] = DataWriter(participant, topic, newest)
        self._nodes: dict[bytes, dict[bytes, str]] = {}
        """By participant, the node of each of its endpoints."""

    def tell(self, readers: list[bytes], writers: list[bytes]) -> None:
        """Announce our node and its endpoints, by their gids."""
        new = self._types.new
        namespace, _, name = self._node.rpartition("/")

        def gid(data: bytes) -> Any:
            return new("rmw_dds_common/msg/Gid", data=np.frombuffer(self._padded(data), np.uint8))

        info = new(
            "rmw_dds_common/msg/NodeEntitiesInfo", node_namespace=namespace or "/", node_name=name,
            reader_gid_seq=[gid(one) for one in readers], writer_gid_seq=[gid(one) for one in writers],
        )  # fmt: skip
        message = new(_INFO, gid=gid(self._gid), node_entities_info_seq=[info])
        self._own.write(self._own.topic.data_type(self._types.encode(_INFO, message)))

    def endpoints(self) -> list[Endpoint]:
        """All endpoints of ROS that are visible, ours included."""
        self._read_nodes()
        found = []
        for reader, writes in ((self._publications, True), (self._subscriptions, False)):
            found += [one for sample in _alive(reader) if (one := self._endpoint(sample, writes))]
        return found

    def participants(self) -> set[bytes]:
        """GUIDs of all that are in the domain, whether they tell of endpoints or not."""
        return {sample.key.bytes for sample in _alive(self._participants)}

    def with_endpoints(self) -> set[bytes]:
        """GUIDs of those that tell of endpoints."""
        told = [*_alive(self._publications), *_alive(self._subscriptions)]
        return {sample.participant_key.bytes for sample in told}

    def nodes_of(self, participant: bytes) -> list[str]:
        """Full names of a participant's nodes, sorted, as far as they are known; `participant` is its GUID."""
        return sorted(set(self._nodes.get(participant, {}).values()))

    def _endpoint(self, sample: Any, writes: bool) -> Endpoint | None:
        prefix, _, name = sample.topic_name.partition("/")
        kind = _KINDS.get((prefix, writes))
        if kind is None:
            return None
        of_topic, of_type = _SUFFIXES[prefix]
        topic = Topic(
            f"/{name.removesuffix(of_topic)}", ros_type(sample.type_name).removesuffix(of_type), _qos(sample.qos)
        )
        participant, gid = sample.participant_key.bytes, sample.key.bytes
        mine = participant == self._gid
        node = self._node if mine else self._nodes.get(participant, {}).get(gid, "")
        return Endpoint(kind, node, topic, _hash(sample.qos), mine, gid)

    def _read_nodes(self) -> None:
        for sample in self._infos.take(N=_MOST):
            if not getattr(sample, "cdr", b""):
                continue
            try:
                info = self._types.decode(_INFO, sample.cdr)
            except RosMessageError:
                continue  # of a release with other gids: its nodes have no names for us
            self._remember(bytes(info.gid.data)[:16], {
                bytes(gid.data)[:16]: f"{node.node_namespace.rstrip('/')}/{node.node_name}"
                for node in info.node_entities_info_seq
                for gid in (*node.reader_gid_seq, *node.writer_gid_seq)
            })  # fmt: skip

    def _remember(self, participant: bytes, nodes: dict[bytes, str]) -> None:
        """Instead of those of the participants that told theirs longest ago, if there are too many."""
        self._nodes.pop(participant, None)
        self._nodes[participant] = nodes
        number = sum(map(len, self._nodes.values()))
        while self._nodes and (number > _MOST or len(self._nodes) > _MOST_PARTICIPANTS):
            number -= len(self._nodes.pop(next(iter(self._nodes))))

    def _padded(self, gid: bytes) -> bytes:
        """Gids have 16 bytes, and 24 in releases before Iron."""
        return gid.ljust(len(self._types.new("rmw_dds_common/msg/Gid").data), b"\0")


def _alive(reader: Any) -> list[Any]:
    """What a reader of DDS's own topics tells of all that is there now."""
    return [one for one in reader.read(N=_MOST) if one.sample_info.instance_state == InstanceState.Alive]


def _policy(qos: DdsQos, kind: Any) -> Any:
    return qos[kind] if kind in qos else None  # noqa: SIM401 - it has no `get`


def _hash(qos: DdsQos) -> str:
    policy = _policy(qos, Policy.Userdata)
    found = _TYPE_HASH.search(bytes(policy.data)) if policy is not None else None
    return found[1].decode("ascii", "replace") if found else ""


def _qos(qos: DdsQos) -> Qos:
    history = _policy(qos, Policy.History)
    reliability = _policy(qos, Policy.Reliability)
    return Qos(
        reliable=reliability is not None and reliability != Policy.Reliability.BestEffort,
        transient_local=_policy(qos, Policy.Durability) == Policy.Durability.TransientLocal,
        depth=getattr(history, "depth", _DEPTH_UNKNOWN),
    )
