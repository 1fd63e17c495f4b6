"""Runs on a machine that is busy with other work: time in which no frame came counts for no delay, and is told.

A belief cannot be newer than the newest frame. Where agents say that they wait for a processor and frames stay away
meanwhile, that time says nothing about the agents. All else is judged as ever: what is wrong although frames came, or
stays wrong, is wrong.
"""

from __future__ import annotations

from collections import defaultdict
from itertools import pairwise

import msgspec

from agents.scenario.truth.history import History
from dsr.runtime.status import PERIOD

FRAMES_STOP = 0.5
"""s between two frames from which on no frames come: five times the period of the simulated camera"""
WORTH_TELLING = 3.0
"""s of overload of an agent that are told of a run that passed; less happens while agents start"""


class Overload(msgspec.Struct, frozen=True, kw_only=True):
    """How far the machine was too busy for a run."""

    lagging_s: dict[str, float]
    """Time (s) in which each agent left out ticks because it waited for a processor; only agents that did."""
    waiting: dict[str, float]
    """Share of that time in which each of these agents waited."""
    frameless_s: float
    """Time (s) in which no frame came, for that reason; no delay counts it."""

    @property
    def text(self) -> str:
        """The same for people."""
        agents = ", ".join(
            f"{agent} for {seconds:.0f} s (waiting {100.0 * self.waiting[agent]:.0f} % of them)"
            for agent, seconds in sorted(self.lagging_s.items(), key=lambda item: -item[1])
        )
        frames = f"; no frame came for {self.frameless_s:.1f} s, which no delay counts" if self.frameless_s else ""
        return f"the machine was overloaded: agents waited for a processor and left out ticks: {agents}{frames}"


def overload(history: History, *, passed: bool) -> Overload | None:
    """How far the machine was too busy for the finished run; None if it was not.

    Of a run that has not passed every second counts: an action fails if nothing is heard of the arm for a moment.
    """
    shares: dict[str, list[float]] = defaultdict(list)
    for load in history.loads:
        if 0.0 <= load.time <= history.end:
            shares[load.agent].append(load.waiting)
    frameless = sum(end - begin for begin, end in standstills(history, history.end))
    longest = max(map(len, shares.values()), default=0) * PERIOD
    if not frameless and longest < (WORTH_TELLING if passed else PERIOD):
        return None
    return Overload(
        lagging_s={agent: len(found) * PERIOD for agent, found in shares.items()},
        waiting={agent: sum(found) / len(found) for agent, found in shares.items()},
        frameless_s=frameless,
    )


def standstills(history: History, until: float) -> list[tuple[float, float]]:
    """The times (s after the start) until `until` in which no frame came because the machine was overloaded.

    Each begins `FRAMES_STOP` after a frame. Where an agent was killed, its start is what takes time: such gaps count.
    """
    if not history.loads or not history.frames:
        return []
    frames = [*(time for time in history.frames if time < until), until]
    return [
        (before + FRAMES_STOP, after)
        for before, after in pairwise(frames)
        if after - before > FRAMES_STOP
        and any(before <= load.time <= after + 2.0 * PERIOD for load in history.loads)  # each tells of a second, later
        and not any(before <= time <= after for time in history.kills.values())
    ]


def counted(history: History, begin: float, end: float) -> float:
    """How many of the s from `begin` to `end` count: those in which frames came, or the machine was not to blame."""
    stood = sum(
        max(0.0, min(end, last) - max(begin, first)) for first, last in standstills(history, max(end, history.end))
    )
    return end - begin - stood


def moment(history: History, begin: float, seconds: float, until: float) -> float:
    """When `seconds` (s) after `begin` have been counted, as far as is known at `until`."""
    time = begin + seconds
    for first, last in standstills(history, until):
        if last > begin and first < time:
            time += last - max(first, begin)
    return time
