"""Every decoder that bytes from the network or from a file can reach."""

from __future__ import annotations

import fcntl
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import msgpack

from agents.plant.messages import decode_arm_state, decode_command, decode_tag_readings
from agents.recorder.images import unpack
from agents.scenario.judge.judge import decode_truth
from benchmarks.fuzz import corpus
from benchmarks.fuzz.mutations import Dump, Load, Mutator, dump_frame, dump_json, load_frame, load_messagepack
from benchmarks.fuzz.tally import Tally, measured, write_file
from dsr.crdt.delta import Add, Delta, Write
from dsr.errors import DsrError, WireError
from dsr.geometry import Mesh
from dsr.geometry.messages import decode_ask, decode_offer
from dsr.graph.graph import Graph
from dsr.graph.schema import PART_RECORD
from dsr.images.blobs import decode_frame
from dsr.network.bulk import decode_descriptor
from dsr.network.decoding import decoded
from dsr.network.rendezvous import members
from dsr.parts.registry import PartInfo, node_name, read_record
from dsr.persistence.files import read_graph
from dsr.persistence.records import HEADER, append_record, read_records
from dsr.replication.holders import decode_answer as decode_holders_answer
from dsr.replication.holders import decode_query
from dsr.replication.piece_wire import decode_piece, decode_request
from dsr.replication.wire import decode_delta, decode_digest, encode_delta
from dsr.runtime.logs import decode_log
from dsr.runtime.status import decode_status
from dsr.vocabulary.scenario_start import decode_start
from dsr.vocabulary.what_if import decode_answer, decode_question

_LOOK_EVERY = 500
"""messages"""


@dataclass(frozen=True)
class Target:
    """A decoder, right messages for it, and its share of all messages."""

    name: str
    decode: Callable[[bytes], Any]
    messages: Sequence[bytes]
    share: float
    load: Load = load_messagepack
    dump: Dump = msgpack.packb


def targets(folder: Path) -> list[Target]:
    """All decoders; those of files get theirs in `folder`, where XDG_RUNTIME_DIR must be too."""
    return [
        Target("delta, reply", _delta, [*corpus.deltas(), *corpus.replies(), *corpus.part_deltas()], 8),
        Target("entry of a part", _part_record, corpus.part_records(), 0.5, json.loads, dump_json),
        Target("digest", decode_digest, corpus.digests(), 2),
        Target("request", decode_request, corpus.requests(), 2),
        Target("piece of a reply", decode_piece, [*corpus.pieces(), *corpus.part_pieces()], 4),
        Target("who holds what, query", decode_query, corpus.holder_queries(), 1),
        Target("who holds what, answer", decode_holders_answer, corpus.holder_answers(), 1),
        Target("camera frame", lambda frame: unpack(decode_frame(frame)), corpus.frames(), 3, load_frame, dump_frame),
        Target("frame descriptor", decode_descriptor, corpus.descriptors(), 1),
        Target("mesh request", decode_ask, corpus.mesh_requests(), 1),
        Target("mesh offer", decode_offer, corpus.mesh_offers(), 1),
        Target("mesh", Mesh.decode, corpus.meshes(), 1),
        Target("status", decode_status, corpus.statuses(), 1),
        Target("log record", decode_log, corpus.log_records(), 1),
        Target("arm state", decode_arm_state, corpus.arm_states(), 1),
        Target("arm command", lambda payload: decode_command(payload, corpus.JOINTS), corpus.commands(), 1),
        Target("tag readings", decode_tag_readings, corpus.tag_readings(), 1),
        Target("scenario start", decode_start, corpus.starts(), 0.5),
        Target("truth", decode_truth, corpus.truths(), 1),
        Target("what-if question", decode_question, corpus.questions(), 1),
        Target("what-if answer", decode_answer, corpus.answers(), 1),
        Target("endpoint file", _endpoint_reader(folder), corpus.endpoint_files(), 0.3),
        Target("graph file", lambda payload: read_graph(write_file(folder / "graph.json", payload)),
               corpus.graph_files(), 0.5, json.loads, dump_json),
        Target("state file", lambda payload: read_records(write_file(folder / "state", payload)),
               [_state_file(folder)], 0.3),
    ]  # fmt: skip


def fuzz_decoder(target: Target, messages: int, seed: int) -> Iterator[Tally]:
    """Expose a decoder to mutated messages; gives the tally now and then, and in the end."""
    tally, mutate = Tally(target.name), Mutator(target.messages, seed, target.load, target.dump)
    with measured(tally) as look:
        for number in range(messages):
            tally.expose(mutate(), target.decode, (DsrError,))
            if number % _LOOK_EVERY == 0:
                look()
                yield tally
    yield tally


def _delta(payload: bytes) -> Delta:
    """A delta that was accepted can be sent on, and says the same then."""
    delta = decode_delta(payload)
    delta.misfits = 0
    if decode_delta(encode_delta(delta)) != delta:
        raise AssertionError("an accepted delta changes when it is sent on")
    return delta


def _part_record(payload: bytes) -> PartInfo:
    """An entry in the list of parts, which is the value of an attribute. Raises `WireError` if it makes no sense."""
    graph = Graph("me-1")
    text = decoded(payload, "text", lambda given: given.decode())
    graph.join(Delta([Add(("a-1", 1), node_name("kitchen"), PART_RECORD)],
                     [Write(("a-1", 1), "record", 1, "a-1", ("a-1", 2), text)], [], [("a-1", 1, 2)]), 0.0)  # fmt: skip
    found = read_record(graph.nodes[node_name("kitchen")])
    if found is None:
        raise WireError("an entry that makes no sense")
    return found


def _endpoint_reader(folder: Path) -> Callable[[bytes], Any]:
    """Lets `members` read a file that a living process holds locked."""
    names = count()
    place = folder / "runtime" / "dsr" / "fuzz"
    place.mkdir(parents=True, exist_ok=True)
    file = (place / f"peer-{next(names)}.endpoint").open("wb", buffering=0)
    fcntl.flock(file, fcntl.LOCK_EX)

    def read(payload: bytes) -> Any:
        file.seek(0)
        file.truncate()
        file.write(payload)
        return members("fuzz")

    return read


def _state_file(folder: Path) -> bytes:
    """What a keeper of the state wrote."""
    path = folder / "good_state"
    with path.open("wb") as file:
        file.write(HEADER)
        for payload in corpus.deltas():
            append_record(file, payload)
    return path.read_bytes()
