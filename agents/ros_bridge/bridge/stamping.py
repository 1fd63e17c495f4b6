"""Whether a stamp of ROS can be used in the memory, for sensors of all kinds, and one of the memory in ROS."""

from __future__ import annotations

from agents.ros_bridge.bridge.core import BridgeCore
from agents.ros_bridge.bridge.times import MOST_AHEAD, MOST_BEHIND


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
    if _is_ahead(core, stamp, subject, "set the clocks, or `restamp = true`"):
        return None
    if stamp < now - MOST_BEHIND:
        core.tally.tell(
            "from the past", subject,
            f"{subject!r} is stamped {now - stamp:.1f} s behind our clock: set the clocks, or `restamp = true`; "
            "a bag is played with --clock, and dsr ros run with --use-sim-time",
        )  # fmt: skip
    return stamp


def is_to_come(core: BridgeCore, stamp: float, subject: str) -> bool:
    """Whether a stamp of the memory (s) is of a time to come: in ROS that would hide all that is true until then."""
    return _is_ahead(core, stamp, subject, "set the clocks, or look who wrote it (`dsr stamps`)")


def _is_ahead(core: BridgeCore, stamp: float, subject: str, advice: str) -> bool:
    ahead = stamp - core.times.now()
    if ahead <= MOST_AHEAD:
        return False
    text = f"{subject!r} is stamped {ahead:.1f} s ahead of our clock, and dropped: {advice}"
    core.tally.tell("from the future", subject, text)
    return True
