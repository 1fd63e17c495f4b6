"""Bounds the claims of a sender about dots that it has seen.

Honest replicas never meet these bounds, so that lies cost little and end.

A context only grows, and everybody keeps what anybody claims. Therefore:

1. A delta accounts for dots of its sender alone, and for removals of what has arrived. A removal may come before what
   it removes; `MAX_EARLY` such removals are taken, others are holes that the repair fills.
2. Gaps between the counters of one replica, and newcomers in a while, are bounded; what is beyond is passed over, and
   the repair brings it. In a reply the replier's own counters have no gaps, and of nobody's more than `MAX_GAPS` are
   taken over.
3. A reply may name replicas of which nothing is left: a newcomer must learn of them. Others take over `MAX_STRANGERS`
   of them with each reply, and nobody any beyond `MAX_REPLICAS`. That changes nothing that anybody holds.
4. Nobody can have seen more of us than we have written.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from dsr.crdt.context import CausalContext, Dot, DotRange, to_ranges
from dsr.crdt.delta import Delta, Write
from dsr.errors import WireError
from dsr.graph.graph import Graph
from dsr.network.keys import part_of

MAX_GAPS = 1000
"""Gaps among the counters of one replica: as many messages lost one by one as wait for a slow reader."""
MAX_EARLY = 1000
"""Removals that may come before their elements: a race of milliseconds between two senders."""
MAX_NEWCOMERS = 1000
"""Replicas that may begin to write within `WHILE`: as many as are listened to."""
WHILE = 60.0
"""s, time within which at most `MAX_NEWCOMERS` replicas may begin to write"""
MAX_REPLICAS = 1 << 14
"""Replica ids in a context after which none is taken over of which nothing is left: those of eleven days with a restart
a minute. A request has 500 kB then, and takes 20 ms to read."""
MAX_STRANGERS = 1000
"""New replicas that one reply may bring to a replica that has joined: after a partition, replies of some seconds bring
all.
"""


class Claims:
    """Watches over the claims of others to one replica."""

    def __init__(self, graph: Graph) -> None:
        self.passed_over = 0
        """Deltas that were left to the repair, removals too, and replicas that were not taken over."""
        self._graph = graph
        self._early: dict[str, set[int]] = {}
        """Counters of what was removed before it came, by who is to have made it; until that one accounts for them."""
        self._newcomers: set[str] = set()
        self._opened: dict[str, int] = {}
        """Gaps among the counters of a replica that its own deltas opened"""
        self._while_ends = 0.0

    def look(self, now: float) -> None:
        """Bring the counts up to date; call this often with the monotonic time, s."""
        if now >= self._while_ends:
            gaps = self._graph.store.context.gaps
            self._opened = {rid: min(count, gaps(rid)) for rid, count in self._opened.items() if gaps(rid)}
            self._newcomers.clear()
            self._while_ends = now + WHILE

    def is_plain(self, sender: str, delta: Delta, part: str | None) -> bool:
        """Whether it only adds and writes, all by its sender, and goes on where the sender's counters ended.

        Nearly all deltas are so. Such a one keeps all bounds, and speaks for nobody else. `part` is that of which all
        dots must be, if any.
        """
        if delta.removed or delta.live is not None or sender in self._early or sender == self._graph.rid:
            return False
        first, last = 1, 0
        if delta.context:
            known, (rid, first, last) = self._graph.store.context.vector.get(sender), delta.context[0]
            if rid != sender or len(delta.context) > 1 or known is None or first > known + 1:
                return False
        for add in delta.adds:
            if add.dot[0] != sender or not first <= add.dot[1] <= last:
                return False
        for write in delta.writes:
            dot = write.dot
            if dot is not None and (dot[0] != sender or not first <= dot[1] <= last):
                return False
        return part is None or (part_of(sender) == part and not _is_of_others(delta.writes, part))

    def own_part(self, sender: str, delta: Delta) -> Delta:
        """Select the part of a delta that may be joined.

        Raises `WireError` if the delta accounts for dots that are not its sender's.
        """
        other = _other_than(sender, delta)
        if other is not None:
            raise WireError(f"dots of {other} in a delta of another replica")
        if delta.removed and not self._may_remove(delta.removed):
            self.passed_over += 1
            known = [dot for dot in delta.removed if self._graph.store.is_known(dot)]
            return Delta(delta.adds, delta.writes, known, accounted_for(sender, delta))
        return delta

    def may_grow(self, sender: str, delta: Delta, *, joining: bool) -> bool:
        """Whether a delta keeps the bounds on newcomers and gaps; if not, it is passed over.

        Gaps between the pieces of an answer are not the sender's, and not counted. Who is still `joining` is told of
        all that it lacks anyway, and counts none.
        """
        context = self._graph.store.context
        if _follows(context.vector.get(sender), delta) and sender not in self._early:
            return True
        if not context.knows(sender) and sender not in self._newcomers:
            if len(self._newcomers) >= MAX_NEWCOMERS:
                self.passed_over += 1
                return False
            self._newcomers.add(sender)
        next_one = context.vector.get(sender, 0) + 1
        opened = [rid for rid, first, _ in delta.context if first > next_one and (rid, first - 1) not in context]
        apart = len(opened) + _unaccounted(delta)
        there = 0 if joining else min(context.gaps(sender), self._opened.get(sender, 0))
        if apart and apart + there > MAX_GAPS:
            self.passed_over += 1
            return False
        if apart and not joining:
            self._opened[sender] = there + apart
        self._note_made(sender, delta.context)
        return True

    def context_part(self, sender: str, context: list[DotRange]) -> list[DotRange]:
        """Select the part of a replier's context that may be believed:

        `MAX_GAPS` gaps of each replica, the lowest ones.

        Who has not got all pieces of an answer itself has more gaps than messages were lost. Raises `WireError` if
        nobody honest can have sent it.
        """
        ranges: Counter[str] = Counter()
        kept: list[DotRange] = []
        for dots in context:
            rid, first, _ = dots
            ranges[rid] += 1
            if rid == sender and first > 1:
                raise WireError("gaps among the counters of the replier itself")
            if ranges[rid] <= MAX_GAPS + 1 or not self._graph.store.bounds_gaps:
                kept.append(dots)
        self.passed_over += len(context) - len(kept)
        return kept

    def reply_part(self, reply: Delta, *, joining: bool) -> Delta:
        """Select the part of a reply's end that may be joined, by a newcomer or not."""
        room = MAX_REPLICAS - self._graph.store.context.size
        rids = dict.fromkeys(rid for rid, _, _ in reply.context)
        return self._without_strangers(reply, rids, room if joining else min(room, MAX_STRANGERS))

    def _without_strangers(self, reply: Delta, ranges: Iterable[str], room: int) -> Delta:
        """Leave out replicas of which nothing is left, but for so many."""
        context = self._graph.store.context
        strangers = [rid for rid in ranges if not context.knows(rid)]
        if len(strangers) <= room:
            return reply
        named = {dot[0] for dot in dots_of(reply)}
        left_out = set([rid for rid in sorted(strangers) if rid not in named][max(room, 0) :])
        self.passed_over += len(left_out)
        kept = [dots for dots in reply.context if dots[0] not in left_out]
        return Delta(reply.adds, reply.writes, reply.removed, kept, reply.live, reply.examined)

    def tidy(self, sender: str, reply: Delta) -> bool:
        """Close the lowest gaps of a replica that has too many, after a reply was joined.

        Returns whether there were any.

        Two replicas may lack different messages of a third one that is gone. What nobody brought then is given up. Of
        what was written after the replier began to answer it has told nothing yet: that is asked for next.
        """
        self._note_made(sender, reply.context)
        store = self._graph.store
        told: dict[str, int] = {}
        for rid, _, last in reply.context if store.bounds_gaps else ():
            told[rid] = max(last, told.get(rid, 0))
        return bool([rid for rid, last in told.items() if store.context.close_gaps(rid, MAX_GAPS, last)])

    def _may_remove(self, dots: Iterable[Dot]) -> bool:
        """Whether removals of what has not arrived are few; they are noted then."""
        unknown = [dot for dot in dots if not self._graph.store.is_known(dot)]
        if unknown and len(unknown) + sum(map(len, self._early.values())) > MAX_EARLY:
            return False
        for rid, counter in unknown:
            self._early.setdefault(rid, set()).add(counter)
        return True

    def _note_made(self, sender: str, context: Iterable[DotRange]) -> None:
        """What was removed early has come, from who made it."""
        early = self._early.get(sender)
        if early is None:
            return
        for rid, first, last in context:
            if rid == sender:
                early.difference_update([counter for counter in early if first <= counter <= last])
        if not early:
            del self._early[sender]


def _is_of_others(writes: list[Write], part: str) -> bool:
    """Whether something is written to what is in another part."""
    looked_at = None
    for write in writes:
        rid = write.owner[0]
        if rid is not looked_at:
            if part_of(rid) != part:
                return True
            looked_at = rid
    return False


def dots_of(delta: Delta) -> Iterable[Dot]:
    """The dots of additions and durable writes."""
    yield from (add.dot for add in delta.adds)
    yield from (write.dot for write in delta.writes if write.dot)


def _other_than(sender: str, delta: Delta) -> str | None:
    """Somebody else whose dots a delta accounts for."""
    for add in delta.adds:
        if add.dot[0] != sender:
            return add.dot[0]
    for write in delta.writes:
        if write.dot is not None and write.dot[0] != sender:
            return write.dot[0]
    for rid, _, _ in delta.context:
        if rid != sender:
            return rid
    return None


def _follows(known: int | None, delta: Delta) -> bool:
    """Whether a delta goes on where its sender's counters ended, as nearly all do, or accounts for nothing."""
    if not delta.context:
        return not delta.adds
    if known is None or len(delta.context) > 1:
        return False
    _, first, last = delta.context[0]
    return first <= known + 1 and all(first <= add.dot[1] <= last for add in delta.adds)


def _unaccounted(delta: Delta) -> int:
    """Additions whose dots the delta does not account for, as honest ones do."""
    if not delta.adds:
        return 0
    told = CausalContext(delta.context)
    return sum(add.dot not in told for add in delta.adds)


def accounted_for(sender: str, delta: Delta, put_off: Iterable[Dot] = ()) -> list[DotRange]:
    """The sender's dots whose additions and writes are here, but those put off; those of removals are not known."""
    return list(to_ranges({dot for dot in dots_of(delta) if dot[0] == sender}.difference(put_off)))


def without_word_of(rid: str, reply: Delta) -> Delta:
    """A reply that neither adds nor removes anything that replica `rid` made."""
    return Delta(
        [add for add in reply.adds if add.dot[0] != rid],
        [write for write in reply.writes if write.dot is None or write.dot[0] != rid],
        [dot for dot in reply.removed if dot[0] != rid],
        [dots for dots in reply.context if dots[0] != rid],
        reply.live,
        None if reply.examined is None else [dots for dots in reply.examined if dots[0] != rid],
    )


def goes_beyond(rid: str, counter: int, delta: Delta, *, removals_only: bool = False) -> bool:
    """Whether somebody claims to have seen more of replica `rid` than the `counter` changes that it has made."""
    claimed = [dot for dot in delta.removed if dot[0] == rid]
    if not removals_only:
        claimed += [add.dot for add in delta.adds if add.dot[0] == rid]
        claimed += [dot for write in delta.writes if (dot := write.dot) is not None and dot[0] == rid]
        claimed += [(rid, last) for owner, _, last in delta.context if owner == rid]
    return any(number > counter for _, number in claimed)
