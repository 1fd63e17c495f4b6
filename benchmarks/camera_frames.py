"""Camera frames: 640 x 480 colour (uint8 x 3) and depth (float32) at 30 Hz, from one process to five.

From before `put_frame` until the reader has the arrays. The peer is raw Zenoh with buffers in its shared memory, until
the callback has the bytes; its Python binding gives them as a copy only. The second peer is done when the callback has
hold of the buffer, and does not read it.
"""

from __future__ import annotations

import contextlib
import threading
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

import dsr
from benchmarks.group import Group, Run
from benchmarks.links import Closable, Link, Received, Sender
from benchmarks.pairs import Latencies
from benchmarks.peers.zenoh_frames import ZenohFrameLink
from benchmarks.ports import reserved_endpoint
from benchmarks.rows import Peer, Spec
from benchmarks.timing import percentile
from benchmarks.workers import BenchmarkError, Worker, commands

_WHAT = "RGB-D 640x480 at 30 Hz to five readers"
_ABOUT = "put_frame to FrameReader.wait; peer: put of a shared buffer until the callback has its bytes"
P50 = Spec(f"{_WHAT}, p50", "ms", about=_ABOUT)
P99 = Spec(f"{_WHAT}, p99", "ms", about=_ABOUT)
RATIO = Spec(f"{_WHAT}, p50 over raw Zenoh shared memory", "x", 1.2, about=_ABOUT)
COPIED = Spec(f"{_WHAT}, copied in a reader", "bytes per frame", 0.0, about="of arrays outside the sender's memory")
SPECS = (P50, P99, RATIO, COPIED)
_READERS = 5
_PERIOD = 1 / 30
_STREAM = "camera"
_COLOR, _DEPTH = (480, 640, 3), (480, 640)
_SIZE = int(np.prod(_COLOR)) + 4 * int(np.prod(_DEPTH))
_OURS, _ZENOH, _UNREAD = "ours", "raw Zenoh shared memory", "raw Zenoh shared memory, not read"


class FrameLink(msgspec.Struct, frozen=True):
    """A frame stream of a working memory."""

    graph: str

    def writer(self) -> Sender:
        """The memory that publishes."""
        return _Camera(self.graph)

    def reader(self, received: Received) -> Closable:
        """A memory, and a thread that takes each frame as soon as it is there."""
        memory = dsr.connect(self.graph, agent="reader")
        threading.Thread(target=_take_all, args=(memory, received), daemon=True).start()
        return memory


class _Camera:
    def __init__(self, graph: str) -> None:
        self._memory = dsr.connect(graph, agent="camera")
        color, depth = np.zeros(_COLOR, np.uint8), np.ones(_DEPTH, np.float32)
        self._arrays: dict[str, NDArray[Any]] = {"color": color, "depth": depth}

    def send(self, number: int) -> None:
        self._memory.put_frame(_STREAM, dsr.Frame(self._memory.clock.now(), self._arrays, {"number": number}))

    def close(self) -> None:
        self._memory.close()


def _take_all(memory: dsr.Memory, received: Received) -> None:
    with contextlib.closing(memory.frames(_STREAM)) as frames:
        while True:
            frame = frames.wait(1.0)
            if frame is not None:
                received(int(frame.meta["number"]))


def measure(run: Run) -> None:
    """All three in turns, then look where frames lie in a reader's memory."""
    links: dict[str, Link] = {
        _OURS: FrameLink("frames"),
        _ZENOH: ZenohFrameLink(reserved_endpoint(), _SIZE, read_out=True),
        _UNREAD: ZenohFrameLink(reserved_endpoint(), _SIZE, read_out=False),
    }
    samples = _take_turns(run, links)
    for spec, share in ((P50, 0.5), (P99, 0.99)):
        value, *peers = (percentile(samples[name], share) for name in (_OURS, _ZENOH, _UNREAD))
        run.row(spec, value, [Peer(_ZENOH, peers[0]), Peer(_UNREAD, peers[1])], f"{len(samples[_OURS])} samples")
    medians = {name: percentile(found, 0.5) for name, found in samples.items()}
    base = medians[_ZENOH]
    run.row(RATIO, medians[_OURS] / base, [Peer(name, medians[name] / base) for name in (_ZENOH, _UNREAD)])
    run.step("camera frames: looking for copies")
    run.row(COPIED, _most_copied(run.pick(60, 20)))
    run.curve("camera frames", samples)


def _take_turns(run: Run, links: dict[str, Link]) -> dict[str, list[float]]:
    """Samples of all readers, ms."""
    rounds, count = run.pick(5, 1), run.pick(60, 30)
    samples: dict[str, list[float]] = {name: [] for name in links}
    with contextlib.ExitStack() as stack:
        crowds: dict[str, Latencies] = {}
        for name, link in links.items():
            run.step(f"camera frames: starting {name}")
            crowds[name] = stack.enter_context(Latencies(link, readers=_READERS))
            crowds[name].warm_up()
        for number in range(rounds):
            for name, crowd in crowds.items():
                run.step(f"camera frames: {name}, round {number + 1} of {rounds}")
                samples[name] += [seconds * 1e3 for seconds in crowd.burst(count, period=_PERIOD)]
    return samples


def _most_copied(count: int) -> int:
    """The most bytes of a frame that a reader had as copies of what the camera had put into shared memory."""
    camera = _Camera("frames-copied")
    with Worker(_look, "frames-copied") as reader, contextlib.closing(camera):
        reader.receive()
        copied: list[int] = []
        for number in range(count):
            camera.send(number)
            copied.append(reader.ask(None))
    return max(copied)


def _look(connection: Connection, graph: str) -> None:
    """For each frame asked for, answer how many bytes of its arrays are copies."""
    with dsr.connect(graph, agent="reader") as memory, contextlib.closing(memory.frames(_STREAM)) as frames:
        connection.send("ready")
        for _ in commands(connection):
            frame = frames.wait(10.0)
            if frame is None:
                raise BenchmarkError("no frame came within 10 s")
            connection.send(sum(array.nbytes for array in frame.arrays.values() if not _is_shared(array)))


def _is_shared(array: NDArray[np.generic]) -> bool:
    """Whether an array lies in a mapping that is shared between processes (Linux)."""
    address = array.__array_interface__["data"][0]
    for line in Path("/proc/self/maps").read_text().splitlines():
        place, permissions, *_ = line.split()
        begin, end = (int(bound, 16) for bound in place.split("-"))
        if begin <= address < end:
            return permissions.endswith("s")
    return False


GROUP = Group("camera frames", SPECS, measure)
