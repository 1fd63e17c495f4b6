"""Frame chains: where a frame is that hangs on ten edges, and where a thousand frames are at once.

Times are those of the reading call alone; the writes between two calls are not counted. pytransform3d gets the same
frames and the same question (it checks nothing here, as `TransformManager(check=False)`).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import NamedTuple

from benchmarks import workload
from benchmarks.group import Group, Run
from benchmarks.rows import Peer, Spec, number
from benchmarks.timing import duration, percentile, rate
from dsr import Memory

DEPTH = 10
_AT_ONCE = 1000
_SIZES = (100, 1000, 10_000)
_ABOUT = "memory.transform('world', frame) in a graph of 1000 nodes; peer: TransformManager.get_transform"
CHANGED = Spec("frame chain of depth 10, one edge just changed", "us", 15.0, about=_ABOUT)
UNCHANGED = Spec("frame chain of depth 10, unchanged", "us", 1.0, about=_ABOUT)
CHANGED_GROWTH = Spec("frame chain of depth 10, one edge just changed, 10 000 nodes over 100", "x", 1.3)
UNCHANGED_GROWTH = Spec("frame chain of depth 10, unchanged, 10 000 nodes over 100", "x", 1.3)
AT_ONCE = Spec(
    "frame chains of depth 10, 1000 at once vectorised, one edge just changed", "ms", 1.0,
    about="memory.transforms of 1000 frames at the end of one chain, whose edges change in turn; peer: one by one",
)  # fmt: skip
SPECS = (CHANGED, UNCHANGED, CHANGED_GROWTH, UNCHANGED_GROWTH, AT_ONCE)
_PEER = "pytransform3d"


class _Times(NamedTuple):
    """Median times of one call, us."""

    changed: float
    unchanged: float


def measure(run: Run) -> None:
    """One chain in graphs of several sizes, then many frames at once."""
    ours = {size: _ours(run, size) for size in _SIZES}
    peer = _peer(run)
    changed, unchanged = ([Peer(_PEER, value)] if peer else [] for value in peer or (0.0, 0.0))
    run.row(CHANGED, ours[1000].changed, changed)
    run.row(UNCHANGED, ours[1000].unchanged, unchanged)
    run.row(CHANGED_GROWTH, ours[10_000].changed / ours[100].changed)
    run.row(UNCHANGED_GROWTH, ours[10_000].unchanged / ours[100].unchanged)
    _measure_many(run, _AT_ONCE * unchanged[0].value / 1e3 if unchanged else None)


def _ours(run: Run, nodes: int) -> _Times:
    run.step(f"frame chains: {nodes} nodes")
    memory = workload.local_memory()
    workload.fill(memory, nodes - DEPTH)
    tip = add_chain(memory)
    changes = chain_changes(memory)
    changed = _after_each(lambda: next(changes), lambda: memory.transform("world", tip), run.pick(5000, 500))
    calls = 1000

    def ask() -> None:
        for _ in range(calls):
            memory.transform("world", tip)

    return _Times(changed * 1e6, 1e6 / rate(ask, calls, run.pick(51, 11)))


def add_chain(memory: Memory) -> str:
    """Hang a chain of `DEPTH` edges on the world; the name of its last frame."""
    for index in range(DEPTH):
        memory.add_node(f"link_{index}", "body")
        memory.add_edge(_parent(index), f"link_{index}", "RT", pose=workload.pose(index))
    return f"link_{DEPTH - 1}"


def _parent(index: int) -> str:
    return f"link_{index - 1}" if index else "world"


def chain_changes(memory: Memory, depth: int = DEPTH) -> itertools.chain[None]:
    """Each step gives the next edge of the chain a new pose, for ever."""

    def change(step: int) -> None:
        index = step % depth
        memory.update_edge(_parent(index), f"link_{index}", "RT", pose=workload.pose(step, 2.0 + step))

    return itertools.chain(map(change, itertools.count()))


def _after_each(change: Callable[[], object], ask: Callable[[], object], count: int) -> float:
    """The median time of `ask` after each of `count` changes, s."""
    samples = []
    for _ in range(count):
        change()
        samples.append(duration(ask))
    return percentile(samples, 0.5)


def _peer(run: Run) -> _Times | None:
    if not run.has("pytransform3d"):
        return None
    from benchmarks.peers.pytransform3d_frames import Frames

    run.step(f"frame chains: {_PEER}")
    frames = Frames(workload.NODES - DEPTH, DEPTH)
    count = run.pick(500, 50)
    return _Times(
        _after_each(frames.change, frames.ask, count) * 1e6, _after_each(lambda: None, frames.ask, count) * 1e6
    )


def _measure_many(run: Run, one_by_one: float | None) -> None:
    """A thousand objects on the last frame but one of the chain; `one_by_one` is what the peer needs for them, ms."""
    run.step("frame chains: 1000 at once")
    memory = workload.local_memory()
    memory.add_node("world", "world")
    camera = _parent(DEPTH - 1)
    add_chain(memory)
    objects = [workload.name(index) for index in range(_AT_ONCE)]
    for index, name in enumerate(objects):
        memory.add_node(name, workload.TYPE)
        memory.add_edge(camera, name, "RT", pose=workload.pose(index))

    def ask() -> None:
        memory.transforms("world", objects)

    def change_all() -> None:
        for index, name in enumerate(objects):
            memory.update_edge(camera, name, "RT", pose=workload.pose(index, next(stamps)))

    first, stamps = duration(ask), itertools.count(2.0)
    count = run.pick(200, 20)
    changes = chain_changes(memory, DEPTH - 1)
    changed = _after_each(lambda: next(changes), ask, count) * 1e3
    note = (
        f"unchanged {number(_after_each(lambda: None, ask, count) * 1e3)} ms, "
        f"all 1000 last edges changed {number(_after_each(change_all, ask, run.pick(30, 5)) * 1e3)} ms, "
        f"the first time {number(first * 1e3)} ms"
    )
    run.row(AT_ONCE, changed, [Peer(_PEER, one_by_one)] if one_by_one is not None else [], note)


GROUP = Group("frame chains", SPECS, measure)
