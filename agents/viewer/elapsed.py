"""Counts seconds as the story of a run does: from the start of the scenario or recording, else from the first look."""

from __future__ import annotations

import logging

import rerun as rr

from agents.inbox import Message
from dsr import WireError
from dsr.vocabulary.replayed import decode_replayed
from dsr.vocabulary.scenario_start import LEAD, decode_start

ELAPSED = "elapsed"
"""Time line of the recording: s since time 0."""
TIME_OF_DAY = "stamp"
"""Time line of the recording: time since 1970, as messages and poses are stamped."""
_NEVER = 3.2e8  # s, ten years: what claims to be as far from time 0 has no time


class Elapsed:
    """Knows time 0, and sets both time lines of a recording.

    Args:
        recording: whose time lines are set.
        awaits_start: a scenario is about to start, and its time 0 is told. All that is drawn before is at one moment.
        log: is told about malformed messages.
    """

    def __init__(self, recording: rr.RecordingStream, awaits_start: bool, log: logging.Logger) -> None:
        self.malformed = 0
        self._recording = recording
        self._awaits = awaits_start
        self._log = log
        self._zero: float | None = None
        self._replayed: float | None = None
        self._is_told = False

    @property
    def is_told(self) -> bool:
        """Whether a scenario or a replay has told its time 0."""
        return self._is_told

    def note_start(self, message: Message) -> None:
        """Count from the start in a message; malformed ones are counted and left out."""
        try:
            self._zero = decode_start(message.payload).stamp
        except WireError as error:
            self._drop(message, error)
        else:
            self._awaits, self._is_told = False, True

    def note_replayed(self, message: Message) -> None:
        """Go by the time of the recording in a message; malformed ones are counted and left out."""
        try:
            replayed = decode_replayed(message.payload)
        except WireError as error:
            self._drop(message, error)
        else:
            self._awaits, self._is_told = False, True
            self._zero, self._replayed = replayed.begin, replayed.stamp

    def now(self, clock: float) -> float:
        """Time (s) of what is shown: that of the recording while one is replayed, else that of the clock."""
        return clock if self._replayed is None else self._replayed

    def seconds(self, stamp: float) -> float:
        """Time (s) since time 0 at `stamp` (s since 1970)."""
        if self._awaits:
            return -LEAD
        if self._zero is None:
            self._zero = stamp
        return stamp - self._zero

    def text(self, stamp: float) -> str:
        """The same for people, as wide as in the story of a run."""
        seconds = self.seconds(stamp)
        return f"{round(seconds, 1) + 0.0:6.1f} s" if abs(seconds) < _NEVER else "at no time"

    def set(self, stamp: float) -> None:
        """Let all that is logged from now on be of the time `stamp` (s since 1970); what is no time changes nothing."""
        seconds = self.seconds(stamp)
        if abs(seconds) < _NEVER:
            self._recording.set_time(TIME_OF_DAY, timestamp=stamp)
            self._recording.set_time(ELAPSED, duration=seconds)

    def _drop(self, message: Message, error: Exception) -> None:
        self.malformed += 1
        if self.malformed == 1:
            self._log.warning("dropped a message on %s: %s (logged once)", message.key, error)
