"""Right messages of every kind, made by the code that sends them."""

from __future__ import annotations

import json
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from agents.drivers import ArmState, TagReading, TagReadings
from agents.plant.messages import Follow, MoveGripper, Stop, Truth
from dsr import Pose
from dsr.crdt.context import CausalContext
from dsr.crdt.delta import Delta
from dsr.crdt.pieces import START, Piece, piece_of, reply_to
from dsr.geometry import Mesh
from dsr.geometry.messages import AskForMesh, Offer, encode_ask, encode_offer
from dsr.geometry.shared import SharedPlace
from dsr.graph.graph import Graph
from dsr.images.blobs import Frame, encode_frame
from dsr.network.keys import part_rid
from dsr.network.shared_ring import SlotDescriptor
from dsr.parts.graph import PartedGraph
from dsr.parts.registry import PartInfo, to_attribute
from dsr.replication.holders import VERSION, HolderQuery, HoldersAnswer
from dsr.replication.piece_wire import Request, encode_piece, encode_request
from dsr.replication.portions import portion
from dsr.replication.wire import Digest, encode_delta, encode_digest
from dsr.runtime.logs import LogRecord
from dsr.runtime.status import State, Status, encode_status
from dsr.vocabulary.intrinsics import Intrinsics
from dsr.vocabulary.scenario_start import Start
from dsr.vocabulary.what_if import Answer, Question, Supposed, encode_answer, encode_question

NOW = 1_000_000_000.0
JOINTS = 7
_SEVEN = (0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0)


def a_graph(rid: str = "arm_controller-5f0c12aa") -> tuple[Graph, list[Delta]]:
    """A small scene, and the deltas that made it."""
    graph = Graph(rid)
    covariance = tuple(1e-6 * (row == column) for row in range(6) for column in range(6))
    pose = Pose((0.4, 0.0, 0.1), stamp=NOW, covariance=np.reshape(covariance, (6, 6)))
    deltas = [
        graph.add_node("world", "world", {}, NOW),
        graph.add_node("table", "table", {"size": (1.0, 0.8, 0.04), "note": "wood"}, NOW),
        graph.add_node("cube_3", "cube", {"mass": 0.1, "perceived": True, "seen": 7}, NOW),
        graph.add_edge("world", "table", "RT", {"pose": pose}, NOW),
        graph.add_edge("table", "cube_3", "RT", {"pose": Pose((0.0, 0.1, 0.04), stamp=NOW)}, NOW),
        graph.add_edge("cube_3", "table", "on", {"since": NOW}, NOW),
    ]
    deltas += [
        graph.write(graph.edge("table", "cube_3", "RT"), {"pose": pose}, NOW + 1),
        graph.write(graph.node("cube_3"), {"seen": 8, "mass": 0.2}, NOW + 1),
        graph.remove_attribute(graph.node("table"), "note", NOW + 1),
        graph.remove_edge(("cube_3", "table", "on")),
        graph.make_durable(),
    ]
    return graph, [delta for delta in deltas if delta]


def deltas() -> list[bytes]:
    """Deltas, bundles of samples, and a removal."""
    graph, made = a_graph()
    return [encode_delta(delta) for delta in [*made, graph.remove_node("cube_3")]]


def replies() -> list[bytes]:
    """Synchronisation replies: of everything, and of a part."""
    graph, made = a_graph()
    seen = CausalContext(made[0].context)
    return [encode_delta(reply_to(graph.store, context)) for context in (CausalContext(), seen, graph.store.context)]


def pieces() -> list[bytes]:
    """Pieces of replies: to one who has seen nothing, a part, and everything; and a refusal."""
    graph, made = a_graph()
    contexts = [CausalContext(), CausalContext(made[0].context), graph.store.context]
    refusal = Piece(START, joined=False, waits_for=["viewer-1"])
    return [encode_piece(piece) for piece in [*(piece_of(graph.store, seen) for seen in contexts), refusal]]


PART = "kitchen"
IN_PART = part_rid("arm_controller-5f0c12aa", PART, 1)
"""A replica of the part."""


def a_part() -> tuple[PartedGraph, list[Delta]]:
    """A part of a graph with things in it, and what its replica sent; with edges into no part, and into another one."""
    whole = PartedGraph("arm_controller-5f0c12aa")
    whole.hold(PART, IN_PART)
    whole.hold("hall", part_rid("arm_controller-5f0c12aa", "hall", 1))
    pose = Pose((0.4, 0.0, 0.1), stamp=NOW)
    deltas = [
        whole.add_node("world", "world", {}, NOW),
        whole.add_node("sink", "table", {"size": (1.0, 0.8, 0.04)}, NOW, PART),
        whole.add_node("cup", "cube", {"mass": 0.1, "seen": 7}, NOW, PART),
        whole.add_node("door", "table", {}, NOW, "hall"),
        whole.add_edge("sink", "cup", "RT", {"pose": pose}, NOW),
        whole.add_edge("cup", "world", "on", {}, NOW),
        whole.add_edge("sink", "door", "on", {}, NOW),
        whole.write(whole.edge("sink", "cup", "RT"), {"pose": pose}, NOW + 1),
        whole.remove_node("door"),
        whole.remove_edge(("cup", "world", "on")),
        whole.parts[PART].make_durable(),
    ]
    return whole, [mine for delta in deltas if (mine := portion(delta, PART))]


def part_deltas() -> list[bytes]:
    """Deltas of a part, a removal, and one of another part, which none of this part may send."""
    whole, made = a_part()
    return [encode_delta(delta) for delta in [*made, portion(whole.remove_node("cup"), PART), a_graph()[1][0]]]


def part_pieces() -> list[bytes]:
    """Pieces of replies of a part: to one who has seen nothing, and some."""
    whole, made = a_part()
    store = whole.parts[PART].store
    return [encode_piece(piece_of(store, seen)) for seen in (CausalContext(), CausalContext(made[0].context))]


def part_digests() -> list[bytes]:
    """What a replica of a part has seen."""
    whole, _ = a_part()
    store = whole.parts[PART].store
    return [encode_digest(Digest(IN_PART, NOW, store.context.summary(), store.fingerprint, ()))]


def part_requests() -> list[bytes]:
    """Requests of a part."""
    whole, made = a_part()
    seen = CausalContext(whole.parts[PART].store.context.ranges())
    place = made[0].adds[0].dot
    return [
        encode_request(Request("peer-kitchen.1", seen, START)),
        encode_request(Request("peer-kitchen.1", CausalContext(), (*place, "mass"), insists=True)),
    ]


def part_records() -> list[bytes]:
    """Entries in the list of parts."""
    infos = (PartInfo(PART), PartInfo("hall", ("ball", "cube"), "viewer", NOW))
    return [to_attribute(info).encode() for info in infos]


def requests() -> list[bytes]:
    """Requests for the first piece, and for a later one."""
    context = CausalContext([("arm_controller-5f0c12aa", 1, 9), ("viewer-1", 3, 4)])
    place = ("arm_controller-5f0c12aa", 3, "mass")
    return [
        encode_request(Request("peer", seen, begin, insists=insists))
        for seen, begin, insists in ((CausalContext(), START, False), (context, place, True))
    ]


def _seen() -> CausalContext:
    return CausalContext([("arm_controller-5f0c12aa", 1, 9), ("viewer-1", 3, 4), ("viewer-1", 8, 8)])


def digests() -> list[bytes]:
    """What replicas have seen, in short."""
    return [
        encode_digest(Digest("peer", NOW, seen.summary(), 2**63 + 1, ahead))
        for seen, ahead in ((CausalContext(), ()), (_seen(), ("arm_controller-5f0c12aa",)))
    ]


def frames() -> list[bytes]:
    """A camera frame, and one without arrays."""
    arrays: dict[str, NDArray[Any]] = {"color": np.zeros((4, 6, 3), np.uint8), "depth": np.ones((4, 6), np.float32)}
    meta: dict[str, float | int | str] = {"fx": 600.0, "fy": 600.0, "cx": 3.0, "cy": 2.0, "camera": "overhead"}
    return [encode_frame(Frame(NOW, arrays, meta)), encode_frame(Frame(NOW, {}, {}))]


def descriptors() -> list[bytes]:
    """A descriptor for a message in shared memory, and the empty one."""
    descriptor = SlotDescriptor(1, 5, b"0123456789abcdef", 4096, 1, 3, 4000)
    return [msgspec.msgpack.encode(descriptor), msgspec.msgpack.encode(None)]


def mesh_requests() -> list[bytes]:
    """Who has a mesh; a piece of one."""
    return [encode_ask(AskForMesh("0123456789abcdef" * 4)), encode_ask(AskForMesh("f" * 64, 1 << 20, 4096, keep=True))]


def mesh_offers() -> list[bytes]:
    """A mesh that is to be had in pieces, and one that can be read in place."""
    return [encode_offer(Offer(3_600_016)), encode_offer(Offer(4000, SharedPlace(1, 5, 4000)))]


def meshes() -> list[bytes]:
    """A triangle and a strip."""
    strip = [(x, y, 0.5) for x in range(20) for y in (0.0, 1.0)]
    triangles = [(k, k + 1, k + 2) for k in range(38)]
    return [bytes(Mesh(strip[:3], triangles[:1]).data), bytes(Mesh(strip, triangles).data)]


def statuses() -> list[bytes]:
    """How an agent is doing."""
    status = Status(agent="viewer", rid="viewer-1", pid=1234, state=State.READY, rate_hz=10.0, stamp=NOW)
    return [encode_status(status), encode_status(msgspec.structs.replace(status, state=State.FAILED, last_error="x"))]


def log_records() -> list[bytes]:
    """What an agent says."""
    return [msgspec.msgpack.encode(LogRecord(NOW, level, "viewer", "text")) for level in ("INFO", "ERROR")]


def arm_states() -> list[bytes]:
    """A sample of the joints."""
    names = tuple(f"joint_{index}" for index in range(JOINTS))
    return [msgspec.msgpack.encode(ArmState(NOW, names, (0.1,) * JOINTS, (0.0,) * JOINTS, 0.08, False))]


def tag_readings() -> list[bytes]:
    """What a camera that detects tags sees."""
    readings = [TagReading(number, _SEVEN, 0.001, 0.01) for number in (3, 4)]
    intrinsics = Intrinsics(600.0, 600.0, 319.5, 239.5, 640, 480)
    return [
        msgspec.msgpack.encode(TagReadings(NOW, readings, intrinsics)),
        msgspec.msgpack.encode(TagReadings(NOW, [])),
    ]


def commands() -> list[bytes]:
    """Commands to the arm."""
    row = (0.1,) * JOINTS
    samples = (Follow((0.0, 0.5), (row, row)), MoveGripper(0.04), Stop())
    return [msgspec.msgpack.encode(command) for command in samples]


def starts() -> list[bytes]:
    """The start of a scenario."""
    return [msgspec.msgpack.encode(Start(NOW))]


def truths() -> list[bytes]:
    """The true world."""
    truth = Truth(NOW, {"cube_3": _SEVEN, "cube_4": _SEVEN}, (0.1,) * JOINTS, 0.08, "cube_3", {"overhead": _SEVEN})
    return [msgspec.msgpack.encode(truth)]


def questions() -> list[bytes]:
    """Questions to the belief's simulator."""
    changes = (Supposed.place("cube_3", Pose(_SEVEN[:3])), Supposed.hold("cube_4"), Supposed.remove("cube_5"))
    return [encode_question(Question(0.5, changes, NOW)), encode_question(Question(1.0))]


def answers() -> list[bytes]:
    """Its answers."""
    whole = Answer(
        stamp=NOW,
        seconds=0.5,
        at_rest=True,
        poses={"cube_3": _SEVEN},
        moved={"cube_3": 0.001},
        turned={"cube_3": 0.02},
        rests_on={"cube_3": ("table",)},
        touches=(("cube_3", "table"),),
        on_floor=("cube_4",),
    )
    return [encode_answer(whole), encode_answer(Answer(refused="no object 'cube_9'"))]


def endpoint_files() -> list[bytes]:
    """What a process leaves for others to find it."""
    return [b"tcp/127.0.0.1:41234 memory", b"tcp/127.0.0.1:41234 no-memory"]


def graph_files() -> list[bytes]:
    """A graph as JSON, ours and of CORTEX."""
    attribute = {"mass": {"type": 2, "value": 0.5}, "color": {"type": 3, "value": [1.0, 0.0, 0.0]}}
    link = {"src": "1", "dst": "2", "label": "RT", "linkAttribute": {
        "rt_translation": {"type": 3, "value": [100.0, 0.0, 20.0]},
        "rt_rotation_euler_xyz": {"type": 3, "value": [0.0, 0.0, 1.5]}}}  # fmt: skip
    symbols = {
        "1": {"id": "1", "name": "world", "type": "world", "attribute": {}, "links": [link]},
        "2": {"id": "2", "name": "cube_3", "type": "cube", "attribute": attribute, "links": []},
    }
    ours = {"format": "dsr-graph", "version": 1, "nodes": [], "edges": []}
    return [json.dumps({"DSRModel": {"symbols": symbols}}).encode(), json.dumps(ours).encode()]


def holder_queries() -> list[bytes]:
    """Questions who holds worlds and parts."""
    return [msgspec.msgpack.encode(HolderQuery(VERSION, ["part/kitchen", "world/belief_1/3"]))]


def holder_answers() -> list[bytes]:
    """Their answers."""
    return [msgspec.msgpack.encode(HoldersAnswer(VERSION, "launcher-5f0c12aa", ["launcher-5f0c12aapkitchenq1", ""]))]
