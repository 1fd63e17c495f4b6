"""Nodes or edges of one type among many: the cost should follow the answer, not the graph."""

from __future__ import annotations

from collections.abc import Callable

from benchmarks import workload
from benchmarks.group import Group, Run
from benchmarks.rows import Spec
from benchmarks.timing import duration, percentile
from dsr import Memory

_GRAPH = 10_000
_ABOUT = "memory.nodes(type=...) or memory.edges(type); 10 000 nodes and 10 000 edges, unless said"
NODES = Spec("nodes by type among 10 000, 1000 found", "ms", 0.2, about=_ABOUT)
EDGES = Spec("edges by type among 10 000, 1000 found", "ms", 0.2, about=_ABOUT)
GROWTH = Spec("nodes by type among 10 000, 1000 found over 100 found", "x", 12.0, about="10: proportional")
SIZE = Spec("nodes by type, 1000 found among 10 000 over among 2000", "x", 1.2, about="1: independent of the graph")
SPECS = (NODES, EDGES, GROWTH, SIZE)
_TYPES = {"ball": 1000, "cup": 100, "box": 10}
"""How many nodes of a type there are; all others are cubes."""
_EDGE_TYPES = {"on": 1000, "in": 100}


def measure(run: Run) -> None:
    """Ask large graphs for few and for many."""
    run.step("by type: filling")
    large, small = _filled(_GRAPH), _filled(2000)
    runs = run.pick(501, 51)
    run.step("by type: asking")
    many, few = _milliseconds(lambda: large.nodes("ball"), runs), _milliseconds(lambda: large.nodes("cup"), runs)
    run.row(NODES, many)
    run.row(EDGES, _milliseconds(lambda: large.edges("on"), runs))
    run.row(GROWTH, many / few)
    run.row(SIZE, many / _milliseconds(lambda: small.nodes("ball"), runs))


def _filled(nodes: int) -> Memory:
    """A graph of `nodes` nodes and as many edges, with the rare types spread among them."""
    memory = workload.local_memory()
    memory.add_node("world", "world")
    node_types, edge_types = _spread(_TYPES, nodes, "cube"), _spread(_EDGE_TYPES, nodes, "has")
    for index in range(nodes):
        memory.add_node(workload.name(index), node_types[index], **workload.attributes(index))
        memory.add_edge("world", workload.name(index), edge_types[index])
    return memory


def _spread(rare: dict[str, int], count: int, common: str) -> list[str]:
    """Type names: as many of the rare ones as wanted, at even distances."""
    types = [common] * count
    for offset, (name, wanted) in enumerate(rare.items()):
        for number in range(wanted):
            types[number * (count // wanted) + offset % (count // wanted)] = name
    return types


def _milliseconds(work: Callable[[], object], runs: int) -> float:
    return percentile([duration(work) for _ in range(runs)], 0.5) * 1e3


GROUP = Group("by type", SPECS, measure)
