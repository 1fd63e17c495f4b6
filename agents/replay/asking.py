"""Which entries of a timeline are wanted: by type, whether they last, and by Allen's relations to another time."""

from __future__ import annotations

import math
from collections.abc import Sequence

from dsr.errors import ConfigError, suggest
from dsr.timeline import EVENT, Entry, Interval
from dsr.timeline.queries import Question

TIMES = "BEGIN:END"


class Asking:
    """What is wanted; everything if nothing is given.

    Args:
        type: `event` or `situation`.
        is_open: only situations that last.
        relations: some of Allen's, one of which must be certain ...
        of: ... to the entry of this name, or to a time `BEGIN:END`, `BEGIN:` (which lasts) or `TIME`, in s.

    Raises:
        ConfigError: for what is unknown, cannot be, or does not go together.
    """

    def __init__(
        self, type: str | None = None, is_open: bool = False, relations: Sequence[str] = (), of: str | None = None
    ) -> None:
        if bool(relations) != (of is not None):
            raise ConfigError("--relation and --of go together: --relation during --of -60:0")
        if is_open and type == EVENT:
            raise ConfigError("--open: events do not last; ask for --type situation")
        self._type, self._open, self._relations, self._of = type, True if is_open else None, relations or None, of
        self._stretch = None if of is None else _stretch(of)
        self.is_given = type is not None or is_open or of is not None
        self._question(None if of is None else self._stretch or Interval(0.0, 0.0))

    def among(self, entries: Sequence[Entry], origin: float, now: float) -> list[Entry]:
        """The wanted ones.

        Args:
            entries: all that there are.
            origin: s, from which the times in `of` count.
            now: s; what lasts ends after it.

        Raises:
            ConfigError: if no entry has the name in `of`.
        """
        question = self._question(None if self._of is None else self._time(self._of, entries, origin))
        return [entry for entry in entries if question.fits(entry, now)]

    def _time(self, name: str, entries: Sequence[Entry], origin: float) -> Interval:
        if self._stretch is not None:
            begin, end = self._stretch
            return Interval(origin + begin, None if end is None else origin + end)
        times = {entry.name: entry.interval for entry in entries}
        if name not in times:
            raise ConfigError(f"--of {name}: neither an entry nor a time {TIMES}; {suggest(name, times)}")
        return times[name]

    def _question(self, of: Interval | None) -> Question:
        return Question(type=self._type, open=self._open, relation=self._relations, of=of)


def _stretch(text: str) -> Interval | None:
    """The time that a text tells; None if it is none, but may be a name."""
    first, colon, second = text.partition(":")
    try:
        begin = float(first)
        end = begin if not colon else float(second) if second else None
    except ValueError:
        return None
    if not math.isfinite(begin) or not (end is None or begin <= end < math.inf):
        raise ConfigError(f"--of {text}: expected {TIMES} in s, the earlier time first")
    return Interval(begin, end)
