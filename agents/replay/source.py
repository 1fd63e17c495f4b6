"""The graph of a recording at any of its times, without a network."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from agents.recorder.channels import SNAPSHOT
from agents.recorder.index import TimedRecord
from agents.recorder.opening import Settings, open_source
from dsr.clock import ManualClock
from dsr.errors import ConfigError, DsrError, WireError
from dsr.graph.watch import Change
from dsr.memory import Memory
from dsr.network.keys import ALL, check_name
from dsr.network.local_transport import LocalNetwork

RID = "replay"
_UNNAMED = "recording"

OnRecord = Callable[[TimedRecord], None]


class ReplayedGraph:
    """The graph of a recording, read as far as it is asked for; times are seconds since the recording's first message.

    One graph is in memory at a time, and one piece of the file. A truncated recording ends at the cut, and
    `problems` says so; changes that make no sense are counted in `malformed` and left out.

    Args:
        path: a file, the folder of a run, or a bag of ROS.
        settings: see `open_source`.
        system: likewise.

    Raises:
        RecordingError: if it is no recording, or an empty one.
        ConfigError: for settings that do not fit.
    """

    def __init__(self, path: Path | str, settings: Settings | None = None, system: str | None = None) -> None:
        self.index = open_source(path, settings, system)
        self.duration = self.index.duration
        """s"""
        self.problems = self.index.problems
        """What of the recording could not be read."""
        self.malformed = 0
        """Changes that could not be decoded."""
        self.first_malformed = ""
        self._records: Iterator[TimedRecord] = iter(())
        self._following: TimedRecord | None = None
        self._time = 0.0
        self.restart()

    def restart(self) -> None:
        """Go back to the beginning: an empty graph."""
        self._begin(self.index.read_for(0.0))

    @property
    def memory(self) -> Memory:
        """The graph at the present time. Another one after each step back."""
        return self._memory

    @property
    def time(self) -> float:
        """The present time, s."""
        return self._time

    def at(self, time: float) -> Memory:
        """The graph at `time` (s), after all messages up to then; read-only, and valid until the next call."""
        self.leap(time)
        self.forward(time)
        return self._memory

    def leap(self, time: float) -> bool:
        """Begin afresh where `forward` to `time` (s) is fastest, or needs to: another memory; false if it does not."""
        if time >= self._time and not self.index.skips_to(time, self._time):
            return False
        self._begin(self.index.read_for(time))
        return True

    def states(self, times: Iterable[float]) -> Iterator[tuple[float, Memory]]:
        """(time, graph then) for each of `times` (s), best in ascending order."""
        return ((time, self.at(time)) for time in times)

    def changes(self) -> Iterator[tuple[float, list[Change]]]:
        """(time, what changed) from the beginning on, for each message that changed something visible."""
        self.restart()
        with self._memory.watch() as watch:
            while (record := self.next()) is not None:
                if changes := watch.poll():
                    yield record.time, changes

    def next(self) -> TimedRecord | None:
        """Go on by one message and return it; None at the end."""
        record = self._following
        if record is None:
            return None
        self._following = self._take()
        self._time = max(self._time, record.time)
        self._clock.advance_to(max(self._clock.now(), self.index.begin + self._time))
        if record.topic == SNAPSHOT or record.topic.startswith(("d/", "rt/")):
            self._join(record)
        return record

    def forward(self, time: float, on_record: OnRecord | None = None) -> None:
        """Go on to `time` (s); `on_record` gets every message on the way."""
        while self._following is not None and self._following.time <= time:
            record = self.next()
            if on_record is not None and record is not None:
                on_record(record)
        self._time = max(self._time, min(time, self.duration))
        self._clock.advance_to(max(self._clock.now(), self.index.begin + self._time))

    @property
    def next_time(self) -> float:
        """Time of the message that `next` gives, s; infinite at the end."""
        return math.inf if self._following is None else self._following.time

    @property
    def ended(self) -> bool:
        """Whether all messages were read."""
        return self._following is None

    def _begin(self, records: Iterator[TimedRecord]) -> None:
        self._records = records
        self._following = self._take()
        self._time = self._following.time if self._following else 0.0
        self._clock = ManualClock(self.index.begin + self._time)
        transport = LocalNetwork(self._clock).connect(RID)
        name = _graph_name(self.index.metadata.get("graph", ""))
        self._memory = Memory(
            name, RID, transport=transport, clock=self._clock, rid=RID, guard=_refuse, interest=(ALL,)
        )

    def _take(self) -> TimedRecord | None:
        return next(self._records, None)

    def _join(self, record: TimedRecord) -> None:
        try:
            self._memory.restore(record.payload)
        except WireError as error:
            self.malformed += 1
            self.first_malformed = self.first_malformed or f"{record.topic} at {record.time:.3f} s: {error}"


def _graph_name(recorded: str) -> str:
    try:
        return check_name("graph name", recorded)
    except ConfigError:
        return _UNNAMED


def _refuse(element: str, kind: str, _attributes: Iterable[str]) -> None:
    raise DsrError(f"a recording cannot be written to: {element} of type {kind!r}")
