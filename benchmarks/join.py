"""Late join: a new process connects to a graph that has content, until all of it is there.

The interpreter runs, and all that `dsr.connect` or the peer needs is imported before the clock starts. Raw Zenoh opens
a session in the same way and gets as many bytes as a snapshot of the graph has, by one query; the documents load the
same content from memory, without any network.
"""

from __future__ import annotations

import importlib
import statistics
from collections.abc import Callable
from multiprocessing.connection import Connection

import dsr
from benchmarks import workload
from benchmarks.group import Group, Run
from benchmarks.peers import documents, zenoh_query
from benchmarks.ports import reserved_endpoint
from benchmarks.rows import Peer, Spec
from benchmarks.timing import duration, monotonic, sleep
from benchmarks.workers import BenchmarkError, Worker, commands

_CONNECT = dsr.connect
"""Imported with this module: the package imports what it offers when that is first asked for."""
_ABOUT = "nodes with 5 attributes each; from dsr.connect to complete"
SPECS = {
    nodes: Spec(f"late join, {label} nodes", "ms", target, about=_ABOUT)
    for nodes, label, target in ((1000, "1000", 50.0), (10_000, "10 000", 300.0))
}
SPECS_WITH_EDGES = {
    nodes: Spec(f"late join, {label} nodes and as many RT edges", "ms", about=_ABOUT, of_peer=of_peer)
    for nodes, label, of_peer in ((1000, "1000", None), (10_000, "10 000", 15.0))
}
Join = Callable[[str, int], float]
"""Joins the graph of that name, or the endpoint, with as many nodes or bytes; how long that took, s."""


def measure(run: Run) -> None:
    """Small graphs, then large ones."""
    times: dict[str, dict[str, list[float]]] = {}
    for nodes, spec in SPECS.items():
        ours, zenoh = _joins(run, nodes, edges=False)
        peers = [Peer("raw Zenoh", statistics.median(zenoh) * 1e3)]
        for document in documents.installed(run):
            run.step(f"late join: {document.name}, {nodes} nodes")
            load = document.snapshot(nodes)
            seconds = statistics.median(duration(load) for _ in range(7))
            peers.append(Peer(f"{document.name}, no network", seconds * 1e3))
        run.row(spec, statistics.median(ours) * 1e3, peers, f"{len(ours)} joins, slowest {max(ours) * 1e3:.0f} ms")
        times[str(nodes)] = {"ours": ours, **{peer.name: [peer.value / 1e3] for peer in peers}}
    run.curve("join", times)
    for nodes, spec in SPECS_WITH_EDGES.items():
        ours, zenoh = _joins(run, nodes, edges=True)
        run.row(spec, statistics.median(ours) * 1e3, [Peer("raw Zenoh", statistics.median(zenoh) * 1e3)])


def _joins(run: Run, nodes: int, *, edges: bool) -> tuple[list[float], list[float]]:
    """How long joining takes for ours and for raw Zenoh, in turns, s."""
    graph = f"join-{nodes}{'-edges' if edges else ''}"
    ours: list[float] = []
    zenoh: list[float] = []
    with Worker(_hold, graph, nodes, edges) as holder:
        size = holder.receive()
        endpoint = reserved_endpoint()
        with Worker(zenoh_query.hold_bytes, endpoint, size) as bytes_holder:
            bytes_holder.receive()
            for number in range(run.pick(9, 5)):
                run.step(f"late join: {nodes} nodes, {number + 1}")
                ours.append(_newcomer(_join_with_edges if edges else _join, graph, nodes))
                zenoh.append(_newcomer(zenoh_query.fetch, endpoint, size))
    return ours, zenoh


def _newcomer(join: Join, place: str, amount: int) -> float:
    with Worker(_join_when_told, join, place, amount) as newcomer:
        newcomer.receive()
        sleep(0.3)  # let the start of the process be over
        return float(newcomer.ask("go"))


def _hold(connection: Connection, graph: str, nodes: int, edges: bool) -> None:
    """Hold the content; tell the size of its snapshot."""
    with dsr.connect(graph, agent="holder") as memory:
        workload.fill(memory, nodes, edges=edges)
        connection.send(len(memory.snapshot()))
        for _ in commands(connection):
            pass


def _join_when_told(connection: Connection, join: Join, place: str, amount: int) -> None:
    importlib.import_module("dsr.network.zenoh_transport")  # which `dsr.connect` does when it is first called
    connection.send("ready")
    for _ in commands(connection):
        connection.send(join(place, amount))


def _join_with_edges(graph: str, nodes: int) -> float:
    return _join(graph, nodes, edges=True)


def _join(graph: str, nodes: int, *, edges: bool = False) -> float:
    start = monotonic()
    with _CONNECT(graph, agent="newcomer") as memory:
        taken = monotonic() - start
        if not workload.is_complete(memory, nodes, edges=edges):
            raise BenchmarkError(f"joined with {len(memory.nodes())} of {nodes} nodes")
        return taken


GROUP = Group("join", [*SPECS.values(), *SPECS_WITH_EDGES.values()], measure)
