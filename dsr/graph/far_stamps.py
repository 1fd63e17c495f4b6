"""Stamps that no honest clock can have made: who sent them, and which attributes they are in.

Each replica judges that by its own clock, and refuses nothing because of it: replicas would differ. It only tells.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

from dsr.crdt.delta import EdgeKey, Key, Write
from dsr.crdt.hlc import MAX_LEAD, physical_time, stamp_at
from dsr.crdt.store import Store
from dsr.graph.elements import Edge, Node
from dsr.network.keys import agent_of

FAR = 2 * MAX_LEAD
"""s ahead of the own clock from which on a stamp is told. An honest clock may follow another one by `MAX_LEAD`, and be
seen from one that is as much behind."""
_FOLLOWING = stamp_at(1.0)
"""Who overwrites a value goes one beyond its stamp. So a stamp that is further above, by a second or 10^9 writes, was
not made by overwriting."""
_MAX_AGENTS = 1000
"""Agents that are told apart: made-up names must take no memory."""

_log = logging.getLogger("dsr.stamps")


class FarStamp(NamedTuple):
    """An attribute whose present value is stamped far ahead."""

    element: Key
    """A node's name, or an edge's (source, destination, type)."""
    type: str
    attribute: str
    writer: str
    """Replica id of who wrote the present value: who raised the stamp, or overwrote it since."""
    ahead: float
    """Time (s) by which the stamp is ahead of the clock that judges."""


class FarStamps:
    """Counts the stamps of the far future that one replica has noticed, by their writers."""

    def __init__(self) -> None:
        self.agents: Counter[str] = Counter()
        """How often each agent stamped a value far ahead, not counting who only overwrote such values."""

    def notice(self, writes: Iterable[Write], store: Store, now: float) -> None:
        """Look at writes that are about to be joined, at physical time `now` (s)."""
        far = stamp_at(now + FAR)
        for write in writes:
            if write.stamp > far and not _follows(write, store, far):
                self._count(write, now)

    def _count(self, write: Write, now: float) -> None:
        agent = agent_of(write.writer) or write.writer
        if agent not in self.agents and len(self.agents) >= _MAX_AGENTS:
            agent = "others"
        self.agents[agent] += 1
        if self.agents[agent] == 1:
            days = (physical_time(write.stamp) - now) / 86_400.0
            _log.warning(
                "%s stamped a value of %r %.0f days ahead of this clock (further ones of it are only counted); "
                "see: dsr stamps", write.writer, write.attribute, days,
            )  # fmt: skip


def _follows(write: Write, store: Store, far: int) -> bool:
    """Whether who made the write may only have gone beyond what is known here."""
    entry = store.find(write.owner)
    present = entry.registers.get(write.attribute) if entry else None
    return present is not None and present.stamp > far and 0 <= write.stamp - present.stamp < _FOLLOWING


def far_stamps(elements: Iterable[Node | Edge], now: float) -> Iterator[FarStamp]:
    """The attributes of visible elements that are stamped far ahead of physical time `now` (s)."""
    far = stamp_at(now + FAR)
    for element in elements:
        key: str | EdgeKey = element.key
        for attribute in sorted(element.written):
            write = element.newest_write(attribute)
            if write is not None and write.stamp > far:
                ahead = physical_time(write.stamp) - now
                yield FarStamp(key, element.type, attribute, write.writer, ahead)


def by_agent(found: Iterable[FarStamp]) -> Mapping[str, int]:
    """Count by agent the attributes that the agent wrote last."""
    return Counter(agent_of(stamp.writer) or stamp.writer for stamp in found)
