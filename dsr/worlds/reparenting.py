"""Hangs frames whose parent a filter leaves out on the nearest frame that is kept."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, NamedTuple

from dsr.crdt.delta import EdgeKey
from dsr.errors import CycleError, NodeNotFoundError
from dsr.frames.tree import BELIEVED
from dsr.graph.elements import Edge, Node
from dsr.math3d.tolerance import PoseTolerance
from dsr.math3d.transforms import Pose
from dsr.worlds.registry import VIA

if TYPE_CHECKING:
    from dsr.memory import Memory

FRAMES = {"RT": ("RT",), "Virtual_RT": BELIEVED}
"""Edge types that place a node, each with those by which its chain goes on upwards."""
_SAME = PoseTolerance(1e-9, 1e-9)  # m, rad: less is rounding


class _Place(NamedTuple):
    """Where a node is to be in the output."""

    parent: str
    pose: Pose
    via: str


class Reparenting:
    """Keeps edges from kept ancestors to nodes whose own parent is not in the output, with the composed pose.

    So what is passed on is where it is in the input, as `transform` says there. The edge has the type of the one that
    it stands for, and goes when that goes, or when the parent comes into the output.

    Args:
        sources: the worlds that are read, by name, in the order of their priority.
        target: the world that is written.
        accepts: whether a node is passed on.
        accepts_edge: whether an edge is.
        first_only: believe the first source that has such a node; else the value written last.
    """

    def __init__(
        self,
        sources: Mapping[str, Memory],
        target: Memory,
        accepts: Callable[[Node], bool],
        accepts_edge: Callable[[Edge], bool],
        first_only: bool = False,
    ) -> None:
        self._sources = sources
        self._target = target
        self._accepts = accepts
        self._accepts_edge = accepts_edge
        self._first_only = first_only
        self._orphans: set[tuple[str, str]] = set()
        """(node, edge type)"""
        self._written: dict[tuple[str, str], EdgeKey] = {}
        self._is_due = False

    def holds(self, key: EdgeKey) -> bool:
        """Whether an edge of the output is one of those."""
        return self._written.get((key[1], key[2])) == key

    def note(self, keys: Iterable[EdgeKey]) -> None:
        """Take down the keys of edges of the sources that changed or went, or whose ends did; `update` acts on them."""
        for src, dst, kind in keys:
            if kind in FRAMES:
                self._is_due = True
                if src not in self._target:
                    self._orphans.add((dst, kind))

    def update(self) -> None:
        """Write the poses of the reparented edges anew, if something may have moved."""
        if not self._is_due:
            return
        self._is_due = False
        places = {(node, kind): self._place(node, kind) for node, kind in sorted(self._orphans)}
        for (node, kind), place in places.items():
            before = self._written.get((node, kind))
            if before is not None and (place is None or before[0] != place.parent):
                self._take_back(before)
                del self._written[node, kind]
        for (node, kind), place in places.items():
            if place is not None:
                key = (place.parent, node, kind)
                self._write(key, place)
                self._written[node, kind] = key
            elif not self._is_orphan(node, kind):
                self._orphans.discard((node, kind))

    def _write(self, key: EdgeKey, place: _Place) -> None:
        here = self._target.get_edge(*key)
        pose = None if here is None else here.get("pose")
        if pose is not None and _is_same(pose, place.pose):
            return
        try:
            self._target.add_edge(*key, pose=place.pose, **({VIA: place.via} if here is None else {}))
        except NodeNotFoundError:  # an end goes at this moment, which is another change
            return
        except CycleError:  # an edge that is to go is still there
            self._is_due = True

    def _take_back(self, key: EdgeKey) -> None:
        edge = self._target.get_edge(*key)
        if edge is not None and not self._is_passed_on(key):
            self._target.withdraw(edge)

    # ---- where nodes hang in the sources

    def _is_orphan(self, node: str, kind: str) -> bool:
        """Whether a source has it, at a parent that is not in the output."""
        return any(
            edge.src not in self._target for memory in self._sources.values() for edge in memory.edges(kind, dst=node)
        )

    def _place(self, node: str, kind: str) -> _Place | None:
        """Where a node is to be if nothing that is passed on says so; None if something does, or nobody knows."""
        found: list[tuple[float, _Place]] = []
        for world, memory in self._sources.items():
            here = memory.get_node(node)
            edges = [edge for edge in memory.edges(kind, dst=node) if "pose" in edge and self._accepts_edge(edge)]
            if node not in self._target or here is None or not edges or not self._accepts(here):
                continue
            edge = _newest(edges)
            if edge.src in self._target:
                return None
            via = (*filter(None, str(edge.get(VIA, "")).split(",")), world)
            place = None if self._target.world_name in via else self._composed(memory, edge, ",".join(via))
            if place is not None and all(other.src != place.parent for other in edges):
                found.append((edge.written_at("pose") or 0.0, place))
        if not found:
            return None
        return found[0][1] if self._first_only else max(found, key=lambda pair: pair[0])[1]

    def _composed(self, memory: Memory, edge: Edge, via: str) -> _Place | None:
        types = FRAMES[edge.type]
        parent = next((name for name in _ancestors(memory, edge.src, types) if name in self._target), None)
        if parent is None:
            return None
        pose = memory.get_transform(parent, edge.dst, types=types)
        return None if pose is None else _Place(parent, pose, via)

    def _is_passed_on(self, key: EdgeKey) -> bool:
        """Whether the sources have such an edge themselves."""
        edges = (memory.get_edge(*key) for memory in self._sources.values())
        return any(edge is not None and self._accepts_edge(edge) for edge in edges)


def _ancestors(memory: Memory, name: str, types: tuple[str, ...]) -> Iterator[str]:
    """Frames from this one upwards, along the edge of the preferred type that was written last."""
    seen: set[str] = set()
    while name not in seen:
        seen.add(name)
        yield name
        edges = next((found for kind in types if (found := memory.edges(kind, dst=name))), [])
        if not edges:
            return
        name = _newest(edges).src


def _newest(edges: list[Edge]) -> Edge:
    """The one with the newest sample, which is the one that counts."""
    return max(edges, key=lambda edge: 0.0 if (pose := edge.get("pose")) is None else pose.stamp)


def _is_same(a: Pose, b: Pose) -> bool:
    return a.stamp == b.stamp and _SAME.covers(a, b)
