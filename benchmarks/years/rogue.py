"""An agent of a secured graph that exceeds its rights: nothing of what it says may be believed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from benchmarks.years.meshes import lie
from dsr import Memory
from dsr.crdt.delta import Add, Delta, Write
from dsr.crdt.hlc import stamp_at
from dsr.network.keys import Keys
from dsr.replication.wire import encode_delta
from dsr.security.policy import AccessPolicy, Grant

if TYPE_CHECKING:
    from benchmarks.years.history import History

MOST_PLACES = 9
"""Processes for which the policy has a grant."""
NAME = "rogue"
RID = "rogue-1"
_ALL = Grant(("*",), ("*",), ("*",), trusted=True)
POLICY = AccessPolicy({**{f"r{place}": _ALL for place in range(MOST_PLACES)}, NAME: Grant(("ball",), (), ("seen",))})
"""Everybody may everything, but for the rogue, which may write what is seen of balls."""


class Rogue:
    """Speaks under its own key, as its certificate allows, and says what its grant does not. Its meshes are wrong."""

    def __init__(self, history: History) -> None:
        self._transport = history.network.connect(NAME)
        self._transport.serve(Keys("g").mesh(RID), lie)
        self._clock = history.clock
        self._count = 0
        history.dead.add(RID)

    def offend(self, memory: Memory, choice: int) -> None:
        """Say something of what a memory shows: add, write, speak for another, or remove, as `choice` tells."""
        self._count += 1
        graph = memory.replica.graph
        dot, stamp = (RID, self._count), stamp_at(self._clock.now() + 1000.0)
        entries = sorted(graph.store.entries.values(), key=lambda entry: entry.dot)
        delta = Delta(context=[(*dot, self._count)])
        if not entries or choice % 5 == 0:
            delta.adds = [Add(dot, f"evil_{self._count}", "cube")]
        else:
            entry = entries[choice % len(entries)]
            match choice % 5:
                case 1:
                    delta.writes = [Write(entry.dot, "note", stamp, RID, dot, "evil")]
                case 2:
                    delta.writes = [Write(entry.dot, "seen", stamp, graph.rid, dot, -1)]
                case 3:
                    delta.removed = [entry.dot]
                case 4:
                    claimed = (graph.rid, graph.counter + 1, graph.counter + 9)
                    delta = Delta(adds=[Add(claimed[:2], "evil", "ball")], context=[claimed])
        self._transport.publish(Keys("g").delta(RID), encode_delta(delta))
