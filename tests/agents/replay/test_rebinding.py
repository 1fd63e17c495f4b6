"""Changes that wait for elements made anew: they find them, and many that wait cost the others nothing."""

from __future__ import annotations

import time

import numpy as np

from agents.replay.rebinding import Rebinding
from dsr.crdt.context import CausalContext, Dot
from dsr.crdt.delta import Add, Key, Write

NAMES = [f"n{number}" for number in range(6)]


def is_anew(dot: Dot) -> bool:
    return dot[0].startswith("anew")


def write_of(owner: Dot, stamp: int, attribute: str = "seen") -> Write:
    return Write(owner, attribute, stamp, "other-1", None, stamp)


class Recording:
    """Random changes, and what waits of them by a look at all."""

    def __init__(self, seed: int) -> None:
        self.chance = np.random.default_rng(seed)
        self.rebinding = Rebinding(is_anew)
        self.live: dict[Key, list[Dot]] = {}
        self.made: dict[Dot, Key] = {}
        self.writes: dict[tuple[Dot, str], Write] = {}
        self.adds: dict[Dot, Add] = {}
        self.count = 0

    def step(self) -> None:
        self.count += 1
        name = str(self.chance.choice(NAMES))
        match self.chance.integers(6):
            case 0:
                add = Add(("anew-1", self.count), name, "cube")
                self.rebinding.note_made(add)
                self.made[add.dot] = name
            case 1:
                self.live.setdefault(name, []).append(("anew-2", self.count))
                self.rebinding.note_live(name)
            case 2:
                self.live.pop(name, None)
            case 3 if self.made:
                self.write(list(self.made)[int(self.chance.integers(len(self.made)))])
            case 4:
                self.connect(name, str(self.chance.choice(NAMES)))
            case 5 if self.made or self.adds:
                known = [*self.made, *self.adds]
                self.remove(known[int(self.chance.integers(len(known)))])

    def write(self, owner: Dot) -> None:
        write = write_of(owner, int(self.chance.integers(100)), str(self.chance.choice(["seen", "mass"])))
        assert self.rebinding.take_write(write)
        before = self.writes.get((owner, write.attribute))
        if before is None or before.stamp < write.stamp:
            self.writes[owner, write.attribute] = write

    def connect(self, src: str, dst: str) -> None:
        ends = tuple((str(self.chance.choice(["anew-1", "other-1"])), int(self.chance.integers(9))) for _ in range(2))
        add = Add(("other-1", self.count), (src, dst, "on"), "on", ends[:1], ends[1:])
        waits = self.rebinding.take_add(add)
        assert waits == any(map(is_anew, ends))
        if waits:
            self.adds[add.dot] = add

    def remove(self, dot: Dot) -> None:
        self.rebinding.note_removed(dot)
        self.made.pop(dot, None)
        self.adds.pop(dot, None)
        self.writes = {key: write for key, write in self.writes.items() if key[0] != dot}

    def expected(self) -> tuple[set[Dot], set[tuple[Dot, str, int]]]:
        """The edges and the writes that can be bound now, of all that wait; they wait no more."""
        adds, writes = set(), set()
        for dot, add in list(self.adds.items()):
            ends = zip((add.sources, add.destinations), add.key[:2], strict=True)
            if all(self.live.get(name) or not all(map(is_anew, dots)) for dots, name in ends):
                adds.add(dot)
                del self.adds[dot]
        for (owner, attribute), write in list(self.writes.items()):
            if owners := self.live.get(self.made[owner]):
                writes |= {(new, attribute, write.stamp) for new in owners}
                del self.writes[owner, attribute]
        return adds, writes


def test_what_is_bound_is_what_a_look_at_all_would_find() -> None:
    for seed in range(60):
        recording = Recording(seed)
        for _ in range(80):
            recording.step()
            if recording.chance.random() < 0.5:
                bound = recording.rebinding.bound(lambda key, live=recording.live: live.get(key, []))  # type: ignore[misc]
                found = {(write.owner, write.attribute, write.stamp) for write in bound.writes}
                assert ({add.dot for add in bound.adds}, found) == recording.expected(), f"seed {seed}"
            waits = sum(recording.rebinding.waiting.values())
            assert waits == len(recording.adds) + len(recording.writes)
            ranges = recording.rebinding.without_waiting([("other-1", 1, recording.count), ("b-1", 2, 3)])
            seen = CausalContext(ranges)
            inside = {("other-1", number + 1) for number in range(recording.count)}
            assert {dot for dot in inside if dot not in seen} == set(recording.adds)
            assert ("b-1", 2) in seen and ("b-1", 3) in seen


def test_many_changes_that_wait_take_no_time_of_others() -> None:
    """A recording of some MB in which somebody writes into what is never made anew, and removes it."""

    def seconds(count: int) -> float:
        rebinding = Rebinding(is_anew)
        begin = time.process_time()
        for number in range(1, count + 1):
            dot = ("anew-1", number)
            rebinding.note_made(Add(dot, f"n{number}", "cube"))
            rebinding.take_write(write_of(dot, 1))
            rebinding.take_add(Add(("other-1", number), (f"n{number}", f"n{number}", "on"), "on", (dot,), (dot,)))
            rebinding.without_waiting([("other-1", number, number)])
            rebinding.bound(lambda key: [])
        for number in range(1, count + 1):
            rebinding.note_removed(("anew-1", number))
            rebinding.note_removed(("other-1", number))
        assert not rebinding.waiting
        return time.process_time() - begin

    seconds(100)
    few, many = (min(seconds(count) for _ in range(3)) for count in (500, 4000))
    assert many < 16.0 * few, f"{few:.3f} s, {many:.3f} s"
