"""The agents that are at work, by their statuses."""

from __future__ import annotations

from collections.abc import Iterator

from agents.chronicler.facts import Fact
from dsr.runtime.status import SILENT_AFTER, State, Status
from dsr.timeline import AGENT, Entry

LAG = SILENT_AFTER + 2.0
"""s in which every agent that is at work is heard"""
_MOST_GONE = 1000
_ENDED = (State.STOPPED, State.FAILED)
_Run = tuple[str, str]
"""(agent, replica id)"""


class Company:
    """Who is at work, and how those ended who are not any more."""

    def __init__(self) -> None:
        self._begins: dict[_Run, tuple[float, str]] = {}
        self._heard: dict[_Run, float] = {}
        self._gone: dict[_Run, tuple[float, str]] = {}

    def hear(self, status: Status, now: float) -> bool:
        """Take in a status that arrived at time `now` (s); returns whether somebody came or went."""
        run = (status.agent, status.rid)
        stamp = min(status.stamp, now) if status.stamp > 0.0 else now
        if status.state in _ENDED:
            how = "stopped" if status.state is State.STOPPED else f"failed: {status.last_error}"
            was_there = run in self._begins
            self._leave(run, stamp, f"{status.agent} {how}")
            return was_there
        for other in [other for other in self._begins if other[0] == status.agent and other != run]:
            self._leave(other, self._heard[other], f"{status.agent} was started again")
        started = "started" if status.state is State.STARTING else "is at work"
        is_new = run not in self._begins
        self._begins.setdefault(run, (stamp, f"{status.agent} {started}"))
        self._heard[run] = now
        return is_new

    def facts(self, now: float) -> Iterator[Fact]:
        """Those at work at time `now` (s); who was not heard for long is not any more."""
        for run, heard in list(self._heard.items()):
            if now - heard > SILENT_AFTER:
                self._leave(run, heard, f"{run[0]} silent for {SILENT_AFTER:g} s")
        for run, (begin, text) in self._begins.items():
            yield Fact(AGENT, run, begin, repr(begin), False, text)

    def ending(self, entry: Entry, now: float) -> tuple[float, str]:
        """When (s) and how an agent's run ended; of one that never was heard, `now`."""
        agent, rid = (*entry.participants, "", "")[:2]
        return self._gone.get((agent, rid), (now, f"{agent} is not heard"))

    def _leave(self, run: _Run, time: float, outcome: str) -> None:
        self._begins.pop(run, None)
        self._heard.pop(run, None)
        self._gone.pop(run, None)
        self._gone[run] = (time, outcome)
        if len(self._gone) > _MOST_GONE:
            del self._gone[next(iter(self._gone))]
