"""Two replicas of a graph, each with a replica of an overlay, and what an overlay must show by its definition."""

from __future__ import annotations

from typing import Any

from dsr import Pose
from dsr.crdt.context import Dot
from dsr.crdt.delta import TOMBSTONE, Delta, Write
from dsr.crdt.pieces import reply_to
from dsr.crdt.store import Incarnation
from dsr.errors import DsrError
from dsr.frames.tree import FrameTree
from dsr.graph.elements import Edge, Node
from dsr.graph.graph import Graph
from dsr.graph.watches import Watches
from dsr.worlds.overlay import Overlay
from dsr.worlds.overlay_frames import OverlayFrames
from tests.dsr.worlds.copies import EDGE_TYPES, NAMES, SCHEMA, indexes, key_of, shown, type_for


class Mirror(Watches):
    """What is there by all that was told."""

    def __init__(self, frames: FrameTree | None = None) -> None:
        super().__init__({"RT"}, frames)
        self.elements: dict[Any, dict[str, Any]] = {}

    def added(self, element: Node | Edge) -> None:
        assert key_of(element) not in self.elements, f"{element} was there already"
        self.elements[key_of(element)] = dict(element)
        super().added(element)

    def removed(self, element: Node | Edge) -> None:
        assert self.elements.pop(key_of(element), None) is not None, f"{element} was not there"
        super().removed(element)

    def updated(self, element: Node | Edge, attribute: str) -> None:
        attributes = self.elements[key_of(element)]
        value = element.get(attribute)
        if value is None:
            attributes.pop(attribute, None)
        else:
            attributes[attribute] = value
        super().updated(element, attribute)


class Place:
    """A replica of the base, and one of the overlay."""

    def __init__(self, name: str) -> None:
        self.told = Mirror()
        self.base = Graph(f"{name}", SCHEMA, self.told)
        self.mirror = Mirror(OverlayFrames(self.told.frames))
        frames: Any = self.mirror.frames
        self.overlay = Overlay(f"{name}w", self.base, self.mirror, frames)

    def check(self, *, frames: bool) -> None:
        nodes, edges = expected(self.base, self.overlay)
        theirs = shown(self.overlay)
        assert {name: (type, values) for name, (type, values, _) in theirs[0].items()} == nodes
        assert {key: values for key, (values, _) in theirs[1].items()} == edges
        told = {key: values for key, values in self.mirror.elements.items() if isinstance(key, str)}
        assert told == {name: values for name, (_, values) in nodes.items()}
        assert {key: values for key, values in self.mirror.elements.items() if not isinstance(key, str)} == edges
        check_indexes(self.overlay)
        if frames:
            plain = FrameTree()
            for (src, dst, type), values in edges.items():
                if type == "RT" and "pose" in values:
                    plain.follow(type, src, dst, values["pose"])
            assert newest(self.overlay, self.mirror.frames) == newest(self.overlay, plain)


def expected(base: Graph, overlay: Overlay) -> tuple[dict[str, Any], dict[Any, Any]]:
    """Nodes with type and attributes, and edges, by the definition of an overlay."""
    layer = overlay.store
    below = {dot: entry for dot, entry in base.store.entries.items() if dot not in layer.context}
    live = {**below, **layer.entries}

    def seen(entry: Incarnation) -> bool:
        ends = (entry.sources, entry.destinations)
        return isinstance(entry.key, str) or all(any(dot in live for dot in dots) for dots in ends)

    groups: dict[Any, list[Incarnation]] = {}
    for entry in live.values():
        if seen(entry):
            groups.setdefault(entry.key, []).append(entry)
    nodes, edges = {}, {}
    for key, entries in groups.items():
        values = attributes(entries, below, layer.entries, layer.patches)
        if isinstance(key, str):
            deciding = [entry for entry in entries if entry.dot in layer.entries] or entries
            nodes[key] = max(deciding, key=lambda entry: entry.dot).type, values
        else:
            edges[key] = values
    return nodes, edges


def attributes(
    entries: list[Incarnation], below: dict[Dot, Incarnation], own: Any, patches: dict[Dot, Incarnation]
) -> dict[str, Any]:
    layers = (
        [own.get(entry.dot) or patches.get(entry.dot) for entry in entries],
        [below.get(entry.dot) for entry in entries],
    )
    found: dict[str, Any] = {}
    for layer in reversed(layers):
        writes: dict[str, Write] = {}
        for entry in layer:
            for name, write in ({} if entry is None else entry.registers).items():
                best = writes.setdefault(name, write)
                if (best.stamp, best.writer) < (write.stamp, write.writer):
                    writes[name] = write
        found |= {name: write.value for name, write in writes.items()}
    return {name: value for name, value in found.items() if value is not TOMBSTONE}


def check_indexes(graph: Graph) -> None:
    """Each index holds what is seen, by its names."""
    nodes, edges = list(graph.nodes.values()), list(graph.edges.values())
    by_type = [(node.type, node.name) for node in nodes]
    wanted = [
        by_type,
        [(edge.type, edge.key) for edge in edges],
        [(edge.src, edge.key) for edge in edges],
        [(edge.dst, edge.key) for edge in edges],
    ]
    for found, pairs in zip(indexes(graph)[:4], wanted, strict=True):
        assert sorted((name, key) for name, keys in found.items() for key in keys) == sorted(pairs)


def newest(graph: Graph, frames: FrameTree) -> Any:
    found = {}
    for target in NAMES[:3]:
        for source in NAMES:
            try:
                found[target, source] = frames.transform(target, source).t
            except DsrError as error:
                found[target, source] = type(error)
    return found


class Network:
    """Two places and what is under way between them."""

    def __init__(self) -> None:
        self.places = [Place("a"), Place("b")]
        self.deltas: list[tuple[bool, Delta]] = []

    def act(self, action: int, where: int, a: int, b: int, value: int) -> None:
        place = self.places[where % 2]
        upper = where % 4 < 2
        graph: Graph = place.overlay if upper else place.base
        delta = change(graph, action, a, b, value)
        if delta is not None and (any(w.dot for w in delta.writes) or not delta.writes):
            self.deltas.append((upper, delta))
        if action == 7 and self.deltas:  # one of all that was ever sent arrives, perhaps again
            upper, delta = self.deltas[value % len(self.deltas)]
            for other in self.places:
                (other.overlay if upper else other.base).join(delta, 1.0)
        if action == 8:
            self.reply(where % 2, upper=upper)

    def reply(self, where: int, *, upper: bool) -> None:
        to, sender = self.places[where], self.places[1 - where]
        theirs, ours = (sender.overlay, to.overlay) if upper else (sender.base, to.base)
        ours.join(reply_to(theirs.store, ours.store.context), 1.0)

    def make_durable(self) -> None:
        for place in self.places:
            place.base.make_durable()
            place.overlay.make_durable()
        for _ in range(3):
            for where in (0, 1):
                self.reply(where, upper=False)
                self.reply(where, upper=True)
        for place in self.places:  # what is said of what is gone goes, and that is told, too
            place.overlay.make_durable()
            assert all(place.base.element(dot) for dot in place.overlay.store.patches)
        for where in (0, 1):
            self.reply(where, upper=True)


def change(graph: Graph, action: int, a: int, b: int, value: int) -> Delta | None:  # noqa: PLR0911
    name, other = NAMES[a % len(NAMES)], NAMES[b % len(NAMES)]
    key = (name, other, EDGE_TYPES[value % 2])
    pose = Pose((float(value), float(a), 0.0), stamp=float(value % 8))
    now = 1.0 + value
    if action == 0:
        return graph.add_node(name, type_for(graph, name, b), {"seen": value}, now)
    if action == 1:
        return graph.remove_node(name)
    if action == 2 and name in graph.nodes:
        return graph.write(graph.nodes[name], {"mass": float(value)}, now)
    if action == 3 and name in graph.nodes:
        return graph.remove_attribute(graph.nodes[name], "mass" if b % 2 else "seen", now)
    if action == 4 and name in graph.nodes and other in graph.nodes:
        return graph.add_edge(*key, {"pose": pose}, now)
    if action == 5:
        return graph.remove_edge(key)
    if action == 6 and key in graph.edges:
        return graph.write(graph.edges[key], {"pose": pose, "since": float(b)}, now)
    if action == 9:
        return graph.make_durable()
    if action == 10:
        graph.forget_handles()
    return None
