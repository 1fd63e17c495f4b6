"""A world that an agent reads: it is opened when it is there, and its changes are collected."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from dsr.errors import WorldNotFoundError
from dsr.graph.watch import Change, Watch

if TYPE_CHECKING:
    from dsr.memory import Memory


class Source:
    """A world and the watch over it.

    Args:
        base: the memory that leads to the worlds.
        name: of the world.
        wake: called when something changes, in any thread; nothing is if None.
    """

    def __init__(self, base: Memory, name: str, wake: Callable[[], None] | None) -> None:
        self.name = name
        self.taken = 0
        """Changes that were taken."""
        self._base = base
        self._wake = wake
        self._memory: Memory | None = None
        self._watch: Watch | None = None
        self._deleted = False

    @property
    def is_open(self) -> bool:
        """Whether the world is there; not any more once it was deleted."""
        if self._memory is not None and self._memory.closed:
            self._memory, self._deleted = None, True
        return self._memory is not None

    def open(self) -> Memory:
        """The world; `take` begins with all that it holds.

        Raises:
            WorldNotFoundError: if it is not there.
            TransportError: if those who hold it do not answer.
        """
        try:
            memory = self._base.world(self.name)
        except WorldNotFoundError as error:
            raise WorldNotFoundError(f"world {self.name!r} was deleted") if self._deleted else error from None
        self._watch = memory.watch(notify=self._wake)
        self._memory, self._deleted = memory, False
        return memory

    def take(self) -> list[Change]:
        """Return the changes since the last call, whole messages only."""
        if self._memory is None or self._watch is None:
            return []
        with self._memory.replica.lock:
            changes = self._watch.poll()
        self.taken += len(changes)
        return changes
