"""Saturated updates: the writer writes as fast as it can; what readers have merged is counted, not what was written.

Each write sets one attribute of one node (or the pose of one edge) of 1000 x 5, the next one each time. Of writes to
the same attribute that wait to be sent, the memory sends the last one only: the notes tell how many were left out. The
peers send one message of the same size for each update and decode nothing; pycrdt and Loro export each update and
import it into another document of the same process.
"""

from __future__ import annotations

import contextlib
import statistics
from collections.abc import Iterator
from multiprocessing.connection import Connection
from typing import NamedTuple

from benchmarks import workload
from benchmarks.group import Group, Run
from benchmarks.links import DsrLink, Link
from benchmarks.peers import documents
from benchmarks.peers.tcp_link import TcpLink
from benchmarks.peers.zenoh_link import ZenohLink
from benchmarks.ports import reserved_endpoint, reserved_port
from benchmarks.rows import Peer, Spec, number
from benchmarks.timing import monotonic, rate, sleep
from benchmarks.workers import Worker, commands

_ABOUT = "register changes applied in each reader; peers: messages of the same size"
_ONE, _EACH = "one reader", "each of three readers"


def _spec(what: str, target: float, of_peer: float) -> Spec:
    return Spec(f"saturated updates delivered and merged, {what}", "per s", target, "higher", _ABOUT, of_peer)


ATTRIBUTES, RT = _spec(f"attributes, {_ONE}", 100_000, 2.0), _spec(f"RT, {_ONE}", 100_000, 2.0)
ATTRIBUTES_3, RT_3 = _spec(f"attributes, {_EACH}", 60_000, 6.0), _spec(f"RT, {_EACH}", 60_000, 5.0)
SPECS = (ATTRIBUTES, RT, ATTRIBUTES_3, RT_3)
_WARM_UP = 1.0  # s


class _Flow(NamedTuple):
    """What came out of one period at full speed."""

    written: float
    """Per second, all the time."""
    delivered: float
    """Per second to the slowest reader, in the middle of the period."""
    left_out: float
    """The share of all writes that never came, as a later one replaced them."""


def measure(run: Run) -> None:
    """One reader, then three."""
    merged = [Peer(f"{other.name}, no network", _replication(run, other)) for other in documents.replicated(run)]
    for readers, attributes, rt in ((1, ATTRIBUTES, RT), (3, ATTRIBUTES_3, RT_3)):
        flows = _flows(run, readers)
        peers = [Peer(name, flow.delivered) for name, flow in flows.items() if name not in ("attributes", "RT")]
        for name, spec in (("attributes", attributes), ("RT", rt)):
            flow = flows[name]
            note = f"{number(flow.written)} per s written, {flow.left_out:.0%} of them replaced before they were sent"
            run.row(spec, flow.delivered, [*peers, *(merged if readers == 1 else ())], note)
        run.curve(f"throughput to {readers}", {name: flow.delivered for name, flow in flows.items()})


def _replication(run: Run, document: documents.Replicated) -> float:
    run.step(f"throughput: {document.name}")
    return rate(document.replicate, workload.NODES, run.pick(9, 2))


def _flows(run: Run, readers: int) -> dict[str, _Flow]:
    """The median over rounds in which all links take turns, by link."""
    rounds, seconds = run.pick(5, 1), run.pick(3.0, 1.0)
    with contextlib.ExitStack() as stack:
        crowds: dict[str, _Crowd] = {}
        for name, link in _links(run):
            run.step(f"throughput: starting {name}, {readers} reader(s)")
            crowds[name] = stack.enter_context(_Crowd(link, readers))
        flows: dict[str, list[_Flow]] = {name: [] for name in crowds}
        for number_ in range(rounds):
            for name, crowd in crowds.items():
                run.step(f"throughput: {name}, {readers} reader(s), round {number_ + 1} of {rounds}")
                flows[name].append(crowd.saturate(seconds))
    return {name: _Flow(*map(statistics.median, zip(*found, strict=True))) for name, found in flows.items()}


def _links(run: Run) -> Iterator[tuple[str, Link]]:
    size = workload.message_size(rt=False)
    yield "attributes", DsrLink("saturated-attributes", "any attribute")
    yield "RT", DsrLink("saturated-rt", "RT")
    yield "raw Zenoh", ZenohLink(reserved_endpoint(), size)
    yield "raw TCP", TcpLink(reserved_port(), size)
    if run.has("zmq"):
        from benchmarks.peers.zmq_link import ZmqLink

        yield "ZeroMQ", ZmqLink(reserved_port(), size)


class _Crowd(contextlib.ExitStack):
    """A writer and several readers of a link."""

    def __init__(self, link: Link, readers: int) -> None:
        super().__init__()
        try:
            self._writer = self.enter_context(Worker(_write, link))
            self._writer.receive()
            self._readers = [self.enter_context(Worker(_count, link)) for _ in range(readers)]
            for reader in self._readers:
                reader.receive()
        except BaseException:
            self.close()
            raise

    def saturate(self, seconds: float) -> _Flow:
        """Write at full speed; count for `seconds`, after a warm-up."""
        first = self._counts()
        self._writer.send(seconds + 2 * _WARM_UP)
        sleep(_WARM_UP)
        before = self._counts()
        sleep(seconds)
        after = self._counts()
        written, taken = self._writer.receive()
        sleep(_WARM_UP)  # for what is still on its way
        last = self._counts()
        rates = [(b[0] - a[0]) / (b[1] - a[1]) for a, b in zip(before, after, strict=True)]
        arrived = min(b[0] - a[0] for a, b in zip(first, last, strict=True))
        return _Flow(written / taken, min(rates), max(0.0, 1 - arrived / written))

    def _counts(self) -> list[tuple[int, float]]:
        for reader in self._readers:
            reader.send(None)
        return [reader.receive() for reader in self._readers]


def _write(connection: Connection, link: Link) -> None:
    """Write for as many seconds as asked for; answer with how many and how long it took, s."""
    writer = link.writer()
    connection.send("ready")
    written = 0
    for seconds in commands(connection):
        first, start = written, monotonic()
        while monotonic() < start + seconds:
            for _ in range(20):
                written += 1
                writer.send(written)
        connection.send((written - first, monotonic() - start))
    writer.close()


def _count(connection: Connection, link: Link) -> None:
    """Answer how many messages have been received, and when that was so."""
    count = 0

    def received(_number: int) -> None:
        nonlocal count
        count += 1

    reader = link.reader(received)
    connection.send("ready")
    for _ in commands(connection):
        connection.send((count, monotonic()))
    reader.close()


GROUP = Group("throughput", SPECS, measure)
