"""A mesh of 100 000 vertices from the process that has it to five others, which check that it is the right one.

All five ask at once; a round is over when the last one has the mesh, verified. Each has a cache folder of its own, and
each round is another mesh, so that nothing is there before. In place: readers map the holder's memory. In pieces: as
between machines. The peer is raw Zenoh: five sessions get as many bytes by one query each, at once, and check nothing.
"""

from __future__ import annotations

import contextlib
import os
import statistics
import tempfile
from collections.abc import Iterator, Sequence
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

import dsr
from benchmarks.group import Group, Run
from benchmarks.peers import zenoh_query
from benchmarks.ports import reserved_endpoint
from benchmarks.rows import Peer, Spec
from benchmarks.timing import monotonic
from benchmarks.workers import Worker, all_of, commands

_WHAT = "mesh of 100 000 vertices"
_ABOUT = (
    "memory.mesh in five processes at once, until the last has it, verified; peer: as many bytes, by one query each"
)
IN_PLACE = Spec(f"{_WHAT} to five readers", "ms", about=_ABOUT)
IN_PIECES = Spec(f"{_WHAT} to five readers, in pieces", "ms", about=_ABOUT)
PUSH = Spec(f"{_WHAT}: put_mesh", "ms", about="canonical bytes, hash, memory and disk; nothing is sent")
SENT = Spec(
    f"{_WHAT}: sent to each reader", "times its size", 1.0, about="bytes that arrive, with all rounds in pieces"
)
AGAIN = Spec(f"{_WHAT}: pushed and pulled again", "bytes sent", 0.0, about="an equal mesh, by the same five readers")
SPECS = (IN_PLACE, IN_PIECES, PUSH, SENT, AGAIN)
_READERS = 5
_VERTICES, _TRIANGLES = 100_000, 200_000
_TIMEOUT = 60.0  # s


class _Crowd:
    """One process with meshes and five that want them."""

    def __init__(self, holder: Worker, readers: Sequence[Worker]) -> None:
        self._holder, self._readers = holder, readers
        self.pushes: list[float] = []
        self.size = 0

    def round(self, seed: int) -> tuple[float, list[int]]:
        """Seconds until all have the mesh of that seed, and how many bytes arrived at each reader so far."""
        hash, self.size, seconds = self._holder.ask(seed)
        self.pushes.append(seconds)
        for reader in self._readers:
            reader.send(hash)
        answers = [reader.receive() for reader in self._readers]
        return max(end for _, end, _ in answers) - min(start for start, _, _ in answers), [n for *_, n in answers]


def measure(run: Run) -> None:
    """All three ways in turns."""
    count = run.pick(15, 3)
    times: dict[str, list[float]] = {"in place": [], "in pieces": [], "raw Zenoh": []}
    with _crowd("meshes", in_place=True) as near, _crowd("meshes-apart", in_place=False) as far:
        size = _warm(near, far)
        with _raw(size) as readers:
            for number in range(count):
                run.step(f"meshes: round {number + 1} of {count}")
                times["in place"].append(near.round(number)[0])
                times["raw Zenoh"].append(_ask_all(readers))
                seconds, arrived = far.round(number)
                times["in pieces"].append(seconds)
        pushed_again = [after - before for before, after in zip(arrived, far.round(number)[1], strict=True)]
    medians = {name: statistics.median(found) * 1e3 for name, found in times.items()}
    peers = [Peer("raw Zenoh", medians["raw Zenoh"])]
    note = f"{size} bytes, {count} rounds, slowest "
    run.row(IN_PLACE, medians["in place"], peers, f"{note}{max(times['in place']) * 1e3:.0f} ms")
    run.row(IN_PIECES, medians["in pieces"], peers, f"{note}{max(times['in pieces']) * 1e3:.0f} ms")
    run.row(PUSH, statistics.median(near.pushes) * 1e3)
    run.row(SENT, max(arrived) / (size * (count + 1)), note=f"{count + 1} meshes")
    run.row(AGAIN, max(pushed_again))


def _warm(*crowds: _Crowd) -> int:
    """A round that does not count; the size of a mesh, bytes."""
    for crowd in crowds:
        crowd.round(-1)
        crowd.pushes.clear()
    return crowds[0].size


@contextlib.contextmanager
def _crowd(graph: str, *, in_place: bool) -> Iterator[_Crowd]:
    with tempfile.TemporaryDirectory(prefix="dsr-bench-meshes-") as folder, contextlib.ExitStack() as stack:
        holder = stack.enter_context(Worker(_hold, graph, f"{folder}/holder", in_place))
        holder.receive()
        readers = stack.enter_context(
            all_of(Worker(_read, graph, f"{folder}/reader-{number}") for number in range(_READERS))
        )
        for reader in readers:
            reader.receive()
        yield _Crowd(holder, readers)


def _mesh(seed: int) -> dsr.Mesh:
    random = np.random.default_rng(seed + 1)
    triangles = random.integers(0, _VERTICES, (_TRIANGLES, 3))
    return dsr.Mesh(random.normal(size=(_VERTICES, 3)), triangles)


def _hold(connection: Connection, graph: str, cache: str, in_place: bool) -> None:
    """Put a mesh for each seed; answer its hash and size, and how long that took."""
    os.environ["XDG_CACHE_HOME"] = str(Path(cache))
    with dsr.connect(graph, agent="holder") as memory:
        memory.meshes.shares_memory = in_place
        connection.send("ready")
        for seed in commands(connection):
            content = _mesh(seed)
            vertices, triangles = content.vertices.copy(), content.triangles.copy()
            start = monotonic()
            mesh = dsr.Mesh(vertices, triangles)
            hash = memory.put_mesh(mesh)
            connection.send((hash, mesh.nbytes, monotonic() - start))


def _read(connection: Connection, graph: str, cache: str) -> None:
    """Get each mesh asked for; answer when it began and ended, and how many bytes have arrived in all."""
    os.environ["XDG_CACHE_HOME"] = str(Path(cache))
    with dsr.connect(graph, agent="reader") as memory:
        connection.send("ready")
        for hash in commands(connection):
            start = monotonic()
            memory.mesh(hash, _TIMEOUT)
            end = monotonic()
            connection.send((start, end, memory.meshes.statistics.received))


@contextlib.contextmanager
def _raw(size: int) -> Iterator[Sequence[Worker]]:
    endpoint = reserved_endpoint()
    with Worker(zenoh_query.hold_bytes, endpoint, size) as holder:
        holder.receive()
        with all_of(Worker(_read_bytes, endpoint, size) for _ in range(_READERS)) as readers:
            for reader in readers:
                reader.receive()
            yield readers


def _ask_all(readers: Sequence[Worker]) -> float:
    for reader in readers:
        reader.send("ask")
    answers = [reader.receive() for reader in readers]
    return float(max(end for _, end in answers) - min(start for start, _ in answers))


def _read_bytes(connection: Connection, endpoint: str, size: int) -> None:
    asker = zenoh_query.Asker(endpoint, size)
    connection.send("ready")
    for _ in commands(connection):
        start = monotonic()
        asker.ask()
        connection.send((start, monotonic()))
    asker.close()


GROUP = Group("meshes", SPECS, measure)
