"""The part of a `Memory` that makes, opens, lists and deletes worlds."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, Generic

from msgspec.structs import replace

from dsr.crdt.context import Dot
from dsr.crdt.delta import TOMBSTONE, Delta, Write
from dsr.frames.tree import FrameTree
from dsr.geometry.exchange import MeshExchange
from dsr.graph.elements import Edge, Node, types_of
from dsr.graph.graph import Graph
from dsr.network.keys import BASE, Keys, agent_of
from dsr.replication.replica import Replica
from dsr.worlds.opened import OpenWorld, World, Worlds
from dsr.worlds.registry import VIA, WorldInfo

TIMEOUT = 5.0
"""s within which others must hand on a world that is opened."""
_NOBODY: Dot = ("", 0)


class WorldAccess(OpenWorld, Generic[World]):
    """Base of `Memory`: each memory is one of a world, and leads to all others."""

    _worlds: Worlds[World]
    _replica: Replica
    _graph: Graph
    _closed: bool
    meshes: MeshExchange
    keys: Keys

    def _check_write(
        self, element: str, types: Sequence[str], attributes: Iterable[str], *, own: bool = False
    ) -> None:
        raise NotImplementedError

    def _put(self, write: Callable[[], Delta]) -> Delta:
        raise NotImplementedError

    @property
    def world_name(self) -> str:
        """Name of this world; `base` is the one that the system was launched with."""
        return self.world_handle.record.info.name if self.world_handle else BASE

    def worlds(self) -> list[WorldInfo]:
        """All worlds of the system: the base first, the others by name."""
        return self._worlds.list()

    def opened_worlds(self) -> list[World]:
        """The base and all other worlds that are open in this process."""
        return [self._worlds.base, *self._worlds.opened()]

    def world(self, name: str, *, timeout: float = TIMEOUT) -> World:
        """The world `name`, complete; the same memory as long as it is open. It closes with the base's.

        Without threads and with slow messages it may be complete only after further polls: see `joined`.

        Raises:
            WorldNotFoundError: if there is none, or nobody holds it any more.
            TransportError: if those who hold it do not answer within `timeout` s.
        """
        return self._worlds.open(name, timeout)

    def create_world(self, name: str, *, exist_ok: bool = False, timeout: float = TIMEOUT) -> World:
        """A new world that holds nothing but the root node `world`.

        With `exist_ok`, the one of that name if there is one, as it is; if nobody holds it any more, it begins anew.
        The right to make worlds is the right to write nodes of type `world_record`, and the root's type `world`.

        Raises:
            WorldError: if there is one already.
            ConfigError: for a name that cannot be used.
            AgentError: if this agent may not make worlds.
        """
        return self._worlds.create(name, exist_ok=exist_ok, timeout=timeout)

    def fork(self, name: str, of: str | None = None, *, follow: bool = False, timeout: float = TIMEOUT) -> World:
        """A new world that begins as the world `of` (by default this one) is here and now.

        From then on the two go their own ways. Nodes and edges keep their identity: the same names, and the same
        creation dots. With `follow` the new world is an overlay: it shows what it holds of its own, and everything else
        live from `of`, attribute by attribute.

        Raises:
            WorldError: if there is a world `name` already.
            WorldNotFoundError: if there is no world `of`.
            ConfigError: for a name that cannot be used.
            AgentError: if this agent may not make worlds.
        """
        return self._worlds.fork(name, of or self.world_name, follow=follow, timeout=timeout)

    def hold_world(self, name: str, *, content: Iterable[Delta] = (), timeout: float = TIMEOUT) -> World:
        """The world `name`, with nothing in it if nobody holds it any more: for whoever has kept its state.

        With `content`, what was kept of it, the world has that from the first moment, and nobody is waited for.

        Raises:
            WorldNotFoundError: if it is not in the list.
            TransportError: if those who hold it do not answer within `timeout` s.
        """
        return self._worlds.hold(name, timeout, tuple(content))

    def world_channels(self) -> dict[str, str]:
        """Names of the worlds beside the base, each with what tells it from others that ever had its name."""
        return self._worlds.channels()

    def delete_world(self, name: str) -> None:
        """Delete a world without trace: every process drops it as soon as it hears of it.

        What somebody still writes into it is lost, and a world made later under that name begins without it.

        Raises:
            WorldNotFoundError: if there is none.
            WorldError: for the base, and for a world that others follow.
            AgentError: if this agent may not delete worlds.
        """
        self._worlds.delete(name)

    def copy(self, element: Node | Edge, values: Mapping[str, Any] | None = None, /, **own: Any) -> bool:
        """Repeat an element of another world here; false if there was nothing to write.

        It is created if it is not here. Each value is written as of the time at which it was written there, so that
        newer ones stay, and what has come round through other worlds is not written again. Its attribute `via`, which
        tells how it came into that world, is not repeated.

        Args:
            element: of the other world.
            values: its attributes with the values that they are to have here; as they are there if None. Values of
                attributes that it does not have count as written when it was last written.
            own: attributes to be written as of now, unless they are set so already.

        Raises:
            NodeNotFoundError: if an end of an edge is not here.
            SchemaError: for values of `values` or `own` that do not fit.
            AgentError: if this agent may not write that.
        """
        key = element.key
        writes = list(_writes(element, None if values is None else self.schema.to_values(values)))
        with self._replica.lock:
            graph = self._replica.graph
            here = graph.nodes.get(key) if isinstance(key, str) else graph.edges.get(key)
            for name, value in self.schema.to_values(own).items():
                if here is None or here.get(name) != value:
                    writes.append(Write(_NOBODY, name, 0, "", None, value))
            kind = "node" if isinstance(key, str) else "edge"
            self._check_write(kind, (element.type,), [write.attribute for write in writes])
            delta = self._put(lambda: graph.copy(key, element.type, writes, self.clock.now()))
        if delta:
            self._replica.send_soon()
        return bool(delta)

    def withdraw(self, element: Node | Edge) -> bool:
        """Take back an element of this world as far as this agent created it, in this run or an earlier one.

        It stays if others created it too. False if this agent did not. Raises `AgentError` if it may not write it.
        """
        key = element.key
        with self._replica.lock:
            self._check_write("node" if isinstance(key, str) else "edge", types_of(element), ())
            delta = self._replica.graph.withdraw(key, lambda rid: agent_of(rid) == self.agent)
            if delta:
                self._replica.commit(delta)
        if delta:
            self._replica.send_soon()
        return bool(delta)

    def created(self, element: Node | Edge) -> bool:
        """Whether this agent created the element, in this run or an earlier one, alone or with others."""
        return any(agent_of(rid) == self.agent for rid, _ in element.created)

    @property
    def closed(self) -> bool:
        """Whether this memory was closed, or its world deleted; then nothing changes in it any more."""
        return self._closed

    def poll(self) -> None:
        """Merge what has arrived, also in the worlds opened from here; only needed without threads."""
        self._replica.poll()
        if self.world_handle is None:
            self._worlds.each(lambda memory: memory.poll())
            if self.meshes.busy:
                self.meshes.poll()

    def flush(self) -> None:
        """Hand what was written to the network now, also in the worlds opened from here; needed without threads."""
        self._replica.flush()
        if self.world_handle is None:
            self._worlds.each(lambda memory: memory.flush())

    def drop(self) -> None:
        """Close, and hold nothing any more: the world was deleted. Called by what keeps the list of worlds."""
        self.close()
        with self._replica.lock:
            self._graph.clear()
            self._graph.why_empty = f"world {self.world_name!r} was deleted"
            self._watches.frames = self._frames = FrameTree()

    def move(self, keys: Keys) -> None:
        """Go on meeting the other replicas of this world under other keys; called by what keeps the list of worlds."""
        self.keys = keys
        self._replica.move(keys)


def _writes(element: Node | Edge, values: Mapping[str, Any] | None) -> Iterator[Write]:
    """The writes that the element's present values are from, those that took one away included."""
    latest = 0
    for name in sorted(element.written - {VIA}):
        write = element.newest_write(name)
        if write is None:
            continue
        latest = max(latest, write.stamp)
        if values is None or write.value is TOMBSTONE:
            yield write
        elif name in values:
            yield replace(write, value=values[name])
    given = values or {}
    for name in sorted(given.keys() - element.written):
        yield Write(_NOBODY, name, latest, "", None, given[name])
