"""The progress of a replay: speed, pause and seek; writes the recorded graph into one that others follow."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable

from agents.replay.mirror import GraphMirror
from agents.replay.source import ReplayedGraph
from agents.replay.traffic import Traffic
from dsr.believing.distribution import ATTRIBUTE
from dsr.believing.worlds import MOST_WORLDS, BeliefWorlds
from dsr.errors import SchemaError
from dsr.geometry import mesh_hashes
from dsr.graph.watch import Watch
from dsr.memory import Memory


class MeshCheck:
    """Follows the nodes of a graph, and knows which of their meshes are not here.

    Args:
        memory: of the replay.
    """

    def __init__(self, memory: Memory) -> None:
        self._memory = memory
        self._watch = memory.watch(attribute="mesh")
        self._named: dict[str, str] = {}

    def missing(self) -> dict[str, str]:
        """The name of a node by each hash that was ever named and is not here; they are asked for."""
        for change in self._watch.poll():
            node = self._memory.get_node(change.name) if change.element == "node" else None
            with contextlib.suppress(SchemaError):  # what it says are no hashes
                self._named.update({} if node is None else dict.fromkeys(mesh_hashes(node), node.name))
        self._named = {hash: name for hash, name in self._named.items() if self._memory.get_mesh(hash) is None}
        return dict(self._named)


STEP = 0.02
"""s between two steps; changes that were recorded closer together become visible together."""
_STEP_AT_ONCE = 0.05  # s of the recording in one step at greatest speed
_SLOWEST, _FASTEST = 1 / 64, 1024.0


class Player:
    """Plays a recording into a memory, step by step.

    Args:
        source: the recording.
        target: gets the same nodes, edges and attributes; nobody else should write to it.
        begin: s, where to start.
        until: s, where to end; the end of the recording if None.
        speed: recorded seconds a second; infinite for as fast as possible.
        pause_at: s, where to pause on the way.
    """

    def __init__(
        self,
        source: ReplayedGraph,
        target: Memory,
        *,
        begin: float = 0.0,
        until: float | None = None,
        speed: float = 1.0,
        pause_at: float | None = None,
    ) -> None:
        self._source = source
        self.mirror = GraphMirror(target)
        self._alternatives = BeliefWorlds(target, MOST_WORLDS)
        self._meshes = MeshCheck(target)
        for mesh in source.index.meshes():
            target.put_mesh(mesh)
        self._traffic = Traffic(target.transport, target.keys, target.clock)
        self.until = source.duration if until is None else min(max(until, 0.0), source.duration)
        """s"""
        self.speed = speed
        self.playing = True
        self._pause_at = pause_at
        self._stepped_at: float | None = None
        self._watch: Watch | None = None
        self._watched: Memory | None = None
        self.seek(begin)

    @property
    def missing_meshes(self) -> dict[str, str]:
        """Names of nodes by the hashes of those of their meshes that neither the recording has nor anybody here."""
        return self._meshes.missing()

    @property
    def time(self) -> float:
        """Seconds since the recording's first message"""
        return self._source.time

    @property
    def begin(self) -> float:
        """s, the stamp of the recording's first message"""
        return self._source.index.begin

    @property
    def ended(self) -> bool:
        """Whether the end was reached."""
        return self.time >= self.until

    def pause(self) -> None:
        """Hold the present state."""
        self.playing = False

    def resume(self) -> None:
        """Go on; from the beginning if the end was reached."""
        if self.ended:
            self.seek(0.0)
        self.playing = True
        self._stepped_at = None

    def set_speed(self, speed: float) -> None:
        """Change the speed. Raises `ValueError` for one that is not positive."""
        if not speed > 0:
            raise ValueError(f"speed {speed}: expected a positive number, or max")
        self.speed = speed if speed == math.inf else min(max(speed, _SLOWEST), _FASTEST)

    def seek(self, time: float) -> None:
        """Show the state of `time` (s), or the nearest there is."""
        if not math.isfinite(time):
            raise ValueError(f"time {time}: expected seconds")
        time = min(max(time, 0.0), self.until)
        newest: dict[str, Callable[[], None]] = {}
        if self._source.leap(time):
            self._watched = None
        self._source.forward(time, lambda record: newest.update(self._traffic.later(record)))
        self._show()
        for publish in newest.values():
            publish()
        self._stepped_at = None
        if self._pause_at is not None and time >= self._pause_at:
            self._pause_at = None

    def step(self, now: float) -> None:
        """Do what is due at time `now` (s, of any steady clock)."""
        passed, self._stepped_at = now - (now if self._stepped_at is None else self._stepped_at), now
        if not self.playing or self.ended:
            return
        wanted = min(self._at_once() if self.speed == math.inf else self.time + passed * self.speed, self.until)
        if self._pause_at is not None and wanted >= self._pause_at:
            wanted, self._pause_at, self.playing = self._pause_at, None, False
        self._source.forward(wanted, self._traffic.publish)
        self._show()

    def _at_once(self) -> float:
        """The time (s) after one step at greatest speed: nobody waits through a time in which nothing was recorded."""
        return max(self.time + _STEP_AT_ONCE, min(self._source.next_time, self._source.duration))

    def _show(self) -> None:
        """Bring the target into step with the source."""
        memory = self._source.memory
        if self._watch is not None and memory is self._watched:
            changes = list(self._watch.poll())
            self.mirror.apply(changes, memory)
            if any(ATTRIBUTE in change.attributes for change in changes):
                self._alternatives.update()
            return
        if self._watch is not None:
            self._watch.close()
        self._watch = memory.watch(existing=False)
        self._watched = memory
        self.mirror.copy(memory)
        self._alternatives.update()
