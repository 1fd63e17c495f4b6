"""The worlds that a process has open: opened, forked, kept in step with the list of worlds, and dropped."""

from __future__ import annotations

import contextlib
import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from dsr.clock import Clock
from dsr.crdt.context import CausalContext
from dsr.crdt.delta import Delta
from dsr.crdt.pieces import reply_to
from dsr.errors import TransportError, WorldError, WorldNotFoundError, suggest
from dsr.frames.tree import FrameTree
from dsr.graph.elements import Node
from dsr.graph.graph import Graph
from dsr.graph.schema import WORLD_RECORD, Schema
from dsr.graph.watch import ChangeFilter, Watch
from dsr.graph.watches import Watches
from dsr.network.keys import BASE, Keys, check_name
from dsr.network.transport import Transport
from dsr.parts.graph import PartedGraph
from dsr.replication.holders import Holders
from dsr.replication.polling import Poller
from dsr.replication.replica import Replica
from dsr.worlds.fork import ForkedGraph
from dsr.worlds.fork_frames import ForkedFrames
from dsr.worlds.overlay import Overlay
from dsr.worlds.overlay_frames import OverlayFrames
from dsr.worlds.registry import (
    BASE_INFO,
    MOST_OVERLAYS,
    ROOT,
    Record,
    WorldInfo,
    are_one,
    circle_of,
    find_record,
    followers_of,
    is_orphan,
    is_too_deep,
    node_name,
    records,
    to_attribute,
)

_log = logging.getLogger("dsr.worlds")


class OpenWorld:
    """The memory of one world as the list of worlds uses it; the base of `Memory`."""

    graph_name: str
    agent: str
    keys: Keys
    rid: str
    clock: Clock
    transport: Transport
    schema: Schema
    replica: Replica
    who_holds: Holders
    """Asks the other processes who holds a world."""
    world_handle: WorldHandle | None
    """The handle of a world other than the base; None for the base."""
    _frames: FrameTree
    _watches: Watches

    @property
    def closed(self) -> bool:
        """See `WorldAccess.closed`."""
        raise NotImplementedError

    def add_node(self, name: str, type: str, /, **attributes: Any) -> Node:
        """See `Memory.add_node`."""
        raise NotImplementedError

    def write_record(self, name: str, type: str, record: str) -> None:
        """See `Memory.write_record`."""
        raise NotImplementedError

    def remove_record(self, name: str, type: str) -> None:
        """See `Memory.remove_record`."""
        raise NotImplementedError

    def poll(self) -> None:
        """See `WorldAccess.poll`."""
        raise NotImplementedError

    def flush(self) -> None:
        """See `WorldAccess.flush`."""
        raise NotImplementedError

    def close(self) -> None:
        """See `Memory.close`."""
        raise NotImplementedError

    def drop(self) -> None:
        """See `WorldAccess.drop`."""
        raise NotImplementedError

    def move(self, keys: Keys) -> None:
        """See `WorldAccess.move`."""
        raise NotImplementedError


World = TypeVar("World", bound=OpenWorld)


@dataclass
class WorldHandle:
    """The handle that makes a `Memory` one of a world other than the base."""

    record: Record
    rid: str
    worlds: Worlds[Any]
    source: OpenWorld | None
    """The world from which this one begins; None for an empty one."""
    content: tuple[Delta, ...] = ()
    """Deltas that were kept of the world, with which it begins, too."""

    def keys(self, graph: str) -> Keys:
        """The keys of the world."""
        return Keys(graph, self.record.info.name, self.record.channel)

    def watches(self) -> Watches:
        """Make the watches over the world's graph, which know its first content."""
        return Watches(self.worlds.base.schema.geometric, self._frames())

    def _frames(self) -> FrameTree | None:
        if self.source is None:
            return None
        theirs = self.source.replica.graph
        if self.record.info.follows:
            return OverlayFrames(self.source._frames)
        return None if isinstance(theirs, Overlay | PartedGraph) else ForkedFrames(self.source._frames)

    def graph(self, watches: Watches) -> Graph:
        """Make the world's graph with its first content."""
        graph = self._begun(watches)
        for delta in self.content:
            graph.join(delta, self.worlds.base.clock.now())
        self.content = ()
        return graph

    def _begun(self, watches: Watches) -> Graph:
        if self.source is None:
            return Graph(self.rid, self.worlds.base.schema, watches)
        parent = self.source.replica.graph
        if isinstance(watches.frames, OverlayFrames):
            return Overlay(self.rid, parent, watches, watches.frames)
        if not isinstance(parent, Overlay | PartedGraph):
            return ForkedGraph(self.rid, parent, watches)
        graph = Graph(self.rid, parent.schema, watches)
        graph.join(parent.flattened(), self.worlds.base.clock.now())
        return graph


class Worlds(Generic[World]):
    """All worlds of one memory, which is the one of the base.

    Args:
        base: the memory of the base.
        memory_for: makes the memory of another world.
        threaded: whether replicas run threads of their own.
        lock: held while any graph of the memory is changed.
    """

    def __init__(
        self, base: World, memory_for: Callable[[WorldHandle], World], *, threaded: bool, lock: threading.RLock
    ) -> None:
        self.base = base
        self._memory_for = memory_for
        self.threaded = threaded
        self.lock = lock
        self.poller = Poller(base.clock)
        """Does what is due in all of them, if they are threaded."""
        self._open: dict[str, World] = {}
        self._opening = threading.RLock()
        self._count = 0
        self._watch: Watch | None = None
        self._changes, self._swept = 0, -1
        """How often the list, or what is open, has changed; and at which of these changes all of it was looked at."""

    # ---- the list

    def list(self) -> list[WorldInfo]:
        """All worlds, the base first, the others by name."""
        return [BASE_INFO, *(record.info for record in records(self.base.replica.graph))]

    def _record(self, name: str) -> Record:
        found = find_record(self.base.replica.graph, name)
        if found is None:
            known = [info.name for info in self.list()]
            raise WorldNotFoundError(f"no world {name!r}; {suggest(name, known)}")
        return found

    # ---- making and opening

    def channels(self) -> dict[str, str]:
        """Names of all worlds but the base, with the channels on which their replicas meet."""
        return {record.info.name: record.channel for record in records(self.base.replica.graph)}

    def hold(self, name: str, timeout: float, content: tuple[Delta, ...] = ()) -> World:
        """See `Memory.hold_world`."""
        with self._opening:
            if not content or name in self._open:
                with contextlib.suppress(WorldNotFoundError):
                    memory = self.open(name, timeout)
                    for delta in content:
                        with self.lock:
                            memory.replica.graph.join(delta, self.base.clock.now())
                    return memory
            memory = self._join(name, timeout, content)
            memory.replica.synchroniser.nobody_there()
            return memory

    def open(self, name: str, timeout: float) -> World:
        """See `Memory.world`."""
        if name == BASE:
            return self.base
        with self._opening:
            self.sweep()
            if name in self._open:
                return self._open[name]
            memory = self._join(name, timeout)
            try:
                self._wait_joined(memory, name, timeout)
            except BaseException:
                memory.close()
                raise
            return memory

    def _join(self, name: str, timeout: float, content: tuple[Delta, ...] = ()) -> World:
        """Take part in a world that is listed; its parent, too, if it looks through to that."""
        record = self._record(name)
        info, graph = record.info, self.base.replica.graph
        if circle := circle_of(graph, record):
            raise WorldNotFoundError(f"world {name!r} is empty: {', '.join(circle)} show one another; delete one")
        if is_too_deep(graph, record):
            raise WorldError(f"world {name!r} is the last of more than {MOST_OVERLAYS} that show one another")
        if is_orphan(graph, record):
            raise WorldNotFoundError(f"world {name!r} shows {info.parent!r}, which was deleted; delete {name!r}, too")
        below = self.hold(info.parent, timeout) if info.follows and info.parent is not None else None
        return self._take_world_handle(record, below, content=content)

    def create(self, name: str, *, exist_ok: bool, timeout: float) -> World:
        """See `Memory.create_world`."""
        with self._opening:
            if self._is_known(name):
                if not exist_ok:
                    raise WorldError(f"world {name!r} exists already; open it with world({name!r})")
                with contextlib.suppress(WorldNotFoundError):
                    return self.open(name, timeout)
                memory = self._join(name, timeout)
            else:
                memory = self._make(WorldInfo(name), None)
            memory.replica.synchroniser.nobody_there()
            memory.add_node(ROOT, ROOT)
            return memory

    def fork(self, name: str, of: str, *, follow: bool, timeout: float) -> World:
        """See `Memory.fork`."""
        with self._opening:
            if self._is_known(name):
                raise WorldError(f"world {name!r} exists already; delete it or take another name")
            source = self.open(of, timeout)
            under = None if source.world_handle is None else source.world_handle.record
            if follow and under is not None and is_too_deep(self.base.replica.graph, under, and_one_more=True):
                raise WorldError(f"world {name!r} would be one of more than {MOST_OVERLAYS} that show one another")
            memory = self._make(WorldInfo(name, of, follow), source)
            memory.replica.synchroniser.nobody_there()
            return memory

    def _is_known(self, name: str) -> bool:
        check_name("world name", name)
        return name == BASE or find_record(self.base.replica.graph, name) is not None

    def _make(self, info: WorldInfo, source: World | None) -> World:
        """List a new world and open it."""
        base = self.base
        info = WorldInfo(info.name, info.parent, info.follows, base.agent, base.clock.now())
        rid = self._new_rid(source)
        with self.lock:
            world_handle = None if source is None or not info.follows else source.world_handle
            value = to_attribute(info, rid, () if world_handle is None else world_handle.record.dots)
            base.write_record(node_name(info.name), WORLD_RECORD, value)
            return self._take_world_handle(self._record(info.name), source, rid)

    def _new_rid(self, source: World | None) -> str:
        """A replica id that was not used in any world, and of which nobody claims to have seen anything in `source`.

        It is unlike the base's, for counters must not be reused.
        """
        while True:
            self._count += 1
            rid = f"{self.base.rid}w{self._count}"
            if source is None or not source.replica.graph.store.context.knows(rid):
                return rid

    def _take_world_handle(
        self, record: Record, source: World | None, rid: str = "", content: tuple[Delta, ...] = ()
    ) -> World:
        """Open a world. Raises `TransportError` once the base is closed, for nobody would close the world."""
        world_handle = WorldHandle(record, rid or self._new_rid(source), self, source, content)
        with self.lock:
            if self.base.closed:
                raise TransportError(f"the memory of graph {self.base.graph_name!r} is closed")
            memory = self._memory_for(world_handle)
            self._open = {**self._open, record.info.name: memory}
            self._changes += 1
        return memory

    def _wait_joined(self, memory: World, name: str, timeout: float) -> None:
        def move() -> None:
            memory.transport.pump()
            memory.poll()

        holders, place = memory.who_holds, memory.keys.place
        holders.ask(place)
        answered = False
        try:
            answered = holders.gathered(memory.replica, place, None if self.threaded else move, timeout)
            if answered:
                return
            why = holders.trouble(memory.replica, place)
        finally:
            holders.settle(place, answered=answered)
        if why:
            raise TransportError(f"world {name!r}: not complete after {timeout:.1f} s, {why}")
        raise WorldNotFoundError(f"world {name!r} is listed, but nobody holds it any more")

    # ---- going

    def delete(self, name: str) -> None:
        """See `Memory.delete_world`."""
        if name == BASE:
            raise WorldError(f"world {BASE!r} is the system's own: it cannot be deleted")
        record, graph = self._record(name), self.base.replica.graph
        followers = [other.info.name for other in followers_of(graph, record)]
        if followers and name not in circle_of(graph, record):
            raise WorldError(f"world {name!r} is followed by {', '.join(followers)}: delete those first")
        self.base.remove_record(node_name(name), WORLD_RECORD)
        self.sweep()

    def sweep(self) -> None:
        """Drop what is not in the list any more, and meet where the list says; called after each poll of the base."""
        if not self._open or self._swept == self._changes or not self._opening.acquire(blocking=False):
            return
        try:
            self._watch_list()
            changes = self._changes
            for name, memory in list(self._open.items()):
                if self.base.closed:  # worlds that close are not to be opened anew
                    return
                self._follow_list(name, memory)
            self._swept = changes
        finally:
            self._opening.release()

    def _watch_list(self) -> None:
        """Count the changes of the list from now on."""
        if self._watch is None:
            self._watch = Watch(ChangeFilter(node_types=frozenset({WORLD_RECORD})), notify=self._outdate)
            self.base.replica.graph.watches.follow(self._watch, ())

    def _outdate(self) -> None:
        if self._watch is not None:
            self._watch.poll()
        self._changes += 1

    def _follow_list(self, name: str, memory: World) -> None:
        world_handle = memory.world_handle
        assert world_handle is not None
        record = find_record(self.base.replica.graph, name)
        if record is None or not (record.dots & world_handle.record.dots):
            _log.info("world %r was deleted", name)
            memory.drop()
            return
        if not are_one(record, world_handle.record):
            _log.warning("world %r was made elsewhere at the same time, and what was made here is dropped", name)
            memory.drop()
            return
        if is_orphan(self.base.replica.graph, record):
            _log.warning("world %r is dropped: %r, which it shows, was deleted", name, record.info.parent)
            memory.drop()
            return
        if circle := circle_of(self.base.replica.graph, record):
            _log.warning("world %r is dropped: %s show one another", name, ", ".join(circle))
            memory.drop()
            return
        if record.info.follows and world_handle.source is not None and world_handle.source.closed:
            self._show_anew(name, memory)
            return
        moved, world_handle.record = record.channel != world_handle.record.channel, record
        if moved:
            memory.move(world_handle.keys(memory.graph_name))

    def _show_anew(self, name: str, memory: World) -> None:
        """The world that an overlay shows was dropped here for another one: the overlay goes on over that one.

        It keeps what was written into it. Nobody is waited for.
        """
        with self.lock:
            content, joined = reply_to(memory.replica.graph.store, CausalContext()), memory.replica.synchroniser.joined
        _log.warning("world %r is opened anew, for what it shows is another world now", name)
        memory.drop()
        try:
            opened = self._joined_by(name, (content,))
        except TransportError:
            if self.base.closed:
                return
            raise
        if joined:
            opened.replica.synchroniser.nobody_there()

    def _joined_by(self, name: str, content: tuple[Delta, ...] = ()) -> World:
        """Take part in a world, and in what it shows, and let all that comes later come."""
        record = self._record(name)
        below = record.info.looks_through_to
        source = self.base if below == BASE else None
        if below is not None and source is None:
            source = self._open[below] if below in self._open else self._joined_by(below)
        return self._take_world_handle(record, source, content=content)

    def forget(self, memory: World) -> None:
        """Called by a memory that closes."""
        with self.lock:
            self._open = {name: other for name, other in self._open.items() if other is not memory}
            self._changes += 1

    def opened(self) -> tuple[World, ...]:
        """The worlds beside the base that are open."""
        return tuple(self._open.values())

    def each(self, act: Callable[[World], None]) -> None:
        """Do something with every open world."""
        for memory in list(self._open.values()):
            act(memory)

    def close(self) -> None:
        """Close all that is open."""
        self.each(lambda memory: memory.close())
