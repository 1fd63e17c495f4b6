"""Growth: the cost of single operations in graphs of 100 to 100 000 nodes should not depend on their size.

Memories without threads, so that nothing but the operation is timed; `merge` is what a second memory needs to merge one
update that it received. The operations go round 100 elements that are spread over the graph, as an agent does that is
busy with some of it. The notes tell what they cost where every call picks another element: large graphs do not fit into
the processor's caches, and what grows then is the time to fetch from main memory. Medians leave out the rare
collections of garbage.
"""

from __future__ import annotations

import gc
import itertools
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from benchmarks import workload
from benchmarks.frame_chains import add_chain, chain_changes
from benchmarks.group import Group, Run
from benchmarks.rows import Spec, number
from benchmarks.timing import duration, percentile
from dsr import LocalNetwork, Memory, WallClock

_SIZES = (100, 1000, 10_000, 100_000)
_BOUND = 1.5
_BATCH = 20
"""Calls that are timed together."""
_OPERATIONS = (
    "insert node", "update attribute", "update RT", "get node", "get edge", "nodes by type, 10 found",
    "frame chain of depth 10, one edge just changed", "watch poll after one change", "merge one update",
)  # fmt: skip
SPECS = {
    operation: Spec(f"growth from 100 to 100 000 nodes, {operation}", "x", _BOUND, about="100 000 nodes by 100")
    for operation in _OPERATIONS
}
_Operation = Callable[[], object]
_Times = dict[str, list[float]]
"""us, by operation and graph"""


def measure(run: Run) -> None:
    """Measure every operation at every size."""
    times: _Times = {operation: [] for operation in _OPERATIONS}
    everywhere: _Times = {operation: [] for operation in _OPERATIONS}
    for nodes in _SIZES:
        run.step(f"growth: filling {nodes} nodes")
        with _Graphs(nodes) as graphs:
            for found, names in ((times, _spread_names(nodes)), (everywhere, _random_names(nodes))):
                for operation, (prepare, work) in graphs.operations(names).items():
                    run.step(f"growth: {operation}, {nodes} nodes")
                    found[operation].append(_microseconds(prepare, work, run.pick(200, 30)))
        gc.collect()
    for operation, spec in SPECS.items():
        values = times[operation]
        note = f"{_listed(values)} us; elements from everywhere {_listed(everywhere[operation])} us"
        run.row(spec, values[-1] / values[0], note=note)
    run.curve("growth", {"nodes": _SIZES, "us": times})


def _listed(values: list[float]) -> str:
    return ", ".join(map(number, values))


def _microseconds(prepare: _Operation, work: _Operation, batches: int) -> float:
    """The median time of one call of `work`, us; `prepare` is called before each, and not timed."""
    samples = []
    for _ in range(batches):
        total = 0.0
        for _ in range(_BATCH):
            prepare()
            total += duration(work)
        samples.append(total / _BATCH)
    return percentile(samples, 0.5) * 1e6


class _Graphs:
    """A graph of `nodes` nodes in a memory, and its replica in another."""

    def __init__(self, nodes: int) -> None:
        self._network = LocalNetwork(WallClock())
        self.memory, self._other = (workload.local_memory(name, self._network) for name in ("one", "two"))
        workload.fill(self.memory, nodes)
        for index in range(10):
            self.memory.add_node(f"ball_{index}", "ball")
        self._tip = add_chain(self.memory)
        self._other.restore(self.memory.snapshot())
        self.pass_on()
        self._serial = itertools.count(nodes)

    def __enter__(self) -> _Graphs:
        return self

    def __exit__(self, *_: object) -> None:
        self.memory.close()
        self._other.close()

    def pass_on(self) -> None:
        """Bring what was written to the other memory."""
        self.memory.flush()
        self._network.deliver()
        self._other.poll()

    def operations(self, names: Iterator[str]) -> dict[str, tuple[_Operation, _Operation]]:
        """What is done before each call, and the call, on the elements of these names."""
        memory = self.memory
        changes = chain_changes(memory)
        watch = memory.watch(attribute="order", existing=False)

        def nothing() -> None: ...

        def deliver() -> None:
            self._update(memory, next(names))
            memory.flush()
            self._network.deliver()

        work: dict[str, tuple[_Operation, _Operation]] = {
            "insert node": (self.pass_on, self._insert),
            "update attribute": (self.pass_on, lambda: self._update(memory, next(names))),
            "update RT": (self.pass_on, lambda: self._move(memory, next(names))),
            "get node": (nothing, lambda: memory.node(next(names))),
            "get edge": (nothing, lambda: memory.edge("world", next(names), "RT")),
            "nodes by type, 10 found": (nothing, lambda: memory.nodes("ball")),
            "frame chain of depth 10, one edge just changed": (
                lambda: next(changes), partial(memory.transform, "world", self._tip),
            ),
            "watch poll after one change": (lambda: self._update(memory, next(names)), watch.poll),
            "merge one update": (deliver, self._other.poll),
        }  # fmt: skip
        return work

    def _insert(self) -> None:
        number_ = next(self._serial)
        self.memory.add_node(workload.name(number_), workload.TYPE, **workload.attributes(number_))

    def _update(self, memory: Memory, name: str) -> None:
        memory.update_node(name, order=next(self._serial))

    def _move(self, memory: Memory, name: str) -> None:
        memory.update_edge("world", name, "RT", pose=workload.pose(1, float(next(self._serial))))


def _random_names(nodes: int) -> Iterator[str]:
    """Names of nodes in random order, for ever."""
    order = np.random.default_rng(0).permutation(nodes)
    return itertools.cycle([workload.name(int(index)) for index in order])


def _spread_names(nodes: int) -> Iterator[str]:
    """Names of 100 nodes, far from one another, for ever."""
    return itertools.cycle([workload.name(index) for index in range(0, nodes, nodes // 100)])


GROUP = Group("growth", list(SPECS.values()), measure)
