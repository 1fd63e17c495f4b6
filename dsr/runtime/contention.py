"""Whether an agent lags because its machine has more to do than it has processors, as the kernel counts it."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from pathlib import Path

OVERLOADED = 0.2
"""Share of its time that an agent that leaves out ticks must wait for a processor for the machine to be the reason: all
that the agent does then takes a quarter longer. A single other process on each processor reaches it."""
WARN_AFTER = 3.0
"""s of overload without a break until an agent warns; starts, where all agents load their libraries, are shorter."""

_WINDOW = 0.9  # s over which the share is taken at least: statuses of changes of state come sooner
_NANOSECOND = 1e-9  # s
_SCHEDSTAT = Path("/proc/thread-self/schedstat")


def time_waited() -> float:
    """Time (s) that the calling thread has stood ready to run since its start while no processor was free.

    It is nan where the kernel does not count that: on systems other than Linux.
    """
    return _waited(_SCHEDSTAT)


def longest_waited(pid: int) -> float:
    """The same time (s) of the thread of a process that has stood ready longest; 0 where the kernel does not count."""
    waited = map(_waited, Path(f"/proc/{pid}/task").glob("*/schedstat"))
    return max((time for time in waited if math.isfinite(time)), default=0.0)


def _waited(schedstat: Path) -> float:
    try:
        return int(schedstat.read_text(encoding="ascii").split()[1]) * _NANOSECOND
    except (OSError, ValueError, IndexError):
        return math.nan


class Contention:
    """Follows how long the thread of an agent waits for a processor, and whether ticks are left out meanwhile.

    Args:
        waited: as `time_waited`.
    """

    def __init__(self, waited: Callable[[], float] = time_waited) -> None:
        self.waiting = 0.0
        """Share of the time lately in which the thread stood ready and no processor was free."""
        self.overloaded = False
        """Whether the agent waited for `OVERLOADED` of the time lately, and left out ticks."""
        self.lasts = 0.0
        """s for which it has been overloaded without a break."""
        self._waited = waited
        self._before: tuple[int, float, float, int] | None = None  # thread, s, s waited, ticks left out

    def note(self, now: float, missed: int) -> None:
        """Look again, in the agent's thread.

        Args:
            now: s, monotonic.
            missed: ticks that the agent has left out since its start.
        """
        found = (threading.get_native_id(), now, self._waited(), missed)
        if self._before is None or self._before[0] != found[0]:
            self._before = found
            return
        _, since, waited, left_out = self._before
        if now - since < _WINDOW:
            return
        self._before = found
        share = (found[2] - waited) / (now - since)
        self.waiting = min(max(share, 0.0), 1.0) if math.isfinite(share) else 0.0
        self.overloaded = self.waiting >= OVERLOADED and missed > left_out
        self.lasts = self.lasts + now - since if self.overloaded else 0.0
