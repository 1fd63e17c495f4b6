"""The worlds beside the base, in several processes: which of them are one, and what must be so of all of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from benchmarks.years.showing import shown, state
from dsr import Memory, TransportError, WorldError, WorldNotFoundError
from dsr.crdt.context import CausalContext
from dsr.crdt.pieces import reply_to
from dsr.graph.watches import Watches
from dsr.network.keys import Keys
from dsr.network.local_transport import LocalTransport
from dsr.worlds.overlay import Overlay
from dsr.worlds.overlay_frames import OverlayFrames
from dsr.worlds.registry import records

HERE = (WorldError, WorldNotFoundError, TransportError)
"""What may be said of worlds of which one does not know what others have done."""


def declared(transport: LocalTransport) -> set[str]:
    """All keys under which a process takes part in anything."""
    served = [key for key, _, _ in transport._servers]
    return {*served, *(key for key, _ in [*transport._subscribers, *transport._presence]), *transport.tokens}


def mark(memory: Memory) -> str:
    """Name of the world and one of the channels that it is, as it is known here: for what is written into it."""
    if memory.world_handle is None:
        return "base@"
    rid, counter = min(memory.world_handle.record.dots)
    return f"{memory.world_name}@{rid}:{counter}"


def made_anew(overlay: Overlay) -> Overlay:
    """An overlay of the same parent that holds the same, and has not lived through how that came."""
    watches = Watches()
    watches.frames = frames = OverlayFrames(overlay.parent.watches.frames)
    new = Overlay("anew-1", overlay.parent, watches, frames)
    new.join(reply_to(overlay.store, CausalContext()), 0.0)
    overlay.parent.watches.show_no_more(new)
    return new


class WorldsInSeveral:
    """The worlds of some memories of the base.

    Args:
        memories: gives those that live now.
    """

    def __init__(self, memories: Callable[[], Sequence[Memory]]) -> None:
        self._memories = memories
        self.together: dict[str, str] = {}
        """Channels that were one world at some time, each with another one of it; itself for the first."""
        self._copied: set[str] = set()
        """Marks of things that forks took with them."""
        self._noted: dict[str, tuple[int, int]] = {}
        """Of what state of each replica the records were taken down."""

    def note(self) -> None:
        """Take down which channels are one world: those that one record has ever been made of."""
        for memory in self._memories():
            graph = memory.replica.graph
            seen = graph.store.context.hash, graph.store.fingerprint
            if self._noted.get(graph.rid) == seen:
                continue
            self._noted[graph.rid] = seen
            for record in records(graph):
                channels = [f"{dot[0]}:{dot[1]}" for dot in sorted(record.dots)]
                for channel in channels:
                    self.together[self.root(channel)] = self.root(channels[0])

    def note_copied(self, fork: Memory) -> None:
        """Take down what a new fork holds of other worlds: it may come back with a fork of this fork."""
        self._copied |= {str(node.get("note", "")) for node in fork.nodes()}

    def root(self, channel: str) -> str:
        """The channel that stands for all that were one world with this one."""
        while self.together.setdefault(channel, channel) != channel:
            channel = self.together[channel]
        return channel

    def check(self) -> None:
        """Nobody has a world open that is not in its list, nor takes part in anything under its keys."""
        for memory in self._memories():
            listed = memory.world_channels()
            roots = [Keys("g").root + "/world/"] + [
                Keys("g", name, channel).state + "/" for name, channel in listed.items()
            ]
            for opened in memory.opened_worlds()[1:]:
                assert opened.world_name in listed and not opened.closed
            assert isinstance(memory.transport, LocalTransport)
            for key in declared(memory.transport):
                assert not key.startswith(roots[0]) or any(key.startswith(root) for root in roots[1:]), f"{key} is left"

    def check_converged(self) -> None:
        """All replicas of each world are equal, and hold nothing of worlds that are gone."""
        memories = self._memories()
        listed = {info.name: info for info in memories[0].worlds()}
        assert all(memory.worlds() == list(listed.values()) for memory in memories), "lists of worlds differ"
        for name, info in listed.items():
            replicas = [world for memory in memories for world in memory.opened_worlds() if world.world_name == name]
            for replica in replicas:
                if not info.follows:
                    assert state(replica._graph) == state(replicas[0]._graph), f"replicas of {name} differ"
                else:
                    assert shown(replica._graph) == shown(replicas[0]._graph), f"replicas of {name} differ"
                if isinstance(replica._graph, Overlay):
                    assert shown(replica._graph) == shown(made_anew(replica._graph)), f"{name} shows what it is not"
                for node in replica.nodes():
                    where, _, channel = str(node.get("note", "")).partition("@")
                    if f"{where}@{channel}" in self._copied:
                        continue
                    assert where != name or name == "base" or self.root(channel) in self._marks(replica), "resurrected"

    def _marks(self, memory: Memory) -> set[str]:
        """What things are marked with that are written into this world; see `together`."""
        graph = self._memories()[0].replica.graph
        record = next((found for found in records(graph) if found.info.name == memory.world_name), None)
        return {self.root(f"{dot[0]}:{dot[1]}") for dot in record.dots} if record else set()
