"""Says what was lost: compares what workers wrote, by their journals, with what all replicas show afterwards."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from benchmarks.soak.journal import Kind, Record
from benchmarks.soak.workload import NODE_EVERY, SHARED_REGISTERS, own_name, shared_name

KILL_WINDOW = 0.25
"""s before `kill -9` in which a write may never have left its process."""

State = Mapping[str, Mapping[str, Any]]
"""What a replica shows, by name, see `benchmarks.soak.worker.content`."""


@dataclass
class _Slot:
    """What the worker of a slot, and its dead predecessors, wrote of their own."""

    count: int = 0
    pose: int = 0
    nodes: dict[int, bool | None] = field(default_factory=dict)
    """Whether the node of that number must be there; None if it may be."""
    last: int = 0
    """The last step that was noted."""
    fates: list[tuple[int, float]] = field(default_factory=list)
    """Nodes made shortly before a kill, and how long before, s."""


@dataclass
class _Shared:
    """What was written into a register that all write."""

    latest_start: float = 0.0
    ended: dict[str, float] = field(default_factory=dict)
    """When the write of each value returned."""
    doubtful: set[str] = field(default_factory=set)
    """Values that may have been written just before a kill."""


class Judge:
    """Collects journals, and judges the state that all replicas agree on.

    Args:
        skew: by how much two workers' clocks may differ, s: of two writes that are closer, either may win.
    """

    def __init__(self, skew: float = 0.0) -> None:
        self.writes = 0
        self.kill_window = 0.0
        """The longest time before a kill, s, from which a write was never seen by others."""
        self._skew = skew
        self._slots: dict[str, _Slot] = {}
        self._shared = [_Shared() for _ in range(SHARED_REGISTERS)]

    def note(self, slot: str, records: Iterable[Record], killed_at: float | None = None) -> None:
        """Take note of what a worker wrote since the last time; `killed_at` if it was killed then."""
        own = self._slots.setdefault(slot, _Slot())
        for record in records:
            self.writes += 1
            own.last = max(own.last, record.number)
            sure = killed_at is None or record.ended < killed_at - KILL_WINDOW
            self._note_own(own, record, sure)
            if not sure and killed_at is not None and record.kind is Kind.ADD:
                own.fates.append((record.number, killed_at - record.ended))
            if record.kind is Kind.SHARED:
                self._note_shared(own_name(slot, record.number), record, sure)
        if killed_at is not None:
            self._note_last_words(slot, own)

    def _note_own(self, own: _Slot, record: Record, sure: bool) -> None:
        match record.kind:
            case Kind.COUNT if sure:
                own.count = max(own.count, record.number)
            case Kind.POSE if sure:
                own.pose = max(own.pose, record.number)
            case Kind.ADD:
                own.nodes[record.number] = True if sure else None
            case Kind.REMOVE:
                own.nodes[record.number] = False if sure else None

    def _note_shared(self, value: str, record: Record, sure: bool) -> None:
        register = self._shared[record.number % SHARED_REGISTERS]
        register.ended[value] = record.ended
        if sure:
            register.latest_start = max(register.latest_start, record.started)

    def _note_last_words(self, slot: str, own: _Slot) -> None:
        """A killed worker may have made one more write than it could note."""
        for step in range(own.last, own.last + NODE_EVERY + 1):
            if step % NODE_EVERY == 0:
                own.nodes.setdefault(step, None)
            self._shared[step % SHARED_REGISTERS].doubtful.add(own_name(slot, step))

    def check(self, state: State) -> list[str]:
        """What is missing, or there though it must not be, in the state that all replicas show."""
        lost: list[str] = []
        for slot, own in self._slots.items():
            lost += self._check_own(slot, own, state)
        for number, register in enumerate(self._shared):
            lost += self._check_shared(shared_name(number), register, state)
        return lost

    def _check_own(self, slot: str, own: _Slot, state: State) -> list[str]:
        lost: list[str] = []
        count, pose = state.get(slot, {}).get("seen", 0), state.get(f"world {slot} RT", {}).get("pose", [0])[0]
        if count < own.count:
            lost.append(f"{slot} counts {count}, not {own.count}")
        if pose < own.pose:
            lost.append(f"{slot} is at {pose}, not at {own.pose}")
        present = {int(name.removeprefix(f"{slot}.")) for name in state if name.startswith(f"{slot}.")}
        for number, wanted in own.nodes.items():
            if wanted is not None and wanted != (number in present):
                lost.append(f"{own_name(slot, number)} is {'missing' if wanted else 'there, though removed'}")
        lost += [f"{own_name(slot, number)} came back" for number in sorted(present - own.nodes.keys())]
        self.kill_window = max([self.kill_window, *(age for number, age in own.fates if number not in present)])
        own.fates.clear()
        own.nodes = dict.fromkeys(present, True)
        return lost

    def _check_shared(self, name: str, register: _Shared, state: State) -> list[str]:
        """The winner must not be older than another write: stamps follow the clock."""
        value = state.get(name, {}).get("note")
        if value is None:
            return [f"{name} holds nothing"] if register.latest_start else []
        ended = register.ended.get(value)
        if ended is None:
            return [] if value in register.doubtful else [f"{name} holds {value}, which nobody wrote lately"]
        register.ended = {value: ended}
        if ended + self._skew < register.latest_start:
            return [f"{name} holds {value}, older than others by {register.latest_start - ended:.3f} s"]
        return []
