"""Compares the prototype with the Python code: random changes of several replicas, and messages in any order.

Each site keeps a `Graph` and a `Core`, which are told the same. What both show, hold, have seen and send must be equal
after each step, byte for byte. Messages are lost, repeated, late and out of order; some are whole contents in pieces.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from benchmarks.compiled.building import new_core
from dsr.crdt.context import CausalContext, Dot
from dsr.crdt.delta import TOMBSTONE, Delta, Key
from dsr.crdt.pieces import all_pieces, reply_to
from dsr.graph.elements import Edge, Node
from dsr.graph.graph import Graph
from dsr.graph.schema import Schema, Value
from dsr.graph.watches import Watches
from dsr.math3d.transforms import Pose
from dsr.replication.claims import Claims
from dsr.replication.outbox import Outbox
from dsr.replication.piece_wire import decode_piece, encode_piece
from dsr.replication.wire import decode_delta, encode_delta

_SITES, _NAMES, _TYPES = 4, 6, ("cube", "cup", "table")
_EDGE_TYPES = ("RT", "on")
_START = 1_000_000_000.0
"""s since the Unix epoch, when the first clock begins"""
_SKEW = 3600.0
"""s by which clocks differ at most"""
Message = tuple[str, str, bytes]
"""Kind (delta, piece), replica id of the sender, bytes."""
View = dict[Key, tuple[str, dict[str, Any]]]


class DiffersError(AssertionError):
    """The prototype does something else than the Python code."""


class Site:
    """One replica, twice."""

    def __init__(self, file: Any, number: int, skew: float) -> None:
        schema = Schema()
        self.rid = f"site-{number}"
        self.graph = Graph(self.rid, schema, Watches(schema.geometric))
        self.claims = Claims(self.graph)
        self.core = new_core(file, self.rid, schema)
        self.core.watch()
        self.skew = skew
        self._outbox = Outbox()
        self._followed: View = {}

    def do(self, graph: Callable[[], Delta], core: Callable[[], object]) -> None:
        """Make one change in both."""
        self._outbox.add(graph())
        core()

    def sent(self) -> list[Message]:
        """What was written since, as messages; those of both must be the same."""
        bundles, samples = self._outbox.take()
        self._outbox.sent()
        payloads = [encode_delta(bundle) for bundle in bundles], encode_delta(samples) if samples.writes else None
        _same("messages", self.core.take(), payloads)
        return [("delta", self.rid, one) for one in [*payloads[0], payloads[1]] if one is not None]

    def receive(self, message: Message, now: float) -> None:
        """Give a message to both."""
        kind, sender, payload = message
        if kind == "piece":
            self.graph.join(decode_piece(payload).as_delta(), now)
            self.core.join_piece(payload, now)
            return
        delta = decode_delta(payload)
        is_plain = delta.live is None and self.claims.is_plain(sender, delta, None)
        self.graph.join(delta, now)
        if delta.live is not None or not self.core.receive(sender, payload, now):
            _same("plain", False, is_plain)
            self.core.join(payload, now)

    def check(self) -> None:
        """Raise `DiffersError` unless both are equal."""
        graph, store = self.graph, self.graph.store
        seen, held, visible, fingerprint, latest, waiting = self.core.state()
        context = store.context
        _same("context", seen, {
            rid: (context.vector.get(rid, 0), context.cloud.get(rid, [])) for rid in {*context.vector, *context.cloud}
        })  # fmt: skip
        _same("entries", held, {
            dot: (entry.key, entry.type, entry.sources, entry.destinations, {
                name: (write.stamp, write.writer, write.dot, _plain(write.value))
                for name, write in entry.registers.items()
            }) for dot, entry in store.entries.items()
        })  # fmt: skip
        elements: dict[Key, Node | Edge] = dict(graph.nodes) | dict(graph.edges)
        _same("visible", visible, {
            key: (element.type, tuple(entry.dot for entry in element._entries)) for key, element in elements.items()
        })  # fmt: skip
        _same("fingerprint", fingerprint, _hash_of(store.entries))
        _same("clock", latest, graph.hlc.latest)
        _same("waiting", waiting, len(store.waiting_writes()))
        for type in _TYPES:
            _same(f"nodes of type {type}", sorted(self.core.nodes(type)), sorted(graph.nodes_by_type.get(type, {})))
        self._check_poses()
        self._follow(elements)

    def _check_poses(self) -> None:
        histories = self.graph.watches.frames._histories
        for src, dst, type in self.graph.edges:
            parents = histories.get((type, dst))
            history = None if parents is None else parents.get(src)
            _same("poses", self.core.poses(src, dst, type), history._samples if history is not None else [])

    def _follow(self, elements: dict[Key, Node | Edge]) -> None:
        """Who reads what the changes name has what is shown."""
        for kind, key, type, attributes in self.core.changes():
            if kind == "r":
                self._followed.pop(key, None)
            elif kind == "a" or key in self._followed:
                known = {} if kind == "a" else self._followed[key][1]
                self._followed[key] = type, {**known, **{name: self._value(key, name) for name in attributes}}
        for _, values in self._followed.values():
            for name in [name for name, value in values.items() if value is None]:
                del values[name]
        _same("what a follower knows", self._followed, {key: (e.type, e.attributes) for key, e in elements.items()})

    def _value(self, key: Key, name: str) -> Value | None:
        get = self.core.get_node if isinstance(key, str) else self.core.get_edge
        arguments = (key, name) if isinstance(key, str) else (*key, name)
        try:
            value: Value | None = get(*arguments)
        except ValueError:  # it is gone, which a later change says
            return None
        return value


class _Run:
    """Sites, and every message that any of them ever sent."""

    def __init__(self, file: Any, seed: int) -> None:
        self._random = np.random.default_rng(seed)
        self.sites = [Site(file, number, self._random.uniform(-_SKEW, _SKEW)) for number in range(_SITES)]
        self._messages: list[Message] = []
        self._time = _START

    def step(self) -> None:
        """Do something at a random site, and compare."""
        self._time += float(self._random.exponential(0.05))
        site = self.sites[self._random.integers(_SITES)]
        acts = (self._add_node, self._add_edge, self._write, self._remove, self._deliver, self._deliver, self._answer)
        acts[self._random.integers(len(acts))](site, self._time + site.skew)
        self._messages += site.sent()
        site.check()

    def converge(self) -> None:
        """Let all answer each other until all hold the same."""
        for asker in [*self.sites, *self.sites]:
            for asked in self.sites:
                reply = reply_to(asked.graph.store, asker.graph.store.context)
                asker.receive(("delta", asked.rid, encode_delta(reply)), self._time + asker.skew)
                asker.check()
        for site in self.sites[1:]:
            ours, theirs = (one.graph.store for one in (self.sites[0], site))
            _same("what all hold", ours.entries.keys(), theirs.entries.keys())

    def _add_node(self, site: Site, now: float) -> None:
        name, type = f"n{self._random.integers(_NAMES)}", _TYPES[self._random.integers(3)]
        there = site.graph.nodes.get(name)
        type, values = there.type if there is not None else type, self._values()
        site.do(
            lambda: site.graph.add_node(name, type, values, now), lambda: site.core.add_node(name, type, values, now)
        )

    def _add_edge(self, site: Site, now: float) -> None:
        names = sorted(site.graph.nodes)
        if len(names) < 2:
            return
        ends = sorted(self._random.choice(len(names), 2, replace=False))  # no circles
        type = _EDGE_TYPES[self._random.integers(2)]
        key = names[ends[0]], names[ends[1]], type
        values: dict[str, Any] = {"pose": self._pose()} if type == "RT" else {"order": int(self._random.integers(9))}
        site.do(lambda: site.graph.add_edge(*key, values, now), lambda: site.core.add_edge(*key, values, now))

    def _write(self, site: Site, now: float) -> None:
        elements: list[Node | Edge] = [*site.graph.nodes.values(), *site.graph.edges.values()]
        if not elements:
            return
        element = elements[self._random.integers(len(elements))]
        write = site.core.write_node if isinstance(element, Node) else site.core.write_edge
        key = (element.key,) if isinstance(element.key, str) else element.key
        if len(element) and self._random.random() < 0.2:
            name = str(self._random.choice(sorted(element)))
            name = "pose" if isinstance(element, Edge) and name not in element.written else name
            site.do(
                lambda: site.graph.remove_attribute(element, name, now), lambda: write(*key, {name: None}, now)
            )
            return
        values = {"pose": self._pose()} if element.type == "RT" else self._values()
        site.do(lambda: site.graph.write(element, values, now), lambda: write(*key, values, now))

    def _remove(self, site: Site, now: float) -> None:
        keys: list[Key] = [*site.graph.nodes, *site.graph.edges]
        if not keys or self._random.random() < 0.4:
            return
        key = keys[self._random.integers(len(keys))]
        if isinstance(key, str):
            site.do(lambda: site.graph.remove_node(key), lambda: site.core.remove_node(key))
        else:
            site.do(lambda: site.graph.remove_edge(key), lambda: site.core.remove_edge(*key))

    def _deliver(self, site: Site, now: float) -> None:
        """Any message ever sent, again and late as it likes; more often a new one."""
        if self._messages:
            recent = self._messages[-8:] if self._random.random() < 0.7 else self._messages
            site.receive(recent[self._random.integers(len(recent))], now)

    def _answer(self, site: Site, now: float) -> None:
        """What somebody else holds: a reply to what was seen here, or a piece of everything."""
        other = self.sites[self._random.integers(_SITES)]
        store = other.graph.store
        pieces = list(all_pieces(store, CausalContext()))
        _same("pieces", [_content(decode_piece(one)) for one in other.core.pieces()], list(map(_content, pieces)))
        if self._random.random() < 0.5:
            self._messages.append(("delta", other.rid, encode_delta(reply_to(store, site.graph.store.context))))
        else:
            self._messages.append(("piece", other.rid, encode_piece(pieces[0])))
        site.receive(self._messages[-1], now)

    def _values(self) -> dict[str, Any]:
        random = self._random
        all_values: dict[str, Any] = {
            "order": int(random.integers(-(1 << 40), 1 << 40) >> int(random.integers(40))),
            "mass": float(random.normal()),
            "visible": bool(random.integers(2)),
            "note": "µ" * int(random.integers(3)) + "x" * int(random.integers(40)),
            "size": tuple(float(number) for number in random.normal(size=3)),
        }
        return {name: value for name, value in all_values.items() if random.random() < 0.4}

    def _pose(self) -> Pose:
        stamp = 0.0 if self._random.random() < 0.2 else self._time + float(self._random.normal(scale=8.0))
        return Pose(self._random.normal(size=3).tolist(), (0.0, 0.0, 0.6, 0.8), stamp)


def compare(file: Any, seed: int, steps: int) -> None:
    """Do `steps` random things with replicas of both. Raises `DiffersError` where they differ."""
    run = _Run(file, seed)
    for _ in range(steps):
        run.step()
    run.converge()


def _content(piece: Any) -> tuple[Any, ...]:
    delta = piece.as_delta()
    writes = [(w.owner, w.attribute, w.stamp, w.writer, w.dot, _plain(w.value)) for w in piece.writes]
    return piece.adds, writes, delta.context, sorted(piece.examined), sorted(piece.whole or ()), piece.begin, piece.end


def _hash_of(dots: Iterable[Dot]) -> int:
    """The fingerprint of the compiled core: of the live dots alone, and not of what was made under them."""
    fingerprint = 0
    for rid, counter in dots:
        tail = int.from_bytes(rid.encode()[-8:], "little") * 0x9E3779B97F4A7C15
        mixed = (tail + counter * 0xBF58476D1CE4E5B9) & ((1 << 64) - 1)
        fingerprint ^= mixed ^ (mixed >> 29)
    return fingerprint


def _plain(value: Any) -> Any:
    return None if value is TOMBSTONE else value


def _same(what: str, ours: Any, oracle: Any) -> None:
    if ours != oracle:
        raise DiffersError(f"{what}: the prototype has {ours!r}, Python {oracle!r}")
