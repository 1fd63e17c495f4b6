"""Measures how much of a live system's processor time is the memory's Python, which a compiled core could do instead.

The entries into the memory are timed in every process of the system: what writes, sends, receives and answers. Time in
Zenoh is taken off. All processes are forks of this one, and add what they took to memory that they share.
"""

from __future__ import annotations

import functools
import mmap
import os
import struct
import threading
from collections.abc import Callable
from pathlib import Path
from time import thread_time
from typing import Any

from agents.scenario.run.staging import make_run, staged_system, without
from benchmarks.live.__main__ import measure
from dsr.cli.common import new_run_folder
from dsr.graph.watch import Watch
from dsr.memory import Memory
from dsr.network.zenoh_transport import ZenohTransport
from dsr.replication.replica import Replica
from dsr.replication.sync import Synchroniser

PARTS = ("written", "sent", "received", "polled", "watched", "Zenoh")
ENTRIES: tuple[tuple[type, str, tuple[str, ...]], ...] = (
    (Memory, "written", ("add_node", "update_node", "remove_node", "remove_attribute", "add_edge", "update_edge",
                         "update_poses", "remove_edge")),
    (Replica, "sent", ("send_soon", "flush", "_send")),
    (Replica, "received", ("_receive", "_answer")),
    (Synchroniser, "received", ("receive_delta", "receive_digest", "receive_reply", "answer")),
    (Replica, "polled", ("poll",)),
    (Watch, "watched", ("poll", "next")),
    (ZenohTransport, "Zenoh", ("publish", "is_heard", "request")),
)  # fmt: skip
"""Class, what it counts as, and methods."""
_MOST_PROCESSES = 4096
_SLOT = struct.Struct(f"<Q{len(PARTS)}d")


class Spent:
    """Processor time by part, s, of this process and all that are forked from now on."""

    def __init__(self) -> None:
        self._shared = mmap.mmap(-1, _MOST_PROCESSES * _SLOT.size)
        self._own = dict.fromkeys(PARTS, 0.0)
        self._lock = threading.Lock()
        self._local = threading.local()
        os.register_at_fork(after_in_child=self._begin)

    def _begin(self) -> None:
        self._own, self._lock = dict.fromkeys(PARTS, 0.0), threading.Lock()

    def timed(self, part: str, act: Callable[..., Any]) -> Callable[..., Any]:
        """`act`, whose processor time counts for `part`; that of other timed calls inside counts for theirs."""

        @functools.wraps(act)
        def call(*arguments: Any, **named: Any) -> Any:
            outer = getattr(self._local, "inside", None)
            inside = self._local.inside = [0.0]
            begin = thread_time()
            try:
                return act(*arguments, **named)
            finally:
                taken = thread_time() - begin
                self._local.inside = outer
                if outer is not None:
                    outer[0] += taken
                self._add(part, taken - inside[0])

        return call

    def _add(self, part: str, seconds: float) -> None:
        pid = os.getpid()
        with self._lock:
            self._own[part] += seconds
            _SLOT.pack_into(self._shared, pid % _MOST_PROCESSES * _SLOT.size, pid, *self._own.values())

    def total(self) -> dict[str, float]:
        """Of all processes until now."""
        sums = dict.fromkeys(PARTS, 0.0)
        for _, *seconds in _SLOT.iter_unpack(self._shared[:]):
            for part, value in zip(PARTS, seconds, strict=True):
                sums[part] += value
        return sums


def shares(scenario: str, seconds: float, seed: int) -> tuple[float, dict[str, float]]:
    """Cores that the live system takes, and the share of each part of the memory in its processor time."""
    run = make_run(scenario, seed=seed, sensor="poses", folder=Path(new_run_folder("compiled")))
    spent, begun = Spent(), dict[str, float]()
    for owner, part, names in ENTRIES:
        for name in names:
            setattr(owner, name, spent.timed(part, getattr(owner, name)))
    found = measure(
        run, without(staged_system(run), "viewer"), seconds, fork=True, began=lambda: begun.update(spent.total())
    )
    took = {part: (value - begun[part]) / (found.cores * found.seconds) for part, value in spent.total().items()}
    return found.cores, took
