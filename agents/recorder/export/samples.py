"""Walks through a recording and yields the rows of its tables, as far as they are wanted."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterable, Iterator
from fnmatch import fnmatchcase
from typing import NamedTuple

from agents.recorder.export.rows import Row, graph_rows, participants_of, traffic_rows
from agents.recorder.export.tables import TABLES
from agents.replay.source import ReplayedGraph
from dsr.errors import ConfigError, WireError, suggest
from dsr.graph.watch import Change
from dsr.runtime.status import decode_status
from dsr.timeline import Event, Timeline

OnProgress = Callable[[float, float], None]
"""Called with the time reached and that of the end, s."""


class TableRow(NamedTuple):
    """A row and the name of its table."""

    table: str
    row: Row


class ExportSelection:
    """A choice of rows.

    Args:
        nodes: names or patterns such as `cube_*`: only what is about them; all if none. Logs and statuses, which are
            about agents, are not concerned.
        tables: names of tables; all if none.
        since: s since the recording's first message; what is known then is in the first rows.
        until: s, likewise.

    Raises:
        ConfigError: for an unknown table, or times between which nothing can be.
    """

    def __init__(
        self,
        nodes: Iterable[str] = (),
        tables: Iterable[str] = (),
        since: float = 0.0,
        until: float = math.inf,
    ) -> None:
        known = [table.name for table in TABLES]
        self.nodes = tuple(nodes)
        self.tables = tuple(tables) or tuple(known)
        self.since, self.until = since, until
        for name in self.tables:
            if name not in known:
                raise ConfigError(f"--table {name}: no such table; {suggest(name, known)}")
        if not 0.0 <= since <= until:  # also what is no number
            raise ConfigError(f"--from {since:g}, --until {until:g}: expected the earlier time first")
        self._seen: set[str] = set()

    def fits(self, names: Iterable[str]) -> bool:
        """Whether what is about these nodes is wanted."""
        names = tuple(names)
        if not self.nodes:
            return True
        self._seen.update(names)
        return any(fnmatchcase(name, pattern) for pattern in self.nodes for name in names)

    def check_begin(self, duration: float) -> None:
        """Raise `ConfigError` if a recording of this duration (s) ends before the time wanted."""
        if self.since > duration:
            raise ConfigError(f"--from {self.since:g}: expected at most {duration:.1f} s, where the recording ends")

    def check_found(self) -> None:
        """Raise `ConfigError` for a node that nothing was about."""
        for pattern in self.nodes:
            if not any(fnmatchcase(name, pattern) for name in self._seen):
                raise ConfigError(f"--node {pattern}: no such node in that time; {suggest(pattern, self._seen)}")


def rows_of(
    source: ReplayedGraph, wanted: ExportSelection, on_progress: OnProgress | None = None
) -> Iterator[TableRow]:
    """Yield all wanted rows of a recording in the order of time; messages that make no sense are counted in `source`.

    Raises:
        ConfigError: if the recording ends before the time wanted, or has none of the nodes wanted.
    """
    wanted.check_begin(source.duration)
    end = min(wanted.until, source.duration)
    source.restart()
    source.leap(wanted.since)
    walk = _Walk(source, wanted)
    memory = source.memory
    watch = None
    while (record := source.next()) is not None and record.time <= wanted.until:
        if record.time < wanted.since:
            continue
        watch = watch or memory.watch()
        if "events" in wanted.tables:
            yield from walk.events(record.time, record.topic, record.payload)
        try:
            for table, names, row in traffic_rows(record):
                if table in wanted.tables and (names is None or wanted.fits(names)):
                    yield TableRow(table, row)
        except WireError:
            source.malformed += 1
        yield from walk.changes(record.time, watch.poll())
        if on_progress is not None:
            on_progress(record.time, end)
    if watch is not None:
        watch.close()
    wanted.check_found()


class _Walk:
    """What is told of changes and statuses on the way."""

    def __init__(self, source: ReplayedGraph, wanted: ExportSelection) -> None:
        self._source = source
        self._wanted = wanted
        self._timeline = Timeline()

    def changes(self, time: float, changes: list[Change]) -> Iterator[TableRow]:
        """Rows about what changed at `time` (s)."""
        memory, wanted = self._source.memory, self._wanted
        for change in changes:
            names = (change.name,) if change.element == "node" else (change.src, change.dst)
            if wanted.fits(names):
                for table, row in graph_rows(time, change, memory):
                    if table in wanted.tables:
                        yield TableRow(table, row)
        if changes and "events" in wanted.tables:
            yield from self._told(time, self._timeline.note(changes, memory, self._source.index.begin + time))

    def events(self, time: float, topic: str, payload: bytes) -> Iterator[TableRow]:
        """Rows about agents that came, went or changed their state."""
        now = self._source.index.begin + time
        events: list[Event] = []
        if topic.startswith("status/"):
            with contextlib.suppress(WireError):  # counted where its row is made
                events += self._timeline.note_status(decode_status(payload), now)
        yield from self._told(time, [*events, *self._timeline.note_silence(now)])

    def _told(self, time: float, events: Iterable[Event]) -> Iterator[TableRow]:
        for event in events:
            if self._wanted.fits(participants_of(event)):
                yield TableRow("events", (time, event.time, event.kind, event.subject, event.text))
