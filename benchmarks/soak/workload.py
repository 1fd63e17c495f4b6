"""What a worker writes by itself, step by step, such that a judge can tell afterwards whether anything is missing."""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Callable

import numpy as np

from benchmarks.soak.journal import JournalWriter, Kind, Record
from dsr.clock import Clock
from dsr.errors import GraphError
from dsr.math3d.transforms import Pose
from dsr.memory import Memory

OWN_NODES = 20
"""Nodes that a worker keeps; with each new one it removes its oldest."""
NODE_EVERY, SHARED_EVERY, CONTENDED_EVERY = 4, 3, 5
"""Steps between two such writes."""
SHARED_REGISTERS = 4
CONTENDED_NODES = 6


def shared_name(number: int) -> str:
    """The node whose `note` all workers write in their step `number`."""
    return f"shared{number % SHARED_REGISTERS}"


def own_name(slot: str, number: int) -> str:
    """The node that the worker of `slot` makes in its step `number`."""
    return f"{slot}.{number}"


class Workload:
    """Writes into a memory and notes every write in a journal.

    Args:
        memory: what it writes into.
        slot: name of the worker's own node and prefix of its others.
        journal: where each write is noted once its call returned.
        first: number of its first step; greater than all of its predecessors.
        generator: decides what it does to contended nodes.
        clock: of the times in the journal.
    """

    def __init__(
        self, memory: Memory, slot: str, journal: JournalWriter, first: int, generator: np.random.Generator,
        clock: Clock,
    ) -> None:  # fmt: skip
        self._memory = memory
        self._slot = slot
        self._journal = journal
        self._number = first
        self._generator = generator
        self._clock = clock
        self._own: deque[int] = deque()
        self._begun = False

    def _begin(self) -> None:
        """Add what the steps write into."""
        memory, slot = self._memory, self._slot
        memory.add_node("world", "world")
        memory.add_node(slot, "robot", seen=self._number)
        memory.add_edge("world", slot, "RT", pose=Pose((float(self._number), 0.0, 0.0)))
        for number in range(SHARED_REGISTERS):
            memory.add_node(shared_name(number), "table")
        self._begun = True

    def step(self) -> None:
        """Some writes of each kind."""
        if not self._begun:
            self._begin()
        self._number = number = self._number + 1
        memory, slot = self._memory, self._slot
        self._noted(Kind.COUNT, number, lambda: memory.update_node(slot, seen=number))
        pose = Pose((float(number), 0.0, 0.0))
        self._noted(Kind.POSE, number, lambda: memory.update_edge("world", slot, "RT", pose=pose))
        if number % NODE_EVERY == 0:
            self._replace_oldest(number)
        if number % SHARED_EVERY == 0:
            note = own_name(slot, number)
            self._noted(Kind.SHARED, number, lambda: memory.update_node(shared_name(number), note=note))
        if number % CONTENDED_EVERY == 0:
            self._noted(Kind.CONTENDED, number, self._contend)

    def tidy(self) -> None:
        """Remove the nodes that a predecessor left."""
        prefix, own = f"{self._slot}.", set(self._own)
        for node in self._memory.nodes("ball"):
            if node.name.startswith(prefix) and int(node.name.removeprefix(prefix)) not in own:
                self._remove(int(node.name.removeprefix(prefix)))

    def _replace_oldest(self, number: int) -> None:
        name = own_name(self._slot, number)
        self._noted(Kind.ADD, number, lambda: self._memory.add_node(name, "ball", seen=number))
        self._own.append(number)
        if len(self._own) > OWN_NODES:
            self._remove(self._own.popleft())

    def _remove(self, number: int) -> None:
        self._noted(Kind.REMOVE, number, lambda: self._memory.remove_node(own_name(self._slot, number)))

    def _contend(self) -> None:
        """Create, write, connect or remove what others work on at the same time; it may be gone meanwhile."""
        name, other = (f"contended{index}" for index in self._generator.integers(CONTENDED_NODES, size=2))
        memory = self._memory
        with contextlib.suppress(GraphError):
            match int(self._generator.integers(5)):
                case 0:
                    memory.add_node(name, str(self._generator.choice(["cube", "cup"])))
                case 1:
                    memory.update_node(name, seen=self._number)
                case 2:
                    memory.add_edge(name, other, "on", since=float(self._number))
                case 3:
                    memory.remove_edge(name, other, "on")
                case _:
                    memory.remove_node(name)

    def _noted(self, kind: Kind, number: int, write: Callable[[], object]) -> None:
        started = self._clock.monotonic()
        write()
        self._journal.append(Record(kind, number, started, self._clock.monotonic()))
