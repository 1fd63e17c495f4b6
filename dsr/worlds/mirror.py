"""Keeps one world in step with others, element by element, whatever the order in which changes arrive."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from dsr.crdt.delta import EdgeKey, Key, Write
from dsr.errors import NodeNotFoundError
from dsr.graph.elements import Edge, Node
from dsr.graph.schema import RECORDS
from dsr.graph.watch import Change
from dsr.worlds.registry import ROOT, VIA
from dsr.worlds.reparenting import Reparenting

if TYPE_CHECKING:
    from dsr.memory import Memory

Conflict = Literal["newest", "first"]
Edit = Callable[[Node | Edge, Mapping[str, Any]], Mapping[str, Any]]


class _Found(NamedTuple):
    """An element in a world that is read."""

    element: Node | Edge
    via: tuple[str, ...]
    """The worlds through which it has come until here, this one included."""


class Mirror:
    """The work of a filter; see `Filter` for its rules.

    Args:
        sources: the worlds that are read, by name, in the order of their priority.
        target: the world that is written.
        accepts: whether a node is passed on.
        accepts_edge: whether an edge is.
        edit: what its attributes are to be; they stay if None.
        conflict: which values count if several worlds have an element.
    """

    def __init__(
        self,
        sources: Mapping[str, Memory],
        target: Memory,
        accepts: Callable[[Node], bool],
        accepts_edge: Callable[[Edge], bool],
        edit: Edit | None = None,
        conflict: Conflict = "newest",
    ) -> None:
        self._sources = dict(sources)
        self._target = target
        self._accepts = accepts
        self._accepts_edge = accepts_edge
        self._edit = edit
        self._exact = edit is not None or conflict == "first"
        self._first_only = conflict == "first"
        self._reparenting = Reparenting(self._sources, target, self._may_pass, accepts_edge, self._first_only)
        self._watch = target.watch(existing=False)
        self._nodes: dict[str, None] = {}
        self._edges: dict[EdgeKey, None] = {}
        self._overruled: dict[Key, dict[str, int]] = {}
        """Stamps of the values with which we have overruled others in the target, by attribute."""
        self._gone: set[Key] = set()
        """What was removed from a source, though another one of that name may be there now."""

    def look_at_all(self) -> None:
        """Look at every element again in the next update."""
        for memory in (*self._sources.values(), self._target):
            self._nodes.update((node.name, None) for node in memory.nodes())
            self._edges.update((edge.key, None) for edge in memory.edges())

    def update(self, changes: Mapping[str, Iterable[Change]]) -> None:
        """Bring the target into step, given what has changed in each source.

        An element that `accepts` and the like fail on is left as it is; the first failure is raised at the end.
        """
        for change in (change for found in changes.values() for change in found):
            key = self._note(change)
            if change.kind == "removed":
                self._gone.add(key)
        for change in self._watch.poll():
            if change.kind == "removed" or (change.kind == "added" and not self._is_ours(change)):
                self._note(change)
        if not self._nodes and not self._edges:
            return
        failures: list[Exception] = []
        with self._target.batch():
            for name in _drained(self._nodes):
                with _kept(failures):
                    self._bring_node(name)
            self._reparenting.note(self._edges)
            with _kept(failures):
                self._reparenting.update()
            for key in _drained(self._edges):
                with _kept(failures):
                    self._bring_edge(key)
            with _kept(failures):
                self._reparenting.update()
        if failures:
            raise failures[0]

    def _note(self, change: Change) -> Key:
        if change.element == "edge":
            key = change.src, change.dst, change.type
            self._edges[key] = None
            return key
        self._nodes[change.name] = None
        return change.name

    def _is_ours(self, change: Change) -> bool:
        """Whether we have created the element of the target that came."""
        here = _of(self._target, change.name if change.element == "node" else (change.src, change.dst, change.type))
        return here is not None and self._target.created(here)

    # ---- one element

    def _bring_node(self, name: str) -> None:
        found = [self._found(world, node) for world, memory in self._sources.items() if (node := memory.get_node(name))]
        wanted = [one for one in found if isinstance(one.element, Node) and self._may_pass(one.element)]
        before = self._target.get_node(name) is not None and name not in self._gone
        self._bring(name, wanted)
        self._gone.discard(name)
        if before != (name in self._target):
            for memory in self._sources.values():
                self._edges.update((edge.key, None) for edge in (*memory.edges(src=name), *memory.edges(dst=name)))

    def _may_pass(self, node: Node) -> bool:
        return node.type not in RECORDS and (node.name == ROOT or self._accepts(node))

    def _bring_edge(self, key: EdgeKey) -> None:
        found = [self._found(world, edge) for world, memory in self._sources.items() if (edge := memory.get_edge(*key))]
        wanted = [one for one in found if isinstance(one.element, Edge) and self._accepts_edge(one.element)]
        if not wanted and self._reparenting.holds(key):
            return
        if key[0] in self._target and key[1] in self._target:
            with contextlib.suppress(NodeNotFoundError):  # an end goes at this moment, which is another change
                self._bring(key, wanted)
        self._gone.discard(key)

    def _found(self, world: str, element: Node | Edge) -> _Found:
        return _Found(element, (*filter(None, str(element.get(VIA, "")).split(",")), world))

    def _bring(self, key: Key, wanted: list[_Found]) -> None:
        """Bring one element into step with those that it is to be like."""
        target = self._target
        makers = [one for one in wanted if target.world_name not in one.via]
        here = _of(target, key)
        if here is not None and key != ROOT and target.created(here) and self._is_another(here, makers):
            target.withdraw(here)
            here = _of(target, key)
        if here is None:
            self._overruled.pop(key, None)
        if here is None and not makers:
            return
        mine = here is None or target.created(here)
        own = {VIA: ",".join(makers[0].via)} if makers and mine and key != ROOT else {}
        for one in wanted[:1] if self._first_only else wanted:
            values = None if self._edit is None else self._edit(one.element, _attributes(one.element))
            target.copy(one.element, values, **own)
            own = {}
            if self._exact:
                self._make_equal(one.element, _attributes(one.element) if values is None else values, mine)

    def _is_another(self, here: Node | Edge, makers: list[_Found]) -> bool:
        """Whether an element that we made is none that the sources hold."""
        key = here.key
        return not makers or key in self._gone or here.type != makers[0].element.type

    def _make_equal(self, element: Node | Edge, values: Mapping[str, Any], ours: bool) -> None:
        """Overrule what is newer here; and if the element is ours, take away what the input does not have."""
        target = self._target
        key: Key = element.key
        here = _of(target, key)
        if here is None:
            return
        other = {
            name: value
            for name, value in values.items()
            if here.get(name) != value and not self._came_round(key, element.newest_write(name))
        }
        if other and isinstance(here, Node):
            target.update_node(here.name, **other)
        elif other and isinstance(here, Edge):
            target.update_edge(*here.key, **other)
        if other:
            writes = {name: here.newest_write(name) for name in other}
            stamps = {name: write.stamp for name, write in writes.items() if write is not None}
            self._overruled.setdefault(key, {}).update(stamps)
        for name in set(here.attributes) - values.keys() - {VIA} if ours else ():
            target.remove_attribute(here, name)

    def _came_round(self, key: Key, write: Write | None) -> bool:
        """Whether a value is one of ours, through other worlds: changed once more, it would go round for ever."""
        return write is not None and self._overruled.get(key, {}).get(write.attribute) == write.stamp


def _of(memory: Memory, key: Key) -> Node | Edge | None:
    return memory.get_node(key) if isinstance(key, str) else memory.get_edge(*key)


def _attributes(element: Node | Edge) -> dict[str, Any]:
    return {name: value for name, value in element.attributes.items() if name != VIA}


def _drained(keys: dict[Any, None]) -> Iterator[Any]:
    """Keys one by one, taken out; also those that are added meanwhile."""
    while keys:
        key = next(iter(keys))
        del keys[key]
        yield key


@contextlib.contextmanager
def _kept(failures: list[Exception]) -> Iterator[None]:
    """Keep an exception for later."""
    try:
        yield
    except Exception as error:
        failures.append(error)
