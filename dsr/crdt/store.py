"""The add-wins map of creation dots, with last-writer-wins registers keyed by creation dot.

State: for each key (node name or edge key) the live creation dots, each with its registers, and one
causal context. An entry lives as long as its dot is live; a dot in the context without an entry was
removed (optimised OR-set without tombstones: Bieniusa et al. 2012; delta-state: Almeida et al. 2018).

Ordering assumption: none. Deltas may be lost, repeated and reordered; a write whose entry has not
arrived waits in a bounded buffer, outside the context, so that synchronisation repairs an overflow.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, MutableMapping
from hashlib import blake2b

import msgspec
from msgspec.structs import replace

from dsr.crdt.context import CausalContext, Dot, to_ranges, without
from dsr.crdt.delta import Add, Delta, Key, Write, rank
from dsr.crdt.dots import OrderedDots

MAX_WAITING = 10_000
"""Writes for unknown entries that are kept; one with a long value counts for several (see `weight_of`)."""
MAX_MADE = 8
"""Live incarnations of one element by one replica: each look at the element looks at all, and each write goes to all.
An honest replica makes one only where it sees none; edges may wait for their ends unseen."""
_encoder = msgspec.msgpack.Encoder()


class Incarnation:
    """One incarnation of a node or edge."""

    __slots__ = ("announced", "destinations", "dot", "key", "registers", "sources", "type")

    def __init__(self, add: Add | Incarnation) -> None:
        self.dot: Dot = add.dot
        self.key: Key = add.key
        self.type: str = add.type
        self.sources: tuple[Dot, ...] = add.sources
        self.destinations: tuple[Dot, ...] = add.destinations
        self.registers: dict[str, Write] = {}
        """The winning write of each attribute."""
        self.announced = False
        """Whether the observer knows it: then it is told about each change of a register."""


class Observer:
    """Told about every effective change of a store; the default ignores them."""

    def before_change(self, key: Key) -> None:
        """The element `key` is about to change; only told by a store that shares entries (`Store.owned`)."""

    def entry_copied(self, old: Incarnation, new: Incarnation) -> None:
        """`new` takes the place of `old`, which others go on reading, and is about to change."""

    def entries_added(self, key: Key, entries: list[Incarnation]) -> None:
        """`entries` of one element became live, with the registers that came with them."""

    def entries_removed(self, key: Key, entries: list[Incarnation]) -> None:
        """`entries` of one element are not live any more."""

    def register_changed(self, entry: Incarnation, attribute: str) -> None:
        """A register got another value (or a tombstone)."""


class Store:
    """The replicated state of one graph."""

    bounds_gaps = True
    """Whether gaps among the counters of a replica come from lost messages alone."""

    def __init__(self, observer: Observer | None = None) -> None:
        self.context = CausalContext()
        self.entries: MutableMapping[Dot, Incarnation] = {}
        self.by_key: MutableMapping[Key, dict[Dot, Incarnation]] = {}
        self._order: OrderedDots | None = OrderedDots()
        self.owned: set[Dot] | None = None
        """If entries are shared with forks: those that nobody else reads. The others are copied before they change."""
        self.fingerprint = 0
        """Order-independent hash of what lives: of each dot, and of what was made under it."""
        self.unsettled: dict[tuple[Dot, str], int] = {}
        """Registers whose newest value has no dot yet, and how often they were passed over since."""
        self.recorder: Callable[[Delta], None] | None = None
        """Told about everything that is joined, local changes included, before that happens."""
        self._observer = observer or Observer()
        self._waiting: dict[Dot, list[Write]] = {}
        self._waiting_count = 0
        self.lost_waiting = 0
        """Writes given up because the buffer for unknown entries was full."""

    def join(self, delta: Delta) -> None:
        """Join a delta or a synchronisation reply: commutative, associative and idempotent."""
        delta = self._without_equivocation(delta) if delta.adds else delta
        if self.recorder is not None:
            self.recorder(self._to_be_kept(delta))
        if delta.live is not None:
            self._remove_absent(delta)
        if delta.removed:
            self._remove(delta.removed)
        added = [entry for add in delta.adds if (entry := self._add(add))] if delta.adds else []
        writes = self._fill(added, delta.writes) if added else delta.writes
        held_back = []
        for write in writes:
            entry = self.entries.get(write.owner)
            if entry is not None:
                self._set(entry, write)
            elif not self._write(write) and write.dot:
                held_back.append(write.dot)
        if held_back:
            self._learn(delta, held_back)
        else:
            for rid, first, last in delta.context:
                self.context.add_range(rid, first, last)
        if delta.live is not None:
            for owner in [owner for owner in self._waiting if owner in self.context]:
                self._forget_waiting(owner)
        if added:
            self._announce(added)

    def _crowded(self, added: list[Incarnation]) -> list[Dot]:
        """The oldest incarnations by who has made more than `MAX_MADE` of one element: the others stand for them."""
        crowded: list[Dot] = []
        for key in {entry.key: None for entry in added if len(self.by_key.get(entry.key, ())) > MAX_MADE}:
            made: dict[str, list[Dot]] = {}
            for dot in self.by_key[key]:
                made.setdefault(dot[0], []).append(dot)
            crowded += [dot for dots in made.values() for dot in sorted(dots)[:-MAX_MADE]]
        return crowded

    def _without_equivocation(self, delta: Delta) -> Delta:
        """A dot under which two different things were made stands for none, in whatever order they come.

        Only liars make such, and replicas that were told different things find that out by their fingerprints.
        """
        false = {add.dot for add in delta.adds if self._is_another(add)}
        if not false:
            return delta
        adds, removed = [add for add in delta.adds if add.dot not in false], [*delta.removed, *sorted(false)]
        return Delta(adds, delta.writes, removed, delta.context, delta.live, delta.examined)

    def _is_another(self, add: Add) -> bool:
        """Whether something else lives here under the dot of an addition."""
        there = self.entries.get(add.dot)
        return there is not None and (
            there.key != add.key or there.type != add.type
            or there.sources != add.sources or there.destinations != add.destinations
        )  # fmt: skip

    def _fill(self, added: list[Incarnation], writes: list[Write]) -> list[Write]:
        """Set the registers of new entries, of which nobody knows yet; returns the other writes, and further ones."""
        fresh = {entry.dot: entry for entry in added}
        others = []
        for write in writes:
            entry = fresh.get(write.owner)
            if entry is None or write.attribute in entry.registers:
                others.append(write)
                continue
            entry.registers[write.attribute] = write
            if write.dot is None:
                self.unsettled[(write.owner, write.attribute)] = 0
        return others

    def _announce(self, added: list[Incarnation]) -> None:
        """Nodes first, so that whoever looks on never sees an edge without its ends; each element once."""
        known = self.context.vector.get
        for rid, counter in [entry.dot for entry in added]:
            if counter > known(rid, 0):
                self.context.add((rid, counter))
        for key, entries in _by_key(added):
            if present := [entry for entry in entries if entry.dot in self.entries]:
                for entry in present:
                    entry.announced = True
                self._observer.entries_added(key, present)
        if crowded := self._crowded(added):
            self._remove(crowded)

    def _remove_absent(self, delta: Delta) -> None:
        """Remove what the sender has seen and does not hold; what it has not seen stays."""
        self._remove(self._absent(delta))

    def _absent(self, delta: Delta) -> list[Dot]:
        """What is held here, and the sender of a reply has seen and does not hold."""
        examined = delta.context if delta.examined is None else delta.examined
        live = delta.live or frozenset()
        return [dot for dots in examined for dot in self.order.between(*dots) if dot not in live]

    def _to_be_kept(self, delta: Delta) -> Delta:
        """As an ordinary change: in the encoding of deltas a piece of a reply would stand for a whole one.

        Additions of what was seen before are left out. Changes are kept in bundles, of which one may tell that a thing
        was seen and is gone. An addition of this thing that came later would bring it back from there.
        """
        if delta.examined is None and delta.live is not None:
            return delta
        adds = [add for add in delta.adds if add.dot not in self.context]
        if delta.live is None and len(adds) == len(delta.adds):
            return delta
        removed = [*delta.removed, *self._absent(delta)] if delta.live is not None else delta.removed
        return Delta(adds, delta.writes, removed, delta.context)

    def _remove(self, dots: list[Dot]) -> None:
        """Remove all that lives under these dots, before anybody is told; each element is told once."""
        gone = [entry for dot in dots if (entry := self._take_out(dot))]
        for key, entries in _by_key(gone):
            self._observer.entries_removed(key, entries)

    def _take_out(self, dot: Dot) -> Incarnation | None:
        """A removal is final for its dot, also when it arrives before the addition."""
        self.context.add(dot)
        self._forget_waiting(dot)
        if self.owned is not None and dot in self.entries:
            self._observer.before_change(self.entries[dot].key)
        entry = self.entries.pop(dot, None)
        if entry is None:
            return None
        siblings = self.by_key[entry.key]
        del siblings[dot]
        if not siblings:
            del self.by_key[entry.key]
        self._leave_order(dot)
        self.fingerprint ^= entry_hash(entry)
        return entry

    def _add(self, add: Add) -> Incarnation | None:
        """A dot already in the context lives already, or was removed: then a late addition is void."""
        dot = add.dot
        if dot in self.entries or dot in self.context:
            return None
        if self.owned is not None:
            self._observer.before_change(add.key)
            self.owned.add(dot)
        entry = self.entries[dot] = Incarnation(add)
        if self._order is not None:
            self._order.add(dot)
        siblings = self.by_key.get(add.key)
        if siblings is None:
            self.by_key[add.key] = {dot: entry}
        else:
            siblings[dot] = entry
        self.fingerprint ^= entry_hash(entry)
        for write in self._waiting.pop(dot, ()) if self._waiting else ():
            self._waiting_count -= weight_of(write)
            self._write(write)
            if write.dot:
                self.context.add(write.dot)
        return entry

    def _write(self, write: Write) -> bool:
        """Apply a write; false if its dot must not yet count as seen."""
        entry = self.find(write.owner)
        if entry is None:
            return write.owner in self.context or self._wait(write)
        self._set(entry, write)
        return True

    def _set(self, entry: Incarnation, write: Write) -> None:
        """Let the greater of `write` and what the register holds win."""
        attribute, registers = write.attribute, entry.registers
        current = registers.get(attribute)
        if current is not None and write.stamp <= current.stamp:
            if write.stamp < current.stamp:
                return
            if write.writer <= current.writer:
                if write.writer == current.writer:
                    self._settle_same(entry, write, current)
                return
        if self.owned is not None:
            entry = self._own(entry)
            registers = entry.registers
        registers[attribute] = write
        if write.dot is None:
            self.unsettled[(write.owner, attribute)] = 0
        if entry.announced:
            self._observer.register_changed(entry, attribute)

    def _settle_same(self, entry: Incarnation, write: Write, current: Write) -> None:
        """The same write again, now durable, or made durable by two replicas: that with the greatest dot stays.

        Whoever uses a stamp twice may have written something else, under the same dot too, and all must show the same.
        """
        if write.dot is None:
            return
        is_same = type(write.value) is type(current.value) and write.value == current.value
        if write.dot == current.dot:
            wins = not is_same and rank(write.value) > rank(current.value)
        else:
            wins = current.dot is None or write.dot > current.dot
        if wins:
            if self.owned is not None:
                entry = self._own(entry)
            entry.registers[write.attribute] = replace(current, dot=write.dot) if is_same else write
            if entry.announced and not is_same:
                self._observer.register_changed(entry, write.attribute)

    def find(self, dot: Dot) -> Incarnation | None:
        """Find the live entry that was created under `dot`, with the registers that are written here; None if there is
        none.
        """
        return self.entries.get(dot)

    @property
    def order(self) -> OrderedDots:
        """The dots of `written_dots` in order; they are sorted once after `forget_order`."""
        if self._order is None:
            self._order = OrderedDots(self.written_dots())
        return self._order

    def forget_order(self) -> None:
        """Other entries were put in the place of these."""
        self._order = None

    def _take_place(self, dot: Dot) -> None:
        if self._order is not None:
            self._order.add(dot)

    def _leave_order(self, dot: Dot) -> None:
        if self._order is not None:
            self._order.discard(dot)

    def written_dots(self) -> list[Dot]:
        """Creation dots of all that `find` finds."""
        return list(self.entries)

    def is_known(self, dot: Dot) -> bool:
        """Whether `dot` was seen: its element is here, or was removed."""
        return dot in self.context

    def element(self, dot: Dot) -> Incarnation | None:
        """Find the live node or edge under `dot`; None if there is none."""
        return self.entries.get(dot)

    def _own(self, entry: Incarnation) -> Incarnation:
        """The entry as one that may change: others that read it keep the old one."""
        assert self.owned is not None
        if entry.dot in self.owned:
            return entry
        self._observer.before_change(entry.key)
        copy = Incarnation(entry)
        copy.registers = entry.registers.copy()
        copy.announced = entry.announced
        self.entries[entry.dot] = self.by_key[entry.key][entry.dot] = copy
        self.owned.add(entry.dot)
        self._observer.entry_copied(entry, copy)
        return copy

    def _wait(self, write: Write) -> bool:
        if write.dot is None:
            return True
        if self._waiting_count < MAX_WAITING:
            self._waiting.setdefault(write.owner, []).append(write)
            self._waiting_count += weight_of(write)
        else:
            self.lost_waiting += 1
        return False

    def waiting_writes(self) -> list[Write]:
        """The writes that came before what they are written to."""
        return [write for writes in self._waiting.values() for write in writes]

    def _forget_waiting(self, dot: Dot) -> None:
        """Writes for a removed entry are void, so their dots count as seen."""
        for write in self._waiting.pop(dot, ()):
            self._waiting_count -= weight_of(write)
            if write.dot:
                self.context.add(write.dot)

    def _learn(self, delta: Delta, held_back: list[Dot]) -> None:
        """Take over the delta's context, except the dots of writes that could not be applied yet."""
        for rid, first, last in without(delta.context, held_back):
            self.context.add_range(rid, first, last)

    def rebuild(self) -> None:
        """Derive all else from the entries again, after a join that was broken off half way."""
        self.by_key, self.fingerprint = {}, 0
        self.forget_order()
        for dot, entry in self.entries.items():
            self.by_key.setdefault(entry.key, {})[dot] = entry
            self.fingerprint ^= entry_hash(entry)
            entry.announced = True
            for write in entry.registers.values():
                if write.dot is None:
                    self.unsettled.setdefault((dot, write.attribute), 0)
        self._waiting_count = sum(weight_of(write) for writes in self._waiting.values() for write in writes)

    def take_not_durable(self, due: Callable[[Write, int], bool], new_dot: Callable[[], Dot]) -> Delta:
        """Give a dot to each stream register for which `due(write, times passed over)` holds."""
        delta = Delta()
        for (owner, attribute), passes in list(self.unsettled.items()):
            entry = self.find(owner)
            write = entry.registers.get(attribute) if entry else None
            if entry is None or write is None or write.dot is not None:
                del self.unsettled[(owner, attribute)]
            elif due(write, passes):
                del self.unsettled[(owner, attribute)]
                if self.owned is not None:
                    entry = self._own(entry)
                durable = entry.registers[attribute] = replace(write, dot=new_dot())
                delta.writes.append(durable)
            else:
                self.unsettled[(owner, attribute)] = passes + 1
        delta.context = list(to_ranges(write.dot for write in delta.writes if write.dot))
        return delta


def _by_key(entries: list[Incarnation]) -> Iterable[tuple[Key, list[Incarnation]]]:
    """Incarnations by element, nodes before edges."""
    if len(entries) < 2:
        return [(entry.key, [entry]) for entry in entries]
    found: dict[Key, list[Incarnation]] = {}
    for entry in entries:
        found.setdefault(entry.key, []).append(entry)
    return sorted(found.items(), key=lambda item: not isinstance(item[0], str))


def weight_of(write: Write) -> int:
    """How many writes with a short value it counts for."""
    return 1 + len(write.value) // 100 if isinstance(write.value, str | bytes | tuple) else 1


def entry_hash(entry: Incarnation) -> int:
    """A 64-bit hash of a dot and of what was made under it, the same in every process."""
    made = _encoder.encode((entry.dot, entry.key, entry.type, entry.sources, entry.destinations))
    return int.from_bytes(blake2b(made, digest_size=8).digest(), "little")
