"""Forks and overlays of a large world: made at once, no memory of their own until something changes, quick to read."""

from __future__ import annotations

import itertools
import tracemalloc
from collections.abc import Callable

from benchmarks import workload
from benchmarks.group import Group, Run
from benchmarks.rows import Spec, number
from benchmarks.timing import duration, percentile
from dsr import Memory

_GRAPH = 10_000
_WRITTEN_NAMES = [workload.name(index) for index in range(1000)]
_FORK = "memory.fork of 10 000 nodes and as many edges; the least of several"
FORK = Spec("fork of a world of 10 000 nodes", "ms", 2.0, about=_FORK)
OVERLAY = Spec("overlay of a world of 10 000 nodes", "ms", 2.0, about=_FORK)
MEMORY = Spec(
    "memory of a fork in which nothing changed, 10 000 nodes", "KB", 100.0, about="a replica with nothing in it"
)
CHANGE = Spec("memory of a node changed in a fork", "KB", 2.0, about="100 of 10 000 changed")
_READS = "all of 10 000 (2000 frames) in turn, overlay by its parent; the least of several rounds"
NODE = Spec("overlay reads by plain reads, attribute of a node", "x", 2.0, about=_READS)
EDGE = Spec("overlay reads by plain reads, pose of an edge", "x", 2.0, about=_READS)
LOOP = Spec("overlay reads by plain reads, nodes by type with an attribute", "x", 2.0, about=_READS)
FRAME = Spec("overlay reads by plain reads, transform", "x", 2.0, about=_READS)
OWN = Spec("overlay reads by plain reads, attribute that the overlay wrote", "x", 2.0, about="1000 of 10 000 written")
SPECS = (FORK, OVERLAY, MEMORY, CHANGE, NODE, EDGE, LOOP, FRAME, OWN)


def measure(run: Run) -> None:
    """Fork, write, and read in both."""
    run.step("worlds: filling")
    memory = workload.local_memory()
    workload.fill(memory, _GRAPH)
    memory.poll()
    serial = itertools.count()
    for spec, follow in ((FORK, False), (OVERLAY, True)):
        run.step(f"worlds: {spec.row}")
        times = [
            duration(lambda follow=follow: memory.fork(f"w{next(serial)}", follow=follow))  # type: ignore[misc]
            for _ in range(run.pick(50, 10))
        ]
        run.row(spec, min(times) * 1e3, note=f"median {number(percentile(times, 0.5) * 1e3)} ms")
    run.step("worlds: memory")
    empty, changed = _kilobytes(memory)
    run.row(MEMORY, empty)
    run.row(CHANGE, changed)
    overlay = memory.fork("read", follow=True)
    overlay.update_node(workload.name(0), order=1)
    for reading, (spec, read) in _reads().items():
        run.step(f"worlds: {reading}")
        rounds = run.pick(9, 3)
        first = _ratio(memory, overlay, read, rounds, _forget)
        run.row(spec, _ratio(memory, overlay, read, rounds), note=f"{number(first)} the first time, by plain's first")
    run.step("worlds: what the overlay wrote")
    run.row(OWN, _ratio(memory, _written(memory), _read_written, run.pick(9, 3)))
    memory.close()


def _written(memory: Memory) -> Memory:
    """An overlay that says something of 1000 nodes."""
    overlay = memory.fork("written", follow=True)
    for index, name in enumerate(_WRITTEN_NAMES):
        overlay.update_node(name, order=index)
    return overlay


def _read_written(memory: Memory) -> list[object]:
    return [memory.node(name).get("order") for name in _WRITTEN_NAMES]


def _reads() -> dict[str, tuple[Spec, Callable[[Memory], object]]]:
    names = [workload.name(index) for index in range(_GRAPH)]
    return {
        "nodes": (NODE, lambda memory: [memory.node(name).get("order") for name in names]),
        "edges": (EDGE, lambda memory: [memory.edge("world", name, "RT").pose for name in names]),
        "loop": (LOOP, lambda memory: [node.get("order") for node in memory.nodes(workload.TYPE)]),
        "frames": (FRAME, lambda memory: [memory.transform("world", name) for name in names[:2000]]),
    }


def _ratio(
    plain: Memory,
    overlay: Memory,
    read: Callable[[Memory], object],
    rounds: int,
    before: Callable[[Memory], object] = lambda memory: None,
) -> float:
    """Time of a round in the overlay by that in the plain world, the least of each."""
    times: dict[str, list[float]] = {}
    for _ in range(rounds):
        for memory in (plain, overlay):
            before(memory)
            times.setdefault(memory.world_name, []).append(duration(lambda memory=memory: read(memory)))  # type: ignore[misc]
    return min(times[overlay.world_name]) / min(times[plain.world_name])


def _forget(memory: Memory) -> None:
    """Drop what only makes reading again faster."""
    memory.replica.graph.forget_handles()
    memory._frames._chains.clear()


def _kilobytes(memory: Memory) -> tuple[float, float]:
    """Of a fork in which nothing changed, and of each node changed in it."""
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        fork = memory.fork("grown")
        made = tracemalloc.get_traced_memory()[0]
        for index in range(100):
            fork.update_node(workload.name(index), order=index)
        fork.flush()
        fork.replica.graph.forget_handles()
        return (made - before) / 1e3, (tracemalloc.get_traced_memory()[0] - made) / 1e3 / 100
    finally:
        tracemalloc.stop()


GROUP = Group("worlds", list(SPECS), measure)
