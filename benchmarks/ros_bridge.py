"""Measures the bridge to ROS as a process: what tf costs each way, and how soon a transform is an edge.

Three processes: a node of ROS with the router, the bridge, and a memory of the same graph. The bridge's processor time
counts with all its threads. Its peer does without ROS what the memory asks of the bridge: a memory writes the
same edges as often, or hears them. What comes on top is the bridge's own.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.connection import Connection
from statistics import median
from time import process_time  # CPU time is what is measured here
from typing import NamedTuple

import msgspec

import dsr
from agents.ros_bridge import RosBridge
from agents.ros_bridge.link.link import LinkConfig, Qos, Topic
from agents.ros_bridge.link.link import Received as Message
from agents.ros_bridge.link.opening import open_link
from agents.ros_bridge.mapping.transforms import to_stamped
from agents.ros_bridge.messages.transforms import TF_MESSAGE, decode_transforms, encode_transforms
from benchmarks.group import Run
from benchmarks.links import Closable, Received, Sender
from benchmarks.observer import on_each_change
from benchmarks.pairs import Latencies
from benchmarks.peers.zenoh_link import ZenohLink, forward, open_router
from benchmarks.ports import reserved_endpoint
from benchmarks.ros_links import EDGE, TF_IN, TF_OUT
from benchmarks.rows import Peer, Spec
from benchmarks.timing import monotonic, percentile, sleep_until
from benchmarks.workers import BenchmarkError, Worker, all_of, commands
from dsr import Pose
from dsr.clock import WALL_CLOCK
from dsr.graph.elements import Edge, Node
from dsr.runtime.agent_process import StopSignal, run_agent

_FRAMES, _HZ = 100, 100.0
_WRITTEN_HZ = 50.0
"""Hz at which the bridge writes an edge at most, by default"""
_PERIOD = 1 / 40
"""s between two transforms whose way is timed: below what the bridge writes at most"""
_PARENT = "base"
_NAMES = [f"robot/link_{number}" for number in range(_FRAMES)]
_NODES = [name.replace("/", ".") for name in _NAMES]
_WARM = 2.0
"""s of load before it is measured"""
_BASE = "ros-base"
"""Graph of the peers, without ROS"""
_SHARE = 0.5
"""of what was sent, that must have arrived: so that nothing is measured that does not work"""


def _pose(number: int, stamp: float) -> Pose:
    return Pose.unchecked((float(number), 0.2, 0.3), (0.0, 0.0, 0.6, 0.8), stamp)


# ---- the processes


def bridge(connection: Connection, endpoint: str, graph: str) -> None:
    """Run the bridge; answers with the processor time (s) that this process has taken."""
    stop = StopSignal()
    thread = threading.Thread(target=_run_bridge, args=(endpoint, graph, stop))
    thread.start()
    connection.send("ready")
    for _ in commands(connection):
        connection.send(process_time())
    stop.set()
    thread.join()


def _run_bridge(endpoint: str, graph: str, stop: StopSignal) -> None:
    config = {"link": {"router": endpoint}}
    run_agent(RosBridge, graph=graph, name="ros_bridge", config=config, router=None, seed=0, stop=stop)


class _Robot:
    """A node of ROS, and the router; counts the transforms that others send once it listens."""

    def __init__(self, endpoint: str) -> None:
        self._router = open_router(endpoint)
        self._link = open_link(LinkConfig(router=endpoint), "/robot")
        self._publisher = self._link.publisher(Topic("/tf", TF_MESSAGE, Qos(depth=100)))
        self._listens, self._heard = False, 0

    def listen(self) -> int:
        """How many transforms others sent since the first call."""
        if not self._listens:
            self._listens = True
            self._link.subscribe(Topic("/tf", TF_MESSAGE, Qos(depth=100)), self._count)
        return self._heard

    def _count(self, message: Message) -> None:
        self._heard += len(decode_transforms(message.cdr))

    def send(self, number: int) -> None:
        """Send the transform of one frame."""
        self.send_all(number, _NAMES[:1])

    def send_all(self, number: int, names: Sequence[str] = _NAMES) -> None:
        """Send a message with a transform of each of these frames, all stamped now."""
        pose, now = _pose(number, 0.0), WALL_CLOCK.now()
        self._publisher.send(encode_transforms([to_stamped(_PARENT, name, now, pose) for name in names]))

    def close(self) -> None:
        self._link.close()
        self._router.close()  # type: ignore[no-untyped-call]


def robot(connection: Connection, endpoint: str) -> None:
    """Send tf for as many seconds as asked for, or count what comes, if asked to listen."""
    node = _Robot(endpoint)
    connection.send("ready")
    for task, seconds in commands(connection):
        if task == "tf":
            for number in _paced(seconds, _HZ):
                node.send_all(number)
        connection.send(node.listen() if task == "listen" else 0)
    node.close()


def memory(connection: Connection, graph: str) -> None:
    """Write edges for as many seconds and as often as asked for; answers with processor time (s) and changes seen."""
    with dsr.connect(graph, agent="memory") as here:
        seen = [0]

        def count(_element: Node | Edge, attribute: str | None) -> None:
            seen[0] += attribute == "pose"

        on_each_change(here, count)
        connection.send("ready")
        for seconds, hz in commands(connection):
            if seconds:
                _write_edges(here, seconds, hz)
            connection.send((process_time(), seen[0]))


def _write_edges(here: dsr.Memory, seconds: float, hz: float) -> None:
    for name in (_PARENT, *_NODES):
        if name not in here:
            here.add_node(name, "body")
    for number in _paced(seconds, hz):
        pose = _pose(number, here.clock.now())
        with here.batch():
            for name in _NODES:
                here.add_edge(_PARENT, name, "RT", pose=pose)


def _paced(seconds: float, hz: float) -> Iterator[int]:
    begin = monotonic()
    for number in range(1, round(seconds * hz) + 1):
        yield number
        sleep_until(begin + number / hz)


# ---- processor time


class _Side(NamedTuple):
    """A process that is measured, and what loads it meanwhile."""

    work: Callable[[], float]
    """S, its processor time until now"""
    load: Callable[[], object]

    def cores(self) -> float:
        """The share of a core that the process takes under this load."""
        begin, before = monotonic(), self.work()
        self.load()
        return (self.work() - before) / (monotonic() - begin)


def _measure_cores(run: Run, spec: Spec, *, into_memory: bool) -> None:
    """Tf one way: the bridge and its peer in turns."""
    seconds, rounds = run.pick(5.0, 2.0), run.pick(4, 2)
    endpoint, graph = reserved_endpoint(), f"ros-{'in' if into_memory else 'out'}"
    starts: list[tuple[Callable[..., None], list[str]]] = [
        (robot, [endpoint]), (bridge, [endpoint, graph]), (memory, [graph]), (memory, [_BASE]), (memory, [_BASE])
    ]  # fmt: skip
    with all_of(Worker(main, *arguments) for main, arguments in starts) as workers:
        run.step(f"{spec.row}: starting")
        for worker in workers:
            worker.receive()
        node, bridging, *memories = workers
        other, writer, reader = (_Memory(worker) for worker in memories)
        rate = _WRITTEN_HZ if into_memory else _HZ

        def source(time: float) -> None:
            if into_memory:
                node.ask(("tf", time))
            else:
                other.write(time, _HZ)

        def came() -> int:
            return other.seen if into_memory else int(node.ask(("listen", 0.0)))

        came()
        source(_WARM)
        writer.write(_WARM, rate)
        measured, name = (writer, "writes") if into_memory else (reader, "hears")
        ours = _Side(lambda: float(bridging.ask("work")), lambda: source(seconds))
        peer = _Side(lambda: measured.work, lambda: writer.write(seconds, rate))
        before, taken, taken_by_peer = came(), [], []
        for number in range(rounds):
            run.step(f"{spec.row}: round {number + 1} of {rounds}")
            taken.append(ours.cores())
            taken_by_peer.append(peer.cores())
        hz = (came() - before) / (_FRAMES * seconds * rounds)
    if hz < _WRITTEN_HZ * _SHARE:
        raise BenchmarkError(f"only {hz:.0f} transforms a second of each frame went through")
    peers = [Peer(f"a memory that {name} the edges", median(taken_by_peer))]
    run.row(spec, median(taken), peers, f"{hz:.0f} Hz of each frame went through")


class _Memory:
    """A process that runs `memory`."""

    def __init__(self, worker: Worker) -> None:
        self._worker = worker

    @property
    def work(self) -> float:
        """S, its processor time until now."""
        return float(self._worker.ask((0.0, 1.0))[0])

    @property
    def seen(self) -> int:
        """Changes of poses that it has seen."""
        return int(self._worker.ask((0.0, 1.0))[1])

    def write(self, seconds: float, hz: float) -> None:
        """Let it write all edges, `hz` times a second."""
        self._worker.ask((seconds, hz))


# ---- latency


def write_heard(connection: Connection, endpoint: str, graph: str) -> None:
    """Write the edge that a bridge would write for each message of raw Zenoh, in the thread that hears it."""
    with dsr.connect(graph, agent="memory") as here:
        for name in (_PARENT, _NODES[0]):
            here.add_node(name, "body")

        def write(number: int) -> None:
            here.add_edge(_PARENT, _NODES[0], "RT", pose=_pose(number, here.clock.now()))

        heard = ZenohLink(endpoint, 0).reader(write)
        connection.send("ready")
        for _ in commands(connection):
            pass
        heard.close()


class WrittenLink(msgspec.Struct, frozen=True):
    """From raw Zenoh to a memory in another process than the one that writes what raw Zenoh brings."""

    endpoint: str
    graph: str
    size: int

    def writer(self) -> Sender:
        """The end that the writing process hears."""
        return ZenohLink(self.endpoint, self.size, reliable=False).writer()

    def reader(self, received: Received) -> Closable:
        """A memory that reads the edge as soon as it changes."""
        return _edge_reader(self.graph, received)


class BridgeLink(msgspec.Struct, frozen=True):
    """From a node of ROS, which has the router, to a memory in another process than the bridge's."""

    endpoint: str
    graph: str

    def writer(self) -> Sender:
        """The node of ROS."""
        return _Robot(self.endpoint)

    def reader(self, received: Received) -> Closable:
        """A memory that reads each edge as soon as it changes."""
        return _edge_reader(self.graph, received)


def _edge_reader(graph: str, received: Received) -> Closable:
    here = dsr.connect(graph, agent="reader")

    def read(element: Node | Edge, attribute: str | None) -> None:
        if isinstance(element, Edge) and attribute == "pose":
            received(int(element.pose.t[0]))

    on_each_change(here, read)
    return here


def _measure_latency(run: Run) -> None:
    """From tf to an edge in another process; beside it raw Zenoh through a third process, and a memory without ROS."""
    rounds, count = run.pick(8, 3), run.pick(80, 40)
    first, last, router, heard = (reserved_endpoint() for _ in range(4))
    link = BridgeLink(router, "ros-edge")
    taken: dict[str, list[float]] = {"ours": [], "raw": [], "written": []}
    with contextlib.ExitStack() as stack:

        def start(main: Callable[..., None], *arguments: str) -> None:
            stack.enter_context(Worker(main, *arguments)).receive()

        run.step(f"{EDGE.row}: starting")
        size = len(encode_transforms([to_stamped(_PARENT, _NAMES[0], 0.0, _pose(0, 0.0))]))
        pairs = {
            "ours": stack.enter_context(Latencies(link, lambda: start(bridge, link.endpoint, link.graph))),
            "raw": stack.enter_context(Latencies(RelayedLink(first, last, size), lambda: start(forward, first, last))),
            "written": stack.enter_context(
                Latencies(WrittenLink(heard, "ros-written", size), lambda: start(write_heard, heard, "ros-written"))
            ),
        }
        for pair in pairs.values():
            pair.warm_up()
        for number in range(rounds):
            for name, pair in pairs.items():
                run.step(f"{EDGE.row}: {name}, round {number + 1} of {rounds}")
                taken[name] += [seconds * 1e3 for seconds in pair.burst(count, period=_PERIOD)]
    ours, raw, written = (percentile(taken[name], 0.5) for name in ("ours", "raw", "written"))
    note = f"{size} bytes; {ours:.2f} ms, raw {raw:.2f} ms; {len(taken['ours'])} samples"
    peers = [
        Peer("raw Zenoh, forwarded by a third process", 1.0),
        Peer("a third process that writes the edge for each message of raw Zenoh", written / raw),
    ]
    run.row(EDGE, ours / raw, peers, note)


class RelayedLink(msgspec.Struct, frozen=True):
    """Raw Zenoh by way of a process that forwards."""

    first: str
    last: str
    size: int

    def writer(self) -> Sender:
        """The end that the forwarding process hears."""
        return ZenohLink(self.first, self.size, reliable=False).writer()

    def reader(self, received: Received) -> Closable:
        """An end that hears the forwarding process."""
        return ZenohLink(self.last, self.size, reliable=False).reader(received)


def measure(run: Run) -> None:
    """Measure tf in, tf out, then latencies."""
    _measure_cores(run, TF_IN, into_memory=True)
    _measure_cores(run, TF_OUT, into_memory=False)
    _measure_latency(run)
