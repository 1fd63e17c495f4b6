"""Cascaded graphs: one change passes through processes that each copy a graph into the next one.

Writer -> graph 0 -> copier -> graph 1 -> ... -> graph n -> reader. A copier holds two memories, follows the first by a
watch and repeats each change in the second, as a filter would. Changes are written one at a time; the time is from
before the write in graph 0 until a read in graph n gives the value. The peer is a chain of as many processes that
forward the bytes of one update from one raw Zenoh session to the next in the callback.
"""

from __future__ import annotations

import contextlib
import itertools
import threading
from collections.abc import Callable
from functools import partial
from multiprocessing.connection import Connection

import msgspec

import dsr
from benchmarks import workload
from benchmarks.group import Group, Run
from benchmarks.links import Closable, DsrLink, Link, Received, Sender
from benchmarks.pairs import Latencies
from benchmarks.peers.zenoh_link import ZenohLink, forward
from benchmarks.ports import reserved_endpoint
from benchmarks.rows import Peer, Spec
from benchmarks.timing import percentile, sleep
from benchmarks.workers import Worker, commands
from dsr.graph.watch import Change

_ABOUT = "1000 nodes x 5 attributes in each graph; peer: bytes forwarded in callbacks"
OF_PEER = 1.8
"""Target of a chain's median over that of raw Zenoh."""
SPECS = {
    graphs: Spec(
        f"one change through {graphs} cascaded graphs (a pass-through process each), p50",
        "ms",
        target,
        about=_ABOUT,
        of_peer=OF_PEER,
    )
    for graphs, target in ((1, 1.0), (5, 4.0), (10, 8.0), (20, 15.0))
}
_PERIOD = 0.06  # s between two changes: one at a time
_STARTING = 60.0  # s that a copier may wait for its neighbours, as many start at once
_Samples = dict[str, list[float]]
_OURS, _ZENOH = "ours", "raw Zenoh"


class _Ends(msgspec.Struct, frozen=True):
    """A link whose reader listens at another place than where the writer writes."""

    first: Link
    last: Link

    def writer(self) -> Sender:
        """The end before the first copier."""
        return self.first.writer()

    def reader(self, received: Received) -> Closable:
        """The end behind the last copier."""
        return self.last.reader(received)


def measure(run: Run) -> None:
    """Build chains of each length, ours and the peer's, and let them take turns."""
    curve: dict[str, list[float]] = {}
    for graphs, spec in SPECS.items():
        with contextlib.ExitStack() as stack:
            chains: dict[str, Latencies] = {}
            for name, (link, copy, places) in _routes(graphs).items():
                run.step(f"cascade: starting {graphs} processes, {name}")
                copiers = partial(_start_copiers, stack, copy, places)
                chains[name] = stack.enter_context(Latencies(link, copiers))
            samples = _take_turns(run, chains, graphs)
        medians = {name: percentile(found, 0.5) for name, found in samples.items()}
        run.row(spec, medians[_OURS], [Peer(_ZENOH, medians[_ZENOH])], f"p99 {percentile(samples[_OURS], 0.99):.1f} ms")
        for name, median in medians.items():
            curve.setdefault(name, []).append(median)
    run.curve("cascade", {"graphs": list(SPECS), "ms": curve})


_Copy = Callable[[Connection, str, str], None]
"""A copier's process, from the first to the second place."""


def _routes(graphs: int) -> dict[str, tuple[Link, _Copy, list[str]]]:
    """By name: a link, the copier's process, and the places from the first to the last."""
    names = [f"cascade-{graphs}-{index}" for index in range(graphs + 1)]
    ends = _Ends(DsrLink(names[0], "attribute"), DsrLink(names[-1], "attribute"))
    endpoints = [reserved_endpoint() for _ in names]
    size = workload.message_size(rt=False)
    zenoh = _Ends(ZenohLink(endpoints[0], size), ZenohLink(endpoints[-1], size))
    return {_OURS: (ends, _copy, names), _ZENOH: (zenoh, forward, endpoints)}


def _start_copiers(stack: contextlib.ExitStack, copy: _Copy, places: list[str]) -> None:
    """Start all of them, then wait until each has copied what is there already."""
    copiers = [stack.enter_context(Worker(copy, first, last)) for first, last in itertools.pairwise(places)]
    for copier in copiers:
        copier.receive()


def _take_turns(run: Run, chains: dict[str, Latencies], graphs: int) -> _Samples:
    rounds, count = run.pick(5, 1), run.pick(40, 20)
    samples: _Samples = {name: [] for name in chains}
    for chain in chains.values():
        chain.warm_up()
    for number in range(rounds):
        for name, chain in chains.items():
            run.step(f"cascade: {graphs} graphs, {name}, round {number + 1} of {rounds}")
            samples[name] += [seconds * 1e3 for seconds in chain.burst(count, period=_PERIOD)]
    return samples


def _copy(connection: Connection, first: str, last: str) -> None:
    """Repeat every change of the nodes of graph `first` in graph `last`; say so when the content is complete."""
    connect = partial(dsr.connect, agent="copier", timeout=_STARTING)
    with connect(last) as target, connect(first) as source:
        threading.Thread(target=_follow, args=(source, target), daemon=True).start()
        while len(target.nodes()) <= workload.NODES:
            sleep(0.01)
        connection.send("ready")
        for _ in commands(connection):
            pass


def _follow(source: dsr.Memory, target: dsr.Memory) -> None:
    for change in source.watch():
        if change.element == "node":
            _repeat(change, source.node(change.name), target)


def _repeat(change: Change, node: dsr.Node, target: dsr.Memory) -> None:
    if change.kind == "added":
        target.add_node(node.name, node.type, **node)
    else:
        target.update_node(node.name, **{attribute: node[attribute] for attribute in change.attributes})


GROUP = Group("cascade", list(SPECS.values()), measure)
