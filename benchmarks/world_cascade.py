"""Cascaded worlds, as in Fig. 2 of the Underworlds paper: one node is created in the first and goes through all others.

Writer -> world 1 -> filter -> world 2 -> ... -> world n -> reader. Between two worlds stands a
`agents.filters.pass_through` as it is, a process of its own with the life cycle of an agent; all belong to one
system and know each other.
Nodes are created one at a time; the time is from before the creation in world 1 until a read in world n gives the node.
The peer are as many processes, likewise connected, that forward the bytes of one such change from key to key in the
callback of raw Zenoh.
"""

from __future__ import annotations

import contextlib
import threading
from functools import partial
from multiprocessing.connection import Connection

import msgspec

import dsr
from agents.filters.pass_through import PassThrough
from benchmarks import workload
from benchmarks.cascade import OF_PEER
from benchmarks.group import Group, Run
from benchmarks.links import Closable, Received, Sender
from benchmarks.observer import on_each_change
from benchmarks.pairs import Latencies
from benchmarks.peers.zenoh_mesh import ZenohMesh
from benchmarks.ports import reserved_endpoint
from benchmarks.rows import Peer, Spec
from benchmarks.timing import percentile, sleep
from benchmarks.workers import Worker, all_of, commands
from dsr.errors import DsrError
from dsr.runtime.agent_process import StopSignal, run_agent

NODES = 100
_ABOUT = f"{NODES} nodes x 5 attributes in each world; peer: bytes of a change forwarded in callbacks"
SPECS = {
    worlds: Spec(
        f"one node created, through {worlds} cascaded worlds, p50", "ms", target, about=_ABOUT, of_peer=OF_PEER
    )
    for worlds, target in ((1, 1.0), (2, 2.0), (5, 4.0), (10, 8.0), (20, 15.0))
}
PUBLISHED = {1: 3.6, 2: 10.7, 5: 31.0, 10: 66.0, 20: 117.0}
"""ms, Underworlds: Fig. 2 of Lemaignan et al., IROS 2018, on a machine with 8 cores."""
_PERIOD = 0.06  # s between two changes: one at a time
_PREFIX = "change_"
_OURS, _ZENOH = "ours", "raw Zenoh"


class _Cascade(msgspec.Struct, frozen=True):
    """A link from the first world of a system to its last one."""

    graph: str
    worlds: tuple[str, ...]

    def writer(self) -> Sender:
        """The process that makes the first world and what is in it."""
        return _Creator(dsr.connect(self.graph, agent="writer"), self.worlds[0])

    def reader(self, received: Received) -> Closable:
        """A process that has the last world, complete."""
        memory = dsr.connect(self.graph, agent="reader")
        world = _opened(memory, self.worlds[-1])
        while not workload.is_complete(world, NODES):
            sleep(0.01)

        def seen(element: dsr.Node | dsr.Edge, attribute: str | None) -> None:
            if attribute is None and isinstance(element, dsr.Node) and element.name.startswith(_PREFIX):
                received(world.node(element.name)["order"])

        on_each_change(world, seen)
        return memory


class _Creator:
    def __init__(self, memory: dsr.Memory, world: str) -> None:
        self._memory = memory
        self._world = memory.create_world(world)
        workload.fill(self._world, NODES)

    def send(self, number: int) -> None:
        self._world.add_node(f"{_PREFIX}{number}", workload.TYPE, order=number)

    def close(self) -> None:
        self._memory.close()


def measure(run: Run) -> None:
    """Build cascades of each length, ours and the peer's, and let them take turns."""
    curve: dict[str, list[float]] = {}
    for worlds, spec in SPECS.items():
        link = _Cascade(f"cascade-{worlds}", tuple(f"world_{index}" for index in range(worlds)))
        mesh = ZenohMesh(tuple(reserved_endpoint() for _ in range(worlds + 1)), _message_size())
        with contextlib.ExitStack() as stack:
            chains: dict[str, Latencies] = {}
            run.step(f"worlds: starting {worlds - 1} filters")
            chains[_OURS] = stack.enter_context(Latencies(link, partial(_start_filters, stack, link)))
            run.step(f"worlds: starting {worlds - 1} forwarders")
            chains[_ZENOH] = stack.enter_context(Latencies(mesh, partial(_start_forwarders, stack, mesh)))
            samples = _take_turns(run, chains, worlds)
        medians = {name: percentile(found, 0.5) for name, found in samples.items()}
        note = f"p99 {percentile(samples[_OURS], 0.99):.1f} ms; Underworlds, published: {PUBLISHED[worlds]:g} ms"
        run.row(spec, medians[_OURS], [Peer(_ZENOH, medians[_ZENOH])], note)
        for name, median in medians.items():
            curve.setdefault(name, []).append(median)
    curve["Underworlds (published)"] = list(PUBLISHED.values())
    run.curve("world cascade", {"worlds": list(SPECS), "ms": curve})


def _start_filters(stack: contextlib.ExitStack, link: _Cascade) -> None:
    pairs = zip(link.worlds[:-1], link.worlds[1:], strict=True)
    _start(stack, [Worker(_filter, link.graph, first, last) for first, last in pairs])


def _start_forwarders(stack: contextlib.ExitStack, mesh: ZenohMesh) -> None:
    _start(stack, [Worker(mesh.forward, index) for index in range(1, len(mesh.endpoints) - 1)])


def _start(stack: contextlib.ExitStack, workers: list[Worker]) -> None:
    for worker in stack.enter_context(all_of(workers)):
        worker.receive()


def _filter(connection: Connection, graph: str, first: str, last: str) -> None:
    """The process of the filter between two worlds."""
    stop = StopSignal()
    threading.Thread(target=_stop_at_end, args=(connection, stop), daemon=True).start()
    connection.send("started")
    config = {"reads": [first], "writes": last}
    run_agent(PassThrough, graph=graph, name=f"to_{last}", config=config, router=None, seed=0, stop=stop)


def _stop_at_end(connection: Connection, stop: StopSignal) -> None:
    for _ in commands(connection):
        pass
    stop.set()


def _take_turns(run: Run, chains: dict[str, Latencies], worlds: int) -> dict[str, list[float]]:
    rounds, count = run.pick(5, 1), run.pick(40, 20)
    samples: dict[str, list[float]] = {name: [] for name in chains}
    for chain in chains.values():
        chain.warm_up()
    for number in range(rounds):
        for name, chain in chains.items():
            run.step(f"worlds: {worlds} worlds, {name}, round {number + 1} of {rounds}")
            samples[name] += [seconds * 1e3 for seconds in chain.burst(count, period=_PERIOD)]
    return samples


def _opened(memory: dsr.Memory, name: str) -> dsr.Memory:
    """The world, as soon as somebody has made it."""
    while True:
        with contextlib.suppress(DsrError):
            return memory.world(name)
        sleep(0.05)


def _message_size() -> int:
    """Bytes of the message that tells of a node that was created."""
    network = dsr.LocalNetwork(dsr.WallClock())
    sizes: list[int] = []
    network.connect("listener").subscribe("dsr/**", lambda _key, payload: sizes.append(len(payload)))
    memory = workload.local_memory("writer-process", network)
    memory.add_node(f"{_PREFIX}1000", workload.TYPE, order=1000)
    memory.flush()
    network.deliver()
    return sizes[-1]


GROUP = Group("world cascade", list(SPECS.values()), measure)
