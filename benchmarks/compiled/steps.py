"""Does the steps of the measured rows, by the memory as it is and by the prototype of a compiled core, in turns."""

from __future__ import annotations

import contextlib
import itertools
import statistics
import threading
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from time import process_time
from typing import Any

from benchmarks import workload
from benchmarks.compiled.building import new_core
from dsr.clock import WALL_CLOCK
from dsr.crdt.context import CausalContext
from dsr.crdt.pieces import all_pieces
from dsr.errors import TransportError
from dsr.memory import Memory
from dsr.network.local_transport import LocalNetwork
from dsr.replication.collector import collector_paused
from dsr.replication.piece_wire import decode_piece, encode_piece

_COUNT = workload.NODES
JOINED = 10_000
"""Nodes of the graph that a newcomer joins, and as many RT edges."""
PYTHON, SHELL, CORE = "Python", "core in the memory's methods", "core alone"
INSERT, UPDATE, RT = "insert a node with five attributes", "update an attribute", "update an RT edge"
SENT = "a change that waits is encoded"
RECEIVED = ("receive an attribute, until a watch is told", "receive a pose, until a watch is told")
JOIN = ("late join: the holder's pieces made and encoded", "late join: the newcomer's pieces decoded and joined")
LATE_JOIN = "late join"
"""What the steps begin with that are done once; all others are done 1000 times."""
Work = Callable[[], object]
Times = dict[str, dict[str, float]]
"""Processor time, s, by step and by who does it: medians of rounds."""


class _Shell:
    """The methods of a memory with the core in the place of its graph: what `Memory` does for each write."""

    def __init__(self, core: Any) -> None:
        self._core = core
        self._lock = threading.RLock()
        self._closed = False
        self._holds = 0
        self._condition = threading.Condition(threading.RLock())

    def _check_write(self) -> None:
        if self._closed:
            raise TransportError("closed")

    def _send_soon(self) -> None:
        if self._holds:
            raise AssertionError("nothing is held together here")

    def add_node(self, name: str, type: str, /, **attributes: Any) -> None:
        """See `Memory.add_node`."""
        with self._lock:
            self._check_write()
            self._core.add_node(name, type, attributes, WALL_CLOCK.now())
        self._send_soon()

    def update_node(self, name: str, /, **attributes: Any) -> None:
        """See `Memory.update_node`."""
        with self._lock:
            self._check_write()
            self._core.write_node(name, attributes, WALL_CLOCK.now())
        self._send_soon()

    def update_edge(self, src: str, dst: str, type: str, /, **attributes: Any) -> None:
        """See `Memory.update_edge`."""
        with self._lock:
            self._check_write()
            self._core.write_edge(src, dst, type, attributes, WALL_CLOCK.now())
        self._send_soon()

    def receive(self, sender: str, payload: bytes) -> None:
        """See `Replica._receive`: the message is joined, and who waits at a watch is told."""
        with self._lock:
            waited = self._core.waits()
            self._core.receive(sender, payload, WALL_CLOCK.now())
        if not waited and self._core.waits():
            with self._condition:
                self._condition.notify()


def filled(file: Path | str, rid: str, nodes: int = _COUNT) -> Any:
    """The content of the benchmark in a core; its messages are taken."""
    core, now = new_core(file, rid), WALL_CLOCK.now()
    core.add_node("world", "world", {}, now)
    for index in range(nodes):
        core.add_node(workload.name(index), workload.TYPE, workload.attributes(index), now)
        core.add_edge("world", workload.name(index), "RT", {"pose": workload.pose(index)}, now)
    core.take()
    return core


def _updates(file: Path) -> Iterator[tuple[str, dict[str, Work]]]:
    """New nodes, updates, and the messages that come of them, one for each."""
    memory: Any
    shell: Any
    memory, core = workload.local_memory(), filled(file, "core")
    workload.fill(memory)
    memory.flush()
    fresh_memory, fresh, shell = workload.local_memory(), new_core(file, "new"), _Shell(new_core(file, "new-inside"))
    contents = [(workload.name(index), workload.attributes(index)) for index in range(_COUNT)]
    yield INSERT, {
        PYTHON: lambda: [fresh_memory.add_node(name, workload.TYPE, **values) for name, values in contents],
        SHELL: lambda: [shell.add_node(name, workload.TYPE, **values) for name, values in contents],
        CORE: lambda: [fresh.add_node(name, workload.TYPE, values, WALL_CLOCK.now()) for name, values in contents],
    }
    shell, changes = _Shell(filled(file, "inside")), list(itertools.islice(workload.changes(), _COUNT))
    yield UPDATE, {
        PYTHON: lambda: [memory.update_node(name, **values) for name, values in changes],
        SHELL: lambda: [shell.update_node(name, **values) for name, values in changes],
        CORE: lambda: [core.write_node(name, values, WALL_CLOCK.now()) for name, values in changes],
    }
    poses = [(workload.name(index), workload.pose(index, WALL_CLOCK.now() + 1.0)) for index in range(_COUNT)]
    yield RT, {
        PYTHON: lambda: [memory.update_edge("world", name, "RT", pose=pose) for name, pose in poses],
        SHELL: lambda: [shell.update_edge("world", name, "RT", pose=pose) for name, pose in poses],
        CORE: lambda: [core.write_edge("world", name, "RT", {"pose": pose}, WALL_CLOCK.now()) for name, pose in poses],
    }
    memory.flush()
    core.take()
    yield "read an attribute", {
        PYTHON: lambda: [memory.node(name)["order"] for name, _ in contents],
        CORE: lambda: [core.get_node(name, "order") for name, _ in contents],
    }
    yield "read a pose", {
        PYTHON: lambda: [memory.edge("world", name, "RT").pose for name, _ in contents],
        CORE: lambda: [core.get_edge("world", name, "RT", "pose") for name, _ in contents],
    }


class _Channel:
    """A memory that writes, one that has all of it and a watch, and a core that has all of it."""

    def __init__(self, file: Path) -> None:
        self._network = LocalNetwork(WALL_CLOCK)
        self.writer, self.reader = (workload.local_memory(agent, self._network) for agent in ("writer", "reader"))
        self.writer.replica.synchroniser.nobody_there()
        workload.fill(self.writer)
        self.writer.flush()
        while not self.reader.joined:
            self._network.deliver()
            for memory in (self.writer, self.reader):
                memory.poll()
        self.core, self.inside = new_core(file, "core"), new_core(file, "inside")
        for piece in self._pieces():
            for core in (self.core, self.inside):
                core.join_piece(piece, WALL_CLOCK.now())
        self.watch = self.reader.watch(existing=False)
        self.core.watch()
        self.inside.watch()
        self._messages: list[bytes] = []
        listener = self._network.connect("listener")
        for key in (self.writer.keys.delta(), self.writer.keys.stream()):
            listener.subscribe(key, lambda _key, payload: self._messages.append(payload))

    def _pieces(self) -> list[bytes]:
        return [encode_piece(piece) for piece in all_pieces(self.writer.replica.graph.store, CausalContext())]

    def sent(self, write: Callable[[int], object]) -> list[bytes]:
        """The messages of as many changes, one for each."""
        for number in range(_COUNT):
            write(number)
            self.writer.flush()
        self._network.deliver()
        taken, self._messages = self._messages, []
        return taken

    def received(self, payloads: list[bytes]) -> dict[str, Work]:
        """What each reader does with these messages, until a watch is told."""
        sync: Any
        shell: Any
        sync, rid, shell = self.reader.replica.synchroniser, self.writer.replica.graph.rid, _Shell(self.inside)
        return {
            PYTHON: lambda: [sync.receive_delta(rid, payload, WALL_CLOCK.now()) for payload in payloads],
            SHELL: lambda: [shell.receive(rid, payload) for payload in payloads],
            CORE: lambda: [self.core.receive(rid, payload, WALL_CLOCK.now()) for payload in payloads],
        }

    def forget(self) -> None:
        """Take the changes from the watches."""
        self.watch.poll()
        self.core.changes()
        self.inside.changes()


def _received(channel: _Channel, turn: int) -> Iterator[tuple[str, dict[str, Work]]]:
    attributes = channel.sent(lambda number: channel.writer.update_node(workload.name(number), order=turn + number))
    yield RECEIVED[0], channel.received(attributes)
    channel.forget()
    poses = channel.sent(
        lambda number: channel.writer.update_edge(
            "world", workload.name(number), "RT", pose=workload.pose(number, turn + 2.0)
        )
    )
    yield RECEIVED[1], channel.received(poses)
    channel.forget()


def _sent(file: Path, turn: int) -> Iterator[tuple[str, dict[str, Work]]]:
    """A change that waits is taken and encoded; what writes it is not part of that."""
    memory, core = workload.local_memory(), new_core(file, "core")
    memory.add_node("n", workload.TYPE)
    memory.flush()
    core.add_node("n", workload.TYPE, {}, WALL_CLOCK.now())
    core.take()
    yield SENT, {
        PYTHON: partial(_each_after, lambda n: memory.update_node("n", order=turn + n), memory.flush),
        CORE: partial(_each_after, lambda n: core.write_node("n", {"order": turn + n}, WALL_CLOCK.now()), core.take),
    }


def _each_after(write: Callable[[int], object], act: Work) -> float:
    """Processor time of `act` alone, s."""
    taken = 0.0
    for number in range(_COUNT):
        write(number)
        begin = process_time()
        act()
        taken += process_time() - begin
    return taken


def _joins(file: Path, holder: Memory, core_holder: Any) -> Iterator[tuple[str, dict[str, Work]]]:
    store, payloads = holder.replica.graph.store, core_holder.pieces()
    pieces = [encode_piece(piece) for piece in all_pieces(store, CausalContext())]
    newcomer, core = workload.local_memory().replica.graph, new_core(file, "newcomer")

    def join() -> None:
        for payload in pieces:
            newcomer.join(decode_piece(payload).as_delta(), WALL_CLOCK.now())

    yield JOIN[0], {
        PYTHON: lambda: [encode_piece(piece) for piece in all_pieces(store, CausalContext())],
        CORE: core_holder.pieces,
    }
    yield JOIN[1], {
        PYTHON: join,
        CORE: lambda: [core.join_piece(payload, WALL_CLOCK.now()) for payload in payloads],
    }
    yield "late join: each value of it read once", {
        PYTHON: lambda: [
            element[name]
            for elements in (newcomer.nodes, newcomer.edges)
            for element in elements.values()
            for name in element._entries[0].registers
        ],
        CORE: partial(_read_all, core),
    }


def _read_all(core: Any) -> None:
    for index in range(JOINED):
        name = workload.name(index)
        for attribute in workload.ATTRIBUTES:
            core.get_node(name, attribute)
        core.get_edge("world", name, "RT", "pose")


def _by_type(file: Path) -> Iterator[tuple[str, dict[str, Work]]]:
    memory, core, now = workload.local_memory(), new_core(file, "core"), WALL_CLOCK.now()
    for index in range(JOINED):
        type = "ball" if index % 10 == 0 else workload.TYPE
        memory.add_node(workload.name(index), type)
        core.add_node(workload.name(index), type, {}, now)
    yield "nodes by type, 1000 among 10 000", {
        PYTHON: lambda: [memory.nodes("ball") for _ in range(_COUNT)],
        CORE: lambda: [core.nodes("ball") for _ in range(_COUNT)],
    }


def measure(file: Path, rounds: int) -> Times:
    """All steps, in rounds in which all take turns."""
    found: dict[str, dict[str, list[float]]] = {}
    holder, core_holder = workload.local_memory("holder"), filled(file, "holder", JOINED)
    workload.fill(holder, JOINED)
    channel = _Channel(file)
    for turn in range(rounds):
        steps = (_updates(file), _sent(file, turn), _received(channel, turn * _COUNT),
                 _joins(file, holder, core_holder), _by_type(file))  # fmt: skip
        for step, works in itertools.chain.from_iterable(steps):
            for who, work in works.items():
                with collector_paused() if step.startswith(LATE_JOIN) else contextlib.nullcontext():
                    found.setdefault(step, {}).setdefault(who, []).append(_processor_time(work))
    return {
        step: {who: statistics.median(taken) for who, taken in times.items()} for step, times in found.items()
    }


def _processor_time(work: Work) -> float:
    begin = process_time()
    told = work()
    return told if isinstance(told, float) else process_time() - begin


def spark(rounds: int) -> dict[str, float]:
    """Processor time of as many inserts and updates of Spark-DSG, s, medians; nothing where it is not installed."""
    try:
        from benchmarks.peers.spark_document import SparkDocument
    except ImportError:
        return {}
    document = SparkDocument()
    works = {"insert": document.insert, "update": document.update}
    return {
        name: statistics.median(_processor_time(work) for _ in range(rounds)) for name, work in works.items()
    }
