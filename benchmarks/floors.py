"""What the rows of `dsr bench` cost at least in Python: the same path with ever more of what a write needs.

    python -m benchmarks.floors --rounds 20

Each table begins with the peer of the rows and ends with the memory. Between them stand programs that do a part of the
work and keep no graph: none of them merges, orders or checks anything. All take turns, so that all are disturbed alike.
What one process does alone is told in processor time.
"""

from __future__ import annotations

import argparse
import itertools
import statistics
import threading
from collections.abc import Callable, Iterator
from functools import partial
from time import process_time
from typing import Any

from rich.console import Console
from rich.table import Table

from benchmarks import session, workload
from benchmarks.links import DsrLink, Link
from benchmarks.pairs import in_turns
from benchmarks.peers import zenoh_query
from benchmarks.peers.documents import Document
from benchmarks.peers.zenoh_link import ZenohLink
from benchmarks.peers.zenoh_ring import RingLink
from benchmarks.ports import reserved_endpoint
from benchmarks.rows import number
from benchmarks.workers import Worker
from dsr.clock import WALL_CLOCK
from dsr.crdt.context import CausalContext
from dsr.crdt.delta import Write
from dsr.crdt.pieces import all_pieces
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.network.local_transport import LocalNetwork
from dsr.replication.collector import collector_paused
from dsr.replication.piece_wire import decode_piece, encode_piece

_NODES = 10_000
Times = dict[str, list[float]]
"""s, by what was done."""


def one_way(rounds: int) -> Times:
    """One update between two processes."""
    size = workload.message_size(rt=False)
    links: dict[str, Link] = {
        "raw Zenoh, until the callback": ZenohLink(reserved_endpoint(), size),
        "and a thread takes it from a ring": RingLink(reserved_endpoint(), size),
        "and it is encoded, decoded, kept in a dictionary": RingLink(reserved_endpoint(), size, decoded=True),
        "the memory: attribute update": DsrLink("floor", "attribute"),
    }
    return in_turns(links, rounds)


class _Element:
    __slots__ = ("registers",)

    def __init__(self) -> None:
        self.registers: dict[str, Any] = {}


class _NoGraph:
    """Methods with the signature of `Memory.update_node` that do a part of its work."""

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._elements = {workload.name(index): _Element() for index in range(workload.NODES)}
        self._sent: list[Write] = []
        self._counter = 0

    def nothing(self, name: str, /, **attributes: Any) -> None:
        """The call alone."""

    def kept(self, name: str, /, **attributes: Any) -> None:
        """A lock, a lookup and an entry of a dictionary."""
        with self._lock:
            registers = self._elements[name].registers
            for attribute, value in attributes.items():
                registers[attribute] = value

    def stamped(self, name: str, /, **attributes: Any) -> None:
        """The entry is a write with a dot and a stamp beyond that of the last one, and is listed to be sent."""
        with self._lock:
            registers, tick = self._elements[name].registers, int(WALL_CLOCK.now() * 1e6) << 10
            for attribute, value in attributes.items():
                self._counter += 1
                last = registers.get(attribute)
                stamp = tick if last is None or last.stamp < tick else last.stamp + 1
                write = Write(("w", 1), attribute, stamp, "w", ("w", self._counter), value)
                registers[attribute] = write
                self._sent.append(write)

    def flush(self) -> None:
        """Forget what is listed."""
        self._sent = []


def updates(rounds: int) -> Times:
    """1000 updates of an attribute in one process, and 1000 of a pose."""
    memory, keeping, stamping = workload.local_memory(), _NoGraph(), _NoGraph()
    workload.fill(memory)
    changes = workload.changes()
    calls: dict[str, Callable[..., object]] = {
        "a method that does nothing": keeping.nothing,
        "and a lock, a lookup, an entry in a dictionary": keeping.kept,
        "and a write with its dot and stamp, listed to be sent": stamping.stamped,
        "the memory: update_node": memory.update_node,
    }
    times: Times = {}
    spark = _spark()
    for turn in range(rounds):
        if spark is not None:
            times.setdefault("Spark-DSG, get_node and a field", []).append(_processor_time(spark.update))
        values = list(itertools.islice(changes, workload.NODES))
        poses = [(workload.name(index), workload.pose(index, turn + 2.0)) for index in range(workload.NODES)]
        for name, call in calls.items():
            times.setdefault(name, []).append(_processor_time(partial(_apply, call, values)))
        times.setdefault("the memory: update_edge, a pose", []).append(
            _processor_time(partial(_place, memory, poses))
        )
        memory.flush()
        stamping.flush()
    return times


def _apply(call: Callable[..., object], values: list[tuple[str, dict[str, Any]]]) -> None:
    for name, attributes in values:
        call(name, **attributes)


def _place(memory: Memory, poses: list[tuple[str, Pose]]) -> None:
    for name, pose in poses:
        memory.update_edge("world", name, "RT", pose=pose)


def inserts(rounds: int) -> Times:
    """1000 new nodes with five attributes each."""
    values = [(workload.name(index), workload.attributes(index)) for index in range(workload.NODES)]
    times: Times = {}
    spark = _spark()
    for _ in range(rounds):
        if spark is not None:
            times.setdefault("Spark-DSG, add_node and five fields", []).append(_processor_time(spark.insert))
        memory = workload.local_memory()
        times.setdefault("the memory: add_node", []).append(_processor_time(partial(_insert, memory, values)))
    return times


def _insert(memory: Memory, values: list[tuple[str, dict[str, Any]]]) -> None:
    for name, attributes in values:
        memory.add_node(name, workload.TYPE, **attributes)


def _processor_time(work: Callable[[], object]) -> float:
    begin = process_time()
    work()
    return process_time() - begin


def _spark() -> Document | None:
    try:
        from benchmarks.peers.spark_document import SparkDocument
    except ImportError:
        return None
    return SparkDocument()


def late_join(rounds: int) -> Times:
    """10 000 nodes with five attributes and an RT edge each, in one process but for the peer."""
    network = LocalNetwork(WALL_CLOCK)
    memory = workload.local_memory("holder", network)
    memory.replica.synchroniser.nobody_there()
    workload.fill(memory, _NODES)
    payloads = [encode_piece(piece) for piece in all_pieces(memory.replica.graph.store, CausalContext())]
    size, endpoint, times = sum(map(len, payloads)), reserved_endpoint(), Times()
    with Worker(zenoh_query.hold_bytes, endpoint, size) as holder:
        holder.receive()
        for _ in range(rounds):
            times.setdefault("raw Zenoh, a session and as many bytes", []).append(zenoh_query.fetch(endpoint, size))
            for name, work in _steps(memory, payloads).items():
                with collector_paused():
                    times.setdefault(name, []).append(_processor_time(work))
            both = "both, with all else: checks, messages, garbage collection"
            times.setdefault(both, []).append(_processor_time(partial(_join_by_messages, memory, network)))
    return times


def _join_by_messages(holder: Memory, network: LocalNetwork) -> None:
    newcomer = workload.local_memory("newcomer", network)
    while not newcomer.joined:
        network.deliver()
        holder.poll()
        newcomer.poll()
    newcomer.close()


def _steps(memory: Memory, payloads: list[bytes]) -> dict[str, Callable[[], object]]:
    store = memory.replica.graph.store
    pieces = [decode_piece(payload) for payload in payloads]
    newcomer = workload.local_memory().replica.graph

    def join() -> None:
        for piece in pieces:
            newcomer.join(piece.as_delta(), WALL_CLOCK.now())

    return {
        "the holder: pieces made and encoded": lambda: [encode_piece(p) for p in all_pieces(store, CausalContext())],
        "the newcomer: pieces decoded and checked": lambda: [decode_piece(data) for data in payloads],
        "an entry in a dictionary for each decoded change": lambda: list(map(_kept, pieces)),
        "the newcomer: pieces joined into a graph": join,
    }


def _kept(piece: Any) -> dict[Any, Any]:
    kept: dict[Any, Any] = {add.dot: add for add in piece.adds}
    kept.update({(write.owner, write.attribute): write for write in piece.writes})
    return kept


def _tables(rounds: int) -> Iterator[Table]:
    for title, measure, per in (
        ("one update, one way", one_way, 1), ("one of 1000 local updates", updates, workload.NODES),
        ("one of 1000 nodes with five attributes", inserts, workload.NODES),
        ("late join, 10 000 nodes and as many RT edges", late_join, 1),
    ):  # fmt: skip
        times = measure(rounds)
        table = Table("", "us", "by the first", title=title, caption="medians of rounds")
        first = next(iter(times.values()))
        for name, taken in times.items():
            ratio = statistics.median(mine / theirs for mine, theirs in zip(taken, first, strict=True))
            table.add_row(name, number(statistics.median(taken) / per * 1e6), number(ratio))
        yield table


def main() -> None:
    """Measure and show."""
    parser = argparse.ArgumentParser(
        "python -m benchmarks.floors", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=20, help="in which all take turns (default: 20)")
    rounds = parser.parse_args().rounds
    with session.private_runtime():
        for table in _tables(rounds):
            Console().print(table)


if __name__ == "__main__":
    main()
