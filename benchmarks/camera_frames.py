"""Camera frames to five readers, each a process, beside raw Zenoh with its shared memory.

From before the call that sends until the reader has the arrays. Both take turns in short bursts. The peer sends as many
bytes, joined beforehand, and is done when its callback has them as `bytes`, the only way to see them in Python.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np

import dsr
from benchmarks.group import Group, Run
from benchmarks.links import Closable, Link, Received, Sender
from benchmarks.rows import Peer, Spec
from benchmarks.timing import monotonic, percentile, sleep, sleep_until
from benchmarks.workers import Worker, all_of, commands
from dsr.rendezvous import free_port

READERS = 5
_PERIOD = 1 / 30  # s
_COLD = 10
"""Frames at the start of a burst that do not count."""
_STREAM = "camera"
_ON_ITS_WAY = 0.3  # s
_WHAT = "RGB-D 640x480 at 30 Hz to five readers"
_ABOUT = "color uint8 and depth float32, from before put_frame until the reader has the arrays"
P50_RATIO = Spec(f"{_WHAT}, p50 over raw Zenoh shared memory", "x", 1.2, about=_ABOUT)
P99_RATIO = Spec(f"{_WHAT}, p99 over raw Zenoh shared memory", "x", about=_ABOUT)
P50 = Spec(f"{_WHAT}, p50", "ms", about=_ABOUT)
P99 = Spec(f"{_WHAT}, p99", "ms", about=_ABOUT)
COPIED = Spec(f"{_WHAT}, copied in a reader", "bytes per frame", 0.0, about="of arrays outside the sender's memory")
SPECS = (P50_RATIO, P99_RATIO, P50, P99, COPIED)
_OURS, _ZENOH = "ours", "raw Zenoh shared memory"


def frame(number: int) -> dsr.Frame:
    """A frame whose stamp is its number."""
    color = np.full((480, 640, 3), number % 256, np.uint8)
    return dsr.Frame(float(number), {"color": color, "depth": np.full((480, 640), 1.0, np.float32)}, {"fx": 615.0})


class FrameLink(msgspec.Struct, frozen=True):
    """A stream of frames of a working memory."""

    graph: str

    def writer(self) -> Sender:
        """The memory that sends."""
        return _FrameSender(self.graph)

    def reader(self, received: Received) -> Closable:
        """A memory with a thread that waits for frames."""
        memory = dsr.connect(self.graph, agent="reader")
        threading.Thread(target=_follow, args=(memory, received), daemon=True).start()
        return memory


class _FrameSender:
    def __init__(self, graph: str) -> None:
        self._memory = dsr.connect(graph, agent="writer")
        self._frame = frame(0)

    def send(self, number: int) -> None:
        self._memory.put_frame(_STREAM, msgspec.structs.replace(self._frame, stamp=float(number)))

    def close(self) -> None:
        self._memory.close()


def _follow(memory: dsr.Memory, received: Received) -> None:
    reader = memory.frames(_STREAM)
    while True:
        found = reader.wait(1.0)
        if found is not None:
            received(int(found.stamp))
            _copied.append(_outside(found))


_mappings: list[range] = []
"""Addresses of shared rings in this process, as last looked up."""
_copied: list[int] = []
"""By frame received in this process: bytes outside the memory that the sender shares."""


def _outside(found: dsr.Frame) -> int:
    """Bytes of the frame's arrays that are not in memory that another process shares."""
    return sum(array.nbytes for array in found.arrays.values() if not _is_shared(array.ctypes.data))


def _is_shared(address: int) -> bool:
    if not any(address in mapping for mapping in _mappings):
        lines = [line.split() for line in Path("/proc/self/maps").read_text().splitlines() if "memfd:dsr" in line]
        _mappings[:] = [range(*(int(end, 16) for end in line[0].split("-"))) for line in lines]
    return any(address in mapping for mapping in _mappings)


class Burst(NamedTuple):
    """What a burst of frames gave."""

    latencies: list[float]
    """ms, by frame and reader."""
    copied: list[int]
    """Bytes, by frame and reader."""


class Stream:
    """A writer and its readers, each a process."""

    def __init__(self, link: Link) -> None:
        self._closing = contextlib.ExitStack()
        self._next = 1
        with contextlib.ExitStack() as opening:
            self._writer = opening.enter_context(Worker(_write, link))
            self._writer.receive()
            self._readers = opening.enter_context(all_of(Worker(_read, link) for _ in range(READERS)))
            for reader in self._readers:
                reader.receive()
            self._closing = opening.pop_all()

    def burst(self, count: int) -> Burst:
        """Send `count` frames, and some before that do not count."""
        first, self._next = self._next, self._next + count + _COLD
        sent: list[tuple[int, float]] = self._writer.ask((first, count + _COLD))
        sleep(_ON_ITS_WAY)
        latencies, copied = [], []
        for reader in self._readers:
            received, outside = reader.ask(None)
            latencies += [1e3 * (received[number] - start) for number, start in sent[_COLD:] if number in received]
            copied += outside[_COLD:]
        return Burst(latencies, copied)

    def close(self) -> None:
        """End all processes."""
        self._closing.close()


def _write(connection: Connection, link: Link) -> None:
    """Send the bursts (first number, count) that are asked for; answer with each number and when it was sent."""
    writer = link.writer()
    connection.send("ready")
    for first, count in commands(connection):
        start = monotonic() + _PERIOD
        connection.send([_send_at(writer.send, first + i, start + i * _PERIOD) for i in range(count)])
    writer.close()


def _send_at(send: Callable[[int], None], number: int, due: float) -> tuple[int, float]:
    sleep_until(due)
    start = monotonic()
    send(number)
    return number, start


def _read(connection: Connection, link: Link) -> None:
    """Answer each question with when frames were there, and how much of them was copied."""
    stamps: dict[int, float] = {}

    def received(number: int) -> None:
        stamps[number] = monotonic()

    reader = link.reader(received)
    connection.send("ready")
    for _ in commands(connection):
        connection.send((dict(stamps), list(_copied)))
        stamps.clear()
        _copied.clear()
    reader.close()


def measure(run: Run) -> None:
    """Let both take turns."""
    with contextlib.ExitStack() as stack:
        streams: dict[str, Stream] = {}
        for name, link in _links(run).items():
            run.step(f"camera frames: starting {name}")
            streams[name] = stack.enter_context(contextlib.closing(Stream(link)))
            streams[name].burst(10)
        bursts: dict[str, list[Burst]] = {name: [] for name in streams}
        rounds = run.pick(6, 2)
        for number in range(rounds):
            for name, stream in streams.items():
                run.step(f"camera frames: {name}, round {number + 1} of {rounds}")
                bursts[name].append(stream.burst(run.pick(60, 30)))
    _report(run, bursts)


def _links(run: Run) -> dict[str, Link]:
    links: dict[str, Link] = {_OURS: FrameLink("camera-frames")}
    if run.has("zenoh"):
        from benchmarks.peers.zenoh_frames import ZenohFrames

        size = sum(array.nbytes for array in frame(0).arrays.values())
        links[_ZENOH] = ZenohFrames(f"tcp/127.0.0.1:{free_port()}", size)
    return links


def _report(run: Run, bursts: dict[str, list[Burst]]) -> None:
    latencies = {name: [ms for burst in of for ms in burst.latencies] for name, of in bursts.items()}
    copied = [count for burst in bursts[_OURS] for count in burst.copied]
    note = f"{len(latencies[_OURS])} frames received"
    for spec, ratio, share in ((P50, P50_RATIO, 0.5), (P99, P99_RATIO, 0.99)):
        value = percentile(latencies[_OURS], share)
        peers = [Peer(_ZENOH, percentile(latencies[_ZENOH], share))] if _ZENOH in latencies else []
        run.row(spec, value, peers, note)
        if peers:
            run.row(ratio, value / peers[0].value, [Peer(_ZENOH, 1.0)])
    run.row(COPIED, max(copied), note=note)


GROUP = Group("camera frames", SPECS, measure)
