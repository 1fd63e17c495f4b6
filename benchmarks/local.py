"""Local reads and writes, a call at a time, beside Spark-DSG, pycrdt and Loro.

The memory is connected and alone in its graph, as that of a user is who starts first: its sending thread encodes and
publishes what is written, and nobody receives it. The notes tell the same without threads and network.
"""

from __future__ import annotations

import gc
import itertools
import statistics
from collections.abc import Callable, Iterator
from functools import partial

import dsr
from benchmarks import workload
from benchmarks.group import Group, Run
from benchmarks.peers import documents
from benchmarks.rows import Peer, Spec, number
from benchmarks.timing import duration, rate
from dsr import Memory

_COUNT = workload.NODES
_OURS, _ALONE = "ours", "ours, without threads and network"
_OF_SPARK = 0.8
"""Target of the rate of writes over that of Spark-DSG, which merges nothing."""
_INSERT = "1000 nodes with 5 attributes each; so do the peers"
INSERT = Spec("local insert node", "per s", 100_000, "higher", _INSERT, _OF_SPARK)
BARE = Spec("local insert node without attributes", "per s", None, "higher", "as the row above, nodes only")
_UPDATE = "one attribute a call; peers: one a transaction"
UPDATE = Spec("local update attribute", "per s", 200_000, "higher", _UPDATE, _OF_SPARK)
_RT = "one pose a call; the poses exist before; peers: an attribute"
RT = Spec("local update RT", "per s", 150_000, "higher", _RT, _OF_SPARK)
GET_NODE = Spec("local get node", "per s", 1_000_000, "higher", "memory.node(name)")
GET_EDGE = Spec("local get edge", "per s", 1_000_000, "higher", "memory.edge(src, dst, 'RT')")
SPECS = (INSERT, BARE, UPDATE, RT, GET_NODE, GET_EDGE)


def measure(run: Run) -> None:
    """Measure each operation with and without a network, and of the peers; all take turns."""
    turns, runs = run.pick(7, 1), 3
    connected, alone = _operations(_Ours(_connected, runs)), _operations(_Ours(workload.local_memory, runs))
    others = documents.installed(run)
    for spec in SPECS:
        run.step(spec.row)
        ways = {_OURS: connected[spec], _ALONE: alone[spec]}
        ways |= {other.name: partial(_peer_rate, loop, runs) for other in others if (loop := _loop(other, spec))}
        speeds = {name: statistics.median(speed) for name, speed in _in_turns(ways, turns).items()}
        ours, bare = speeds.pop(_OURS), speeds.pop(_ALONE)
        peers = [Peer(name, speed) for name, speed in speeds.items()]
        run.row(spec, ours, peers, f"{number(bare)} per s without threads and network")


def _in_turns(ways: dict[str, Callable[[], float]], turns: int) -> dict[str, list[float]]:
    found: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(turns):
        for name, way in ways.items():
            found[name].append(way())
    return found


def _operations(ours: _Ours) -> dict[Spec, Callable[[], float]]:
    return {
        INSERT: ours.insert,
        BARE: ours.insert_bare,
        UPDATE: ours.update,
        RT: ours.update_rt,
        GET_NODE: ours.get_node,
        GET_EDGE: ours.get_edge,
    }


def _connected() -> Memory:
    return dsr.connect("local", agent="local")


class _Ours:
    """The operations on memories that `make` gives; each returns calls per second."""

    def __init__(self, make: Callable[[], Memory], runs: int) -> None:
        self._make = make
        self._runs = runs

    def insert(self) -> float:
        values = [workload.attributes(index) for index in range(_COUNT)]

        def loop(memory: Memory) -> None:
            for index, attributes in enumerate(values):
                memory.add_node(workload.name(index), workload.TYPE, **attributes)

        return self._growing(loop)

    def insert_bare(self) -> float:
        def loop(memory: Memory) -> None:
            for index in range(_COUNT):
                memory.add_node(workload.name(index), workload.TYPE)

        return self._growing(loop)

    def update(self) -> float:
        values = [list(itertools.islice(changes, _COUNT)) for changes in [workload.changes()] for _ in range(5)]
        rounds = itertools.cycle(values)

        def loop(memory: Memory) -> None:
            for name, attributes in next(rounds):
                memory.update_node(name, **attributes)

        return self._steady(loop)

    def update_rt(self) -> float:
        stamps = itertools.count(2)

        def poses() -> Iterator[dsr.Pose]:
            return (workload.pose(index, float(stamp)) for stamp in [next(stamps)] for index in range(_COUNT))

        ready = iter([list(poses()) for _ in range(self._runs + 1)])
        names = [workload.name(index) for index in range(_COUNT)]

        def loop(memory: Memory) -> None:
            for name, pose in zip(names, next(ready), strict=True):
                memory.update_edge("world", name, "RT", pose=pose)

        return self._steady(loop)

    def get_node(self) -> float:
        names = [workload.name(index) for index in range(_COUNT)]

        def loop(memory: Memory) -> None:
            for name in names:
                memory.node(name)

        return self._steady(loop)

    def get_edge(self) -> float:
        names = [workload.name(index) for index in range(_COUNT)]

        def loop(memory: Memory) -> None:
            for name in names:
                memory.edge("world", name, "RT")

        return self._steady(loop)

    def _steady(self, loop: Callable[[Memory], None]) -> float:
        """Calls per second on a memory that has the content."""
        with self._make() as memory:
            workload.fill(memory)
            memory.flush()
            return rate(lambda: loop(memory), _COUNT, self._runs)

    def _growing(self, loop: Callable[[Memory], None]) -> float:
        """Calls per second on new memories, which grow from nothing to 1000 nodes."""
        seconds = []
        for _ in range(self._runs):
            with self._make() as memory:
                seconds.append(duration(partial(loop, memory)))
        return _COUNT / statistics.median(seconds)


def _loop(peer: documents.Document, spec: Spec) -> Callable[[], None] | None:
    """What a peer does for a row; for RT, which no peer has, its update of an attribute; None if there is nothing."""
    return {
        INSERT: peer.insert, BARE: peer.insert_bare, UPDATE: peer.update, RT: peer.update, GET_NODE: peer.get_node,
    }.get(spec)  # fmt: skip


def _peer_rate(loop: Callable[[], None], runs: int) -> float:
    """Calls per second of a peer."""
    gc.collect()
    return rate(loop, _COUNT, runs)


GROUP = Group("local", SPECS, measure)
