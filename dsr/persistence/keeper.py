"""Keeps the state of a memory in a folder, so that a crash of everything loses no more than the last moment.

    with dsr.connect("tabletop", agent="archivist") as memory:
        keeper = dsr.StateKeeper(memory, Path("state"))     # what the folder holds is in the memory now

Several times a second, what is new is appended to a journal and flushed to the disk (`fsync`); when the journal has
outgrown the last snapshot, and at the end, a new snapshot begins a new generation (dsr/persistence/generations.py).
State is kept as replicas exchange it: restoring it is joining it, so what was deleted stays deleted, and replicas
that still live, or come back, lose nothing.
"""

from __future__ import annotations

import contextlib
import errno
import logging
import os
import threading
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import IO

from dsr.crdt.delta import Delta
from dsr.errors import ConfigError
from dsr.files.private_files import lock_file, private_folder
from dsr.forking import leave_to_parent
from dsr.memory import Memory
from dsr.network.keys import WHOLE
from dsr.persistence.generations import Generations
from dsr.persistence.pending import PendingWrites, pieces
from dsr.persistence.records import append_record
from dsr.replication.collector import collector_paused
from dsr.replication.wire import encode_delta
from dsr.threads import new_thread

PERIOD = 0.25
"""s between two searches for new changes."""
RETRY = 1.0
"""s until the next attempt after the disk refused."""
LEAST_JOURNAL = 1 << 20
"""bytes that a journal may have however small the snapshot is."""

_log = logging.getLogger("dsr.persistence")


class StateKeeper:
    """Restores a memory from a folder, and keeps its state there until the memory is closed.

    Args:
        memory: the replica to keep; it should have joined its graph.
        folder: made if missing; belongs to one keeper at a time.
        threaded: write from a thread of its own. Without, call `flush` several times a second.
        content: what the folder holds, if the memory has it already; it is read if None.
        part: which part of the graph to keep, which the memory holds; by default what is in no part.

    Raises:
        ConfigError: if the folder is in use, cannot be written, or no snapshot in it can be read.
    """

    def __init__(
        self,
        memory: Memory,
        folder: Path,
        *,
        threaded: bool = True,
        content: Iterable[Delta] | None = None,
        part: str = WHOLE,
    ) -> None:
        replica = memory.part_replica(part) if part else memory.replica
        self.folder = folder
        self._clock = memory.clock
        self._lock, self._graph = replica.lock, replica.graph
        self._pending = PendingWrites()
        self._journal: IO[bytes] | None = None
        self._journal_size = self._snapshot_size = 0
        self._retry_at: float | None = None
        """When to try again, if the disk refused."""
        self._changed = False
        """Whether anything is newer than the snapshot."""
        self._flushing = threading.Lock()
        self._stop = threading.Event()
        self._thread = new_thread(self._run, "dsr-state") if threaded else None
        self._claim = _claimed(folder)
        try:
            self._generations = Generations(folder)
            self.restored = self._restore() if content is None else any(delta.context for delta in content)
            """Whether the folder held a state: of a graph that anybody ever wrote to."""
            self._begin_generation()
        except BaseException as error:
            self._release()
            if isinstance(error, OSError):
                raise ConfigError(f"state folder {folder} cannot be used: {error.strerror}") from error
            raise
        leave_to_parent(self)
        memory.on_close(self.close)
        if self._thread:
            self._thread.start()

    def flush(self) -> None:
        """Write new changes to the disk, now; if the disk refuses, that is logged and tried again later."""
        with self._flushing:
            if self._stop.is_set():
                return
            try:
                if self._retry_at is None:
                    self._write_news()
                    if self._journal_size > max(LEAST_JOURNAL, self._snapshot_size):
                        self._begin_generation()
                elif self._clock.monotonic() >= self._retry_at:
                    self._begin_generation()
                    self._retry_at = None
                    _log.warning("the state is kept again in %s", self.folder)
            except Exception as error:
                self._give_up_for_now(error)

    def snapshot(self) -> None:
        """Begin a new generation with a snapshot of all, now. Raises `OSError`."""
        with self._flushing:
            self._begin_generation()

    def close(self) -> None:
        """Write a last snapshot and release the folder; harmless when repeated."""
        if self._stop.is_set():
            return
        self.flush()
        with self._flushing:
            with contextlib.suppress(OSError):  # the journal has everything, or a flush has told why not
                if self._changed or self._retry_at is not None:
                    self._begin_generation()
            self._stop.set()
            self._release()
        if self._thread:
            self._thread.join()

    def abandon(self) -> None:
        """Let go of the folder in a forked child: it would keep the lock of a dead parent."""
        self._stop.set()
        self._graph.store.recorder = None
        self._claim.close()

    def _restore(self) -> bool:
        found = False
        with collector_paused():
            for delta in self._generations.restored():
                with self._lock:
                    self._graph.join(delta, self._clock.now())
                found = found or bool(delta.context)
        return found

    def _begin_generation(self) -> None:
        """Take a snapshot; what is new from its beginning on goes to a journal of its own. Raises `OSError`."""
        old, self._journal = self._journal, self._generations.begin()
        with self._lock:
            news = self._pending.take()
            self._graph.store.recorder = self._pending.add
            state = pieces(self._graph.store, self._lock)
        if old is not None:
            with old:
                self._append(old, news)
        self._journal_size = 0
        self._changed = False
        self._snapshot_size = self._generations.write_snapshot(self._with_news(state))

    def _with_news(self, state: Iterator[Delta]) -> Iterator[Delta]:
        """`state`, with what is new written in time while it is taken."""
        due = self._clock.monotonic() + PERIOD
        for piece in state:
            yield piece
            if self._clock.monotonic() >= due:
                self._write_news()
                due = self._clock.monotonic() + PERIOD

    def _write_news(self) -> None:
        """Append what is new to the journal. Raises `OSError`."""
        assert self._journal is not None
        with self._lock:
            news = self._pending.take()
        if news:
            self._append(self._journal, news)
            self._changed = True
        if os.fstat(self._journal.fileno()).st_nlink == 0:
            raise FileNotFoundError(errno.ENOENT, "the folder was removed")

    def _append(self, journal: IO[bytes], news: list[Delta]) -> None:
        for delta in news:
            self._journal_size += append_record(journal, encode_delta(delta))
        journal.flush()
        os.fsync(journal.fileno())

    def _give_up_for_now(self, error: Exception) -> None:
        """Record nothing until a new generation can be begun: what was not written is in its snapshot."""
        if self._retry_at is None:
            reason = error.strerror if isinstance(error, OSError) else repr(error)
            _log.error("the state cannot be kept in %s (%s); trying again every %g s", self.folder, reason, RETRY)
        with self._lock:
            self._graph.store.recorder = None
            self._pending = PendingWrites()
        if self._journal is not None:
            with contextlib.suppress(OSError):
                self._journal.close()
            self._journal = None
        self._retry_at = self._clock.monotonic() + RETRY

    def _release(self) -> None:
        self._graph.store.recorder = None
        if self._journal is not None:
            with contextlib.suppress(OSError):
                self._journal.close()
        Path(self._claim.name).unlink(missing_ok=True)
        self._claim.close()

    def _run(self) -> None:
        while not self._clock.wait(self._stop, PERIOD):
            self.flush()


def _claimed(folder: Path) -> IO[str]:
    """The locked file that makes `folder` ours. Raises `ConfigError` if it is somebody else's, or cannot be written."""
    try:
        claim = lock_file(private_folder(folder) / "lock")
    except OSError as error:
        raise ConfigError(f"state folder {folder} cannot be used: {error.strerror}") from error
    if claim is None:
        raise ConfigError(f"state folder {folder} is in use by another process")
    return claim
