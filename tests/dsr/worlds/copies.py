"""Graphs, forks and for each fork an ordinary graph that was filled with a deep copy, to which the same happens."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Any

from dsr import Pose
from dsr.crdt.context import CausalContext
from dsr.crdt.delta import Delta
from dsr.crdt.pieces import reply_to
from dsr.errors import DsrError
from dsr.frames.tree import FrameTree
from dsr.graph.elements import Edge, Node
from dsr.graph.graph import Graph
from dsr.graph.schema import Schema
from dsr.graph.watches import Watches
from dsr.worlds.fork import ForkedGraph
from dsr.worlds.fork_frames import ForkedFrames

NAMES = [f"n{number}" for number in range(6)]
NODE_TYPES = ("cube", "ball")
EDGE_TYPES = ("RT", "has")
SCHEMA = Schema()


class Telling(Watches):
    """Watches that also count what they are told."""

    def __init__(self, frames: FrameTree | None = None) -> None:
        super().__init__({"RT"}, frames)
        self.told: Counter[Any] = Counter()

    def added(self, element: Node | Edge) -> None:
        self.told["added", key_of(element), tuple(sorted(dict(element).items(), key=str))] += 1
        super().added(element)

    def removed(self, element: Node | Edge) -> None:
        self.told["removed", key_of(element)] += 1
        super().removed(element)

    def updated(self, element: Node | Edge, attribute: str) -> None:
        self.told["updated", key_of(element), attribute, str(element.get(attribute))] += 1
        super().updated(element, attribute)


def key_of(element: Node | Edge) -> Any:
    return element.name if isinstance(element, Node) else element.key


@dataclass
class Side:
    """A graph with its watches."""

    graph: Graph
    watches: Telling
    handles: dict[Any, Node | Edge] = field(default_factory=dict)
    """Elements as somebody got them some time ago."""

    def hold(self) -> None:
        self.handles = {key_of(e): e for e in [*self.graph.nodes.values(), *self.graph.edges.values()]}


@dataclass
class World:
    """A graph, and for a fork its twin: the deep copy. Of a plain graph, the twin is a plain graph, too."""

    it: Side
    twin: Side
    remote: Graph
    """A replica elsewhere."""

    @staticmethod
    def plain(rid: str) -> World:
        sides = []
        for name in (rid, f"{rid}twin"):
            watches = Telling()
            sides.append(Side(Graph(name, SCHEMA, watches), watches))
        return World(sides[0], sides[1], Graph(f"{rid}remote", SCHEMA))

    def fork(self, rid: str) -> World:
        watches = Telling(ForkedFrames(self.it.watches.frames))
        it = Side(ForkedGraph(rid, self.it.graph, watches), watches)
        frames = FrameTree()
        for (type, child), histories in self.twin.watches.frames._histories.items():
            frames._histories[type, child] = histories.copied()
            frames._choose_newest(type, child, "")
        watches = Telling(frames)
        twin = Side(Graph(f"{rid}twin", SCHEMA, Watches({"RT"})), watches)
        twin.graph.join(reply_to(self.twin.graph.store, CausalContext()), 1.0)
        twin.graph.watches = watches
        remote = Graph(f"{rid}remote", SCHEMA)
        remote.join(reply_to(it.graph.store, CausalContext()), 1.0)
        return World(it, twin, remote)

    def join(self, delta: Delta) -> None:
        """Something arrives."""
        self.it.graph.join(delta, 1.0)
        self.twin.graph.join(delta, 1.0)

    def commit(self, delta: Delta) -> None:
        """Something was written in the graph itself."""
        self.twin.graph.join(delta, 1.0)
        if any(write.dot for write in delta.writes) or not delta.writes:
            self.remote.join(delta, 1.0)

    def check_frames(self) -> None:
        """Not after every change: asking keeps what was found."""
        assert transforms(self.it.watches.frames) == transforms(self.twin.watches.frames)

    def check(self) -> None:
        it, twin = self.it, self.twin
        assert shown(it.graph) == shown(twin.graph)
        assert indexes(it.graph) == indexes(twin.graph)
        assert state(it.graph) == state(twin.graph)
        assert it.watches.told == twin.watches.told
        it.watches.told.clear()
        twin.watches.told.clear()
        for key, handle in twin.handles.items():
            table: Any = twin.graph.nodes if isinstance(handle, Node) else twin.graph.edges
            if table.get(key) is handle and key in it.handles:
                assert dict(it.handles[key]) == dict(handle) and it.handles[key].type == handle.type


def shown(graph: Graph) -> Any:
    """Everything visible, asked for in several ways."""
    nodes = {name: (node.type, dict(node), node.created) for name, node in graph.nodes.items()}
    edges = {key: (dict(edge), edge.created) for key, edge in graph.edges.items()}
    assert {node.name for node in graph.nodes.values()} == set(nodes) and len(graph.nodes) == len(nodes)
    assert {edge.key for edge in graph.edges.values()} == set(edges) and len(graph.edges) == len(edges)
    for name in NAMES:
        assert (name in graph.nodes) == (name in nodes) == (graph.nodes.get(name) is not None)
    return nodes, edges


def indexes(graph: Graph) -> Any:
    found = []
    for groups in (graph.nodes_by_type, graph.edges_by_type, graph.edges_out, graph.edges_in, graph.incident):
        members: dict[str, list[Any]] = {}
        for name in list(groups):
            group = groups.get(name, {})
            keys = sorted(group, key=str)
            assert len(group) == len(keys) and bool(group) == bool(keys)
            if keys:
                members[name] = keys
            if groups is not graph.incident:
                assert sorted((key_of(e) for e in group.values()), key=str) == keys
        found.append(members)
    return found


def state(graph: Graph) -> Any:
    store = graph.store
    entries = {dot: (e.key, e.type, dict(e.registers), e.sources, e.destinations) for dot, e in store.entries.items()}
    by_key = {key: sorted(group) for key, group in store.by_key.items()}
    assert len(store.entries) == len(entries) and all(dot in store.entries for dot in entries)
    return entries, by_key, store.context.vector, store.context.cloud, store.fingerprint, set(graph._unattached)


def transforms(frames: FrameTree) -> Any:
    found = {}
    for target in NAMES[:3]:
        for source in NAMES:
            for at in (None, 2.5, 6.0):
                try:
                    found[target, source, at] = frames.transform(target, source, at).t
                except DsrError as error:
                    found[target, source, at] = type(error)
    batch = frames.transforms(NAMES[0], NAMES)
    return found, batch.tobytes()


def fill(world: World) -> None:
    """Something to begin with."""
    for name in NAMES:
        act(world, 0, int(name[1:]), 0, 1)
    for src, dst in ((0, 1), (1, 2), (0, 3), (3, 4)):
        for stamp in (0, 2, 4):
            act(world, 4, src, dst, stamp)
    world.remote.join(reply_to(world.it.graph.store, world.remote.store.context), 1.0)


def type_for(graph: Graph, name: str, number: int) -> str:
    """The type under which a node can be added: the present one if it is there."""
    there = graph.nodes.get(name)
    return NODE_TYPES[number % 2] if there is None else there.type


def act(world: World, action: int, a: int, b: int, value: int) -> None:  # noqa: PLR0912
    """One of the things that happen to a graph."""
    graph, name, other = world.it.graph, NAMES[a % len(NAMES)], NAMES[b % len(NAMES)]
    key = (name, other, EDGE_TYPES[value % 2])
    pose = Pose((float(value), float(a), 0.0), stamp=float(value % 8))
    now = 1.0 + value
    if action == 0:
        world.commit(graph.add_node(name, type_for(graph, name, b), {"seen": value}, now))
    elif action == 1:
        world.commit(graph.remove_node(name))
    elif action == 2 and name in graph.nodes:
        world.commit(graph.write(graph.nodes[name], {"mass": float(value)}, now))
    elif action == 3 and name in graph.nodes:
        world.commit(graph.remove_attribute(graph.nodes[name], "mass" if b % 2 else "seen", now))
    elif action == 4 and name in graph.nodes and other in graph.nodes:
        world.commit(graph.add_edge(*key, {"pose": pose}, now))
    elif action == 5:
        world.commit(graph.remove_edge(key))
    elif action == 6 and key in graph.edges:
        world.commit(graph.write(graph.edges[key], {"pose": pose, "since": float(b)}, now))
    elif action == 7:  # elsewhere, unseen here for a while
        remote = world.remote
        remote.add_node(name, type_for(remote, name, value), {"mass": float(b)}, now)
        if other in remote.nodes:
            remote.add_edge(*key, {"pose": pose}, now)
    elif action == 8:
        world.remote.remove_node(name)
    elif action == 9:
        world.join(reply_to(world.remote.store, graph.store.context))
    elif action == 10:
        world.commit(graph.make_durable())
        world.twin.graph.store.unsettled.clear()
    elif action == 11:
        for side in (world.it, world.twin):
            side.hold()
    elif action == 12 and isinstance(graph, ForkedGraph):
        graph.forget_handles()
    elif action == 13 and isinstance(graph, ForkedGraph) and value == 0:
        graph.detach()
    elif action == 14:
        world.check_frames()
