"""What keeping the state costs the writer beside it, and how long restoring, saving and loading take.

    python -m benchmarks.persistence

One memory without network, n nodes of 5 attributes with an RT edge each; a writer updates one attribute after the
other, once alone, and once while snapshots are taken all the time by another thread.
"""

from __future__ import annotations

import sys
import tempfile
import threading
from itertools import islice
from pathlib import Path

from benchmarks.timing import duration, percentile, sleep
from benchmarks.workload import changes, fill, local_memory
from dsr.memory import Memory
from dsr.persistence.content import GraphContent
from dsr.persistence.files import read_graph, write_graph
from dsr.persistence.keeper import StateKeeper

_WRITES = 20_000
_PAUSE = 0.0002  # s between two writes


def main() -> None:
    """Measure and print."""
    sys.setswitchinterval(0.0005)  # as a memory with threads has it
    for nodes in (1000, 10_000):
        with tempfile.TemporaryDirectory() as folder:
            print(f"{nodes} nodes x 5 attributes, {nodes} RT edges")
            _measure(nodes, Path(folder))


def _measure(nodes: int, folder: Path) -> None:
    memory = local_memory()
    fill(memory, nodes)
    _tell("a write, alone", _writes(memory, nodes))
    keeper = StateKeeper(memory, folder / "state", threaded=False)
    stop = threading.Event()
    thread = threading.Thread(target=_take_snapshots, args=(keeper, stop))
    thread.start()
    _tell("a write, while snapshots are taken", _writes(memory, nodes))
    stop.set()
    thread.join()
    _tell("flush of nothing", [duration(keeper.flush) for _ in range(100)])
    _tell("flush of 1000 new values", [_flush_after(memory, keeper, nodes) for _ in range(20)])
    _tell("snapshot", [duration(keeper.snapshot) for _ in range(5)])
    size = max(path.stat().st_size for path in (folder / "state").glob("snapshot-*"))
    memory.close()
    _tell(f"restore {size / 1e6:.1f} MB", [duration(lambda: _restore(folder / "state")) for _ in range(3)])
    file = folder / "graph.json"
    _tell("save as JSON", [duration(lambda: write_graph(GraphContent.of(memory), file)) for _ in range(3)])
    _tell(f"read {file.stat().st_size / 1e6:.1f} MB of JSON", [duration(lambda: read_graph(file)) for _ in range(3)])
    content = read_graph(file)
    _tell("put it into a memory", [duration(lambda: content.put_into(local_memory())) for _ in range(3)])


def _writes(memory: Memory, nodes: int) -> list[float]:
    times = []
    for name, values in islice(changes(nodes), _WRITES):
        sleep(_PAUSE)
        times.append(duration(lambda: memory.update_node(name, **values)))  # noqa: B023
    return times


def _take_snapshots(keeper: StateKeeper, stop: threading.Event) -> None:
    while not stop.is_set():
        keeper.snapshot()


def _flush_after(memory: Memory, keeper: StateKeeper, nodes: int) -> float:
    for name, values in islice(changes(nodes), 1000):
        memory.update_node(name, **values)
    return duration(keeper.flush)


def _restore(folder: Path) -> None:
    memory = local_memory()
    StateKeeper(memory, folder, threaded=False)
    memory.close()


def _tell(what: str, seconds: list[float]) -> None:
    shares = {"p50": percentile(seconds, 0.5), "p99": percentile(seconds, 0.99), "most": max(seconds)}
    print(f"  {what:<36}" + "".join(f"{name:>8} {1e3 * value:8.3f} ms" for name, value in shares.items()))


if __name__ == "__main__":
    main()
