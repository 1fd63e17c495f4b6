"""Feeds agents that are run anew from a recording: everything but their own recorded writes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator
from typing import ClassVar

from msgspec.structs import replace

from agents.recorder.channels import SNAPSHOT
from agents.recorder.index import TimedRecord
from agents.recorder.opening import RecordingSource
from agents.replay.rebinding import Rebinding
from agents.replay.traffic import unpacked
from dsr.agent import Agent
from dsr.crdt.context import CausalContext, Dot
from dsr.crdt.delta import Delta, Key
from dsr.crdt.hlc import physical_time
from dsr.crdt.store import Store
from dsr.errors import WireError
from dsr.memory import Memory
from dsr.network.keys import agent_of, is_key
from dsr.network.transport import Chunks, key_matches
from dsr.replication.parcels import parcels
from dsr.replication.wire import decode_kept

_MICRO = 1e6
_LATE = 1.0
"""s before the recording's first message; who had written earlier was at work before, and goes on from that."""
_REMOVER = "recording-snapshot"
"""Stands for the replica that removed what a snapshot does not hold any more."""


class Feed:
    """Hands out recorded messages up to a moment, without those of the agents that run anew.

    Recorded changes keep their dots and stamps. Changes of others to elements that the agents had made go to those that
    they make anew, by name; `lost` counts, by writer, those for which there was none.

    Args:
        index: of the recording.
        anew: names of the agents.
        publishes: patterns of topics that the agents publish on the bus.
    """

    def __init__(self, index: RecordingSource, anew: Collection[str], publishes: Collection[str] = ()) -> None:
        self.malformed = 0
        self.memory: Memory | None = None
        """A replica of the graph of the agents that run anew."""
        self._rebinding = Rebinding(self._is_anew)
        self._index = index
        self._anew = frozenset(anew)
        self._publishes = tuple(publishes)
        self._records = index.read_for(0.0)
        self._following = next(self._records, None)
        self._waiting: list[tuple[int, int, TimedRecord]] = []
        self._ranks = _ranks(index.topics)
        self._alive: dict[Dot, None] = {}
        self._is_first = True
        self._past: frozenset[Dot] = frozenset()
        self._looked_at: dict[str, int] = {}
        """By replica, the counter up to which it is known what was made anew."""

    @property
    def lost(self) -> Counter[str]:
        """Changes to elements that the agents had made, and have not made anew until now; by writer."""
        return self._rebinding.waiting

    @property
    def kept_past(self) -> bool:
        """Whether the agents had been at work before the recording began, and go on from what they had written."""
        return bool(self._past)

    def rank(self, agent: str) -> int:
        """The place of an agent in the order in which they work at one instant."""
        return self._ranks.get(agent, len(self._ranks))

    @property
    def last_rank(self) -> int:
        """A rank after all others."""
        return len(self._ranks) + 1

    def take(self, now: float, rank: int) -> Iterator[tuple[str, bytes | Chunks]]:
        """(topic, payload, or pieces of a large one) of all that an agent of this rank knows at `now` (stamp, s)."""
        moment = round(now * _MICRO)
        while self._following is not None and self._moment(self._following) <= moment:
            record = self._following
            self._waiting.append((self._moment(record), self._rank_of(record.topic), record))
            self._following = next(self._records, None)
        due = [item for item in self._waiting if item[:2] < (moment, rank)]
        self._waiting = [item for item in self._waiting if item[:2] >= (moment, rank)]
        for _, _, record in due:
            try:
                yield from self._filtered(record)
            except WireError:
                self.malformed += 1
        if self.memory is not None:
            self.memory.poll()
            for key in self._made_anew(self.memory.replica.graph.store):
                self._rebinding.note_live(key)
            if bound := self._rebinding.bound(self._live):
                self._note_alive(bound)
                yield from _by_maker(bound)

    def _made_anew(self, store: Store) -> Iterator[Key]:
        """Elements of which the agents that run anew have made an incarnation since the last look."""
        for rid, last in list(store.context.vector.items()):
            before = self._looked_at.get(rid, 0)
            if last > before and agent_of(rid) in self._anew:
                self._looked_at[rid] = last
                if last - before > len(store.entries):  # who writes a recording may say that any number was seen
                    yield from [entry.key for dot, entry in store.entries.items() if dot[0] == rid and dot[1] > before]
                else:
                    dots = ((rid, counter) for counter in range(before + 1, last + 1))
                    yield from [entry.key for dot in dots if (entry := store.entries.get(dot)) is not None]

    def _live(self, key: Key) -> list[Dot]:
        """Where the agents that run anew have made an element."""
        assert self.memory is not None
        return [dot for dot in self.memory.replica.graph.store.by_key.get(key, ()) if agent_of(dot[0]) in self._anew]

    def _moment(self, record: TimedRecord) -> int:
        return round((self._index.begin + record.time) * _MICRO)

    def _rank_of(self, topic: str) -> int:
        """Sensors and images come first."""
        writer = _writer(topic)
        return -1 if writer is None else self.rank(writer)

    def _filtered(self, record: TimedRecord) -> Iterator[tuple[str, bytes | Chunks]]:
        topic = record.topic
        if topic == SNAPSHOT:
            yield from _by_maker(self._settled(decode_kept(record.payload)))
        elif topic.startswith(("d/", "rt/")):
            delta = self._without(decode_kept(record.payload))
            if delta and is_key(topic) and not self._is_theirs(topic):
                yield from _messages(topic, delta)
        elif not is_key(topic) or self._is_theirs(topic):
            return
        elif topic.startswith("blob/"):
            yield topic, unpacked(record.payload)
        else:
            yield topic, record.payload

    def _is_theirs(self, topic: str) -> bool:
        """Whether the agents that run anew publish there."""
        return _writer(topic) in self._anew or any(key_matches(pattern, topic) for pattern in self._publishes)

    def _settled(self, snapshot: Delta) -> Delta:
        """A snapshot as an ordinary change: what it knows and does not hold is removed."""
        if self._is_first:
            self._is_first = False
            begun = self._index.begin - _LATE
            writes = [write for write in snapshot.writes if agent_of(write.writer) in self._anew]
            if any(physical_time(write.stamp) < begun for write in writes):
                self._past = frozenset(add.dot for add in snapshot.adds)
                self._alive = dict.fromkeys(self._past)
                return Delta(snapshot.adds, snapshot.writes, [], snapshot.context)
        seen, live = CausalContext(snapshot.context), snapshot.live or frozenset()
        gone = [dot for dot in self._alive if dot in seen and dot not in live]
        return self._without(Delta(snapshot.adds, snapshot.writes, gone, snapshot.context))

    def _is_anew(self, dot: Dot) -> bool:
        """Whether a dot stands for something that the agents will make themselves."""
        return agent_of(dot[0]) in self._anew and dot not in self._past

    def _without(self, delta: Delta) -> Delta:
        """The part of a change that concerns nothing of the agents that run anew."""
        is_anew, rebinding = self._is_anew, self._rebinding
        kept = Delta()
        for add in delta.adds:
            if is_anew(add.dot):
                rebinding.note_made(add)
            elif not rebinding.take_add(add):
                kept.adds.append(add)
        for write in delta.writes:
            if agent_of(write.writer) not in self._anew and not rebinding.take_write(write):
                kept.writes.append(replace(write, dot=None) if write.dot and is_anew(write.dot) else write)
        for dot in delta.removed:
            rebinding.note_removed(dot)
        kept.removed = [dot for dot in delta.removed if not is_anew(dot)]
        kept.context = rebinding.without_waiting(
            [dots for dots in delta.context if agent_of(dots[0]) not in self._anew]
        )
        self._note_alive(kept)
        return kept

    def _note_alive(self, delta: Delta) -> None:
        self._alive.update((add.dot, None) for add in delta.adds)
        for dot in delta.removed:
            self._alive.pop(dot, None)


class Feeder(Agent):
    """Publishes the part of a feed for the agent that ticks next. Made into a class of its own for each agent."""

    uses_memory = False
    feed: ClassVar[Feed]
    rank: ClassVar[int]

    def tick(self, now: float) -> None:
        """Publish what the agent after this one would have known by `now`."""
        for topic, payload in self.feed.take(now, self.rank):
            key = f"{self.keys.root}/{topic}"
            if isinstance(payload, bytes):
                self.bus.publish(key, payload)
            else:
                self.bus.publish_bulk(key, payload)


def _by_maker(delta: Delta) -> Iterator[tuple[str, bytes]]:
    """What several replicas had made, as each of them would have sent it: all elements first, then their values."""
    parts: dict[tuple[bool, str], Delta] = {}
    for add in delta.adds:
        parts.setdefault((False, add.dot[0]), Delta()).adds.append(add)
    for write in delta.writes:
        parts.setdefault((True, write.dot[0] if write.dot else write.writer), Delta()).writes.append(write)
    for dots in delta.context:
        parts.setdefault((False, dots[0]), Delta()).context.append(dots)
    if delta.removed:
        parts[True, _REMOVER] = Delta(removed=delta.removed)
    for (_, rid), part in sorted(parts.items(), key=lambda item: item[0][0]):
        part.context = part.context or [(*add.dot, add.dot[1]) for add in part.adds]
        yield from _messages(f"d/{rid}", part)


def feeder_for(agent: type[Agent], feed: Feed, name: str | None = None) -> type[Feeder]:
    """Make the feeder that ticks just before the agent of this class and name; without a name, after all agents."""
    rank = feed.last_rank if name is None else feed.rank(name)
    fields = {"feed": feed, "rank": rank, "rate_hz": agent.rate_hz}
    return type("Feeder", (Feeder,), fields)


def _messages(topic: str, delta: Delta) -> Iterator[tuple[str, bytes]]:
    """A change as it is published; a recording may hold longer messages than the network."""
    return ((topic, message) for message in parcels(delta))


def _writer(topic: str) -> str | None:
    """The agent that wrote a message, if its topic tells."""
    kind, _, name = topic.partition("/")
    if kind in ("d", "rt"):
        return agent_of(name)
    return name if kind in ("status", "log") else None


def _ranks(topics: Collection[str]) -> dict[str, int]:
    """Agents by when they were first heard; in lockstep that is the order in which they tick."""
    return {writer: rank for rank, writer in enumerate(dict.fromkeys(filter(None, map(_writer, topics))))}
