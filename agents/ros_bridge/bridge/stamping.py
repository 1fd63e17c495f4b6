"""Whether a stamp of ROS can be used in the memory, and from when on one of the memory can be used in ROS."""

from __future__ import annotations

import math
from typing import Generic, TypeVar

from agents.ros_bridge.bridge.core import BridgeCore
from agents.ros_bridge.bridge.times import MOST_AHEAD, MOST_BEHIND

K = TypeVar("K")
V = TypeVar("V")


def usable_stamp(core: BridgeCore, told: float, arrival: float, *, restamp: bool, subject: str) -> float | None:
    """The stamp of the memory (s) of one of ROS (s); None, and told, for one from the future. One of long ago is told.

    Args:
        core: of the bridge.
        told: s, as the message says; 0 if it does not say, and then it is the time of arrival.
        arrival: s, by our clock.
        restamp: take the time of arrival in any case.
        subject: what is stamped, for people.
    """
    if told == 0.0 or restamp:
        return arrival
    if not core.times.is_known:
        core.tally.count("before the first /clock")
        return None
    stamp, now = core.times.to_graph(told), core.times.now()
    if _is_ahead(core, stamp, subject, "is dropped: set the clocks, or `restamp = true`"):
        return None
    if stamp < now - MOST_BEHIND:
        core.tally.tell(
            "from the past", subject,
            f"{subject!r} is stamped {now - stamp:.1f} s behind our clock: set the clocks, or `restamp = true`; "
            "a bag is played with --clock, and dsr ros run with --use-sim-time",
        )  # fmt: skip
    return stamp


class Upcoming(Generic[K, V]):
    """What the memory has of times to come, until these come: in ROS it would hide all that is true until then.

    Of each key one value waits, that of the soonest time. So one of a clock that is ahead is sent, however often it
    writes. What waits is outdone by what is of now.
    """

    def __init__(self, core: BridgeCore) -> None:
        self._core = core
        self._waiting: dict[K, tuple[float, V]] = {}
        """Stamp (s) and value"""
        self._soonest = math.inf
        """s, a stamp that no value that waits is before"""

    def waits(self, key: K, stamp: float, value: V, subject: str) -> bool:
        """Whether a value with this stamp of the memory (s) cannot be sent yet."""
        if not _is_ahead(self._core, stamp, subject, "waits until then: set the clocks, or look at `dsr stamps`"):
            self.drop(key)
            return False
        if key not in self._waiting or stamp < self._waiting[key][0]:
            self._waiting[key] = stamp, value
            self._soonest = min(self._soonest, stamp)
        return True

    def drop(self, key: K) -> None:
        """Let nothing of a key wait."""
        self._waiting.pop(key, None)

    def due(self) -> list[tuple[K, V]]:
        """Keys and values whose time has come; these wait no more."""
        until = self._core.times.now() + MOST_AHEAD
        if self._soonest > until:
            return []
        found = [(key, value) for key, (stamp, value) in self._waiting.items() if stamp <= until]
        for key, _ in found:
            self.drop(key)
        self._soonest = min((stamp for stamp, _ in self._waiting.values()), default=math.inf)
        return found


def _is_ahead(core: BridgeCore, stamp: float, subject: str, what: str) -> bool:
    ahead = stamp - core.times.now()
    if ahead <= MOST_AHEAD:
        return False
    text = f"{subject!r} is stamped {ahead:.1f} s ahead of our clock, and {what}"
    core.tally.tell("from the future", subject, text)
    return True
