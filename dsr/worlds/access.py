"""The part of a `Memory` that makes, opens, lists and deletes worlds."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dsr.followers import Followers
from dsr.frames import FrameTree
from dsr.geometry.exchange import MeshExchange
from dsr.graph import Graph
from dsr.keys import BASE, Keys
from dsr.replica import Replica
from dsr.worlds.opened import Seat, Worlds
from dsr.worlds.registry import WorldInfo

if TYPE_CHECKING:
    from dsr.memory import Memory

TIMEOUT = 5.0
"""s that others get to hand on a world that is opened."""


class WorldAccess:
    """Base of `Memory`: each memory is one of a world, and leads to all others."""

    _worlds: Worlds
    _replica: Replica
    _graph: Graph
    _followers: Followers
    _frames: FrameTree
    _closed: bool
    meshes: MeshExchange
    keys: Keys
    seat: Seat | None
    """What makes it a memory of another world than the base; None for the base."""

    def close(self) -> None:
        """See `Memory.close`."""
        raise NotImplementedError

    @property
    def world_name(self) -> str:
        """Name of this world; `base` is the one that the system was launched with."""
        return self.seat.record.info.name if self.seat else BASE

    def worlds(self) -> list[WorldInfo]:
        """All worlds of the system: the base first, the others by name."""
        return self._worlds.list()

    def world(self, name: str, *, timeout: float = TIMEOUT) -> Memory:
        """The world `name`, complete; the same memory as long as it is open. It closes with the base's.

        Without threads and with slow messages it may be complete only after further polls: see `joined`.

        Raises:
            WorldNotFoundError: if there is none, or nobody holds it any more.
            TransportError: if those who hold it do not answer within `timeout` s.
        """
        return self._worlds.open(name, timeout)

    def create_world(self, name: str, *, exist_ok: bool = False, timeout: float = TIMEOUT) -> Memory:
        """A new world that holds nothing but the root node `world`.

        With `exist_ok`, the one of that name if there is one, as it is; if nobody holds it any more, it begins anew.
        The right to make worlds is the right to write nodes of type `world_record`, and the root's type `world`.

        Raises:
            WorldError: if there is one already.
            ConfigError: for a name that cannot be used.
            AgentError: if this agent may not make worlds.
        """
        return self._worlds.create(name, exist_ok=exist_ok, timeout=timeout)

    def fork(self, name: str, of: str | None = None, *, follow: bool = False, timeout: float = TIMEOUT) -> Memory:
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

    def delete_world(self, name: str) -> None:
        """Delete a world without trace: every process drops it as soon as it hears of it.

        What somebody still writes into it is lost, and a world made later under that name begins without it.

        Raises:
            WorldNotFoundError: if there is none.
            WorldError: for the base, and for a world that others follow.
            AgentError: if this agent may not delete worlds.
        """
        self._worlds.delete(name)

    @property
    def closed(self) -> bool:
        """Whether it was closed, or its world deleted; then nothing changes in it any more."""
        return self._closed

    def poll(self) -> None:
        """Merge what has arrived, also in the worlds opened from here; only needed without threads."""
        self._replica.poll()
        if self.seat is None:
            self._worlds.each(lambda memory: memory.poll())
            if self.meshes.busy:
                self.meshes.poll()

    def flush(self) -> None:
        """Hand what was written to the network now, also in the worlds opened from here; needed without threads."""
        self._replica.flush()
        if self.seat is None:
            self._worlds.each(lambda memory: memory.flush())

    def drop(self) -> None:
        """Close, and hold nothing any more: the world was deleted. Called by what keeps the list of worlds."""
        self.close()
        with self._replica.lock:
            self._graph.clear()
            self._followers.frames = self._frames = FrameTree()

    def move(self, keys: Keys) -> None:
        """Go on meeting the other replicas of this world under other keys; called by what keeps the list of worlds."""
        self.keys = keys
        self._replica.move(keys)
