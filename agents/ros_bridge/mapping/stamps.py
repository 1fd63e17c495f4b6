"""Times of ROS (seconds and nanoseconds) and stamps of the graph (seconds as a float, exact to a microsecond)."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

from agents.ros_bridge.errors import RosMessageError
from agents.ros_bridge.messages.types import RosTypes

TIME = "builtin_interfaces/msg/Time"
DURATION = "builtin_interfaces/msg/Duration"
HEADER = "std_msgs/msg/Header"
CLOCK = "rosgraph_msgs/msg/Clock"
_LATEST = 2**31 - 1  # s, in 2038: the field has 32 bits

_LATELY = 16
"""Stamps that are remembered as ROS has them: what is sent at once mostly has the same ones"""


def to_seconds(time: Any) -> float:
    """The stamp of a message's Time or Duration, s."""
    return float(time.sec) + 1e-9 * float(time.nanosec)


@lru_cache(_LATELY)
def split(stamp: float) -> tuple[int, int]:
    """Seconds and nanoseconds of a stamp (s). Raises `RosMessageError` for one that ROS cannot express."""
    if not (math.isfinite(stamp) and -_LATEST <= stamp <= _LATEST):
        raise RosMessageError(f"a stamp of {stamp} s: ROS has none beyond {_LATEST} s")
    seconds = math.floor(stamp)
    nanoseconds = round((stamp - seconds) * 1e9)
    return (seconds + 1, 0) if nanoseconds == 10**9 else (seconds, nanoseconds)


def to_time(types: RosTypes, stamp: float) -> Any:
    """A Time of a stamp (s)."""
    sec, nanosec = split(stamp)
    return types.new(TIME, sec=sec, nanosec=nanosec)


def to_duration(types: RosTypes, seconds: float) -> Any:
    """A Duration, s."""
    sec, nanosec = split(seconds)
    return types.new(DURATION, sec=sec, nanosec=nanosec)


def to_header(types: RosTypes, stamp: float, frame: str) -> Any:
    """A Header of a stamp (s) and a frame's name."""
    return types.new(HEADER, stamp=to_time(types, stamp), frame_id=frame)


def to_clock(types: RosTypes, now: float) -> Any:
    """A message for `/clock`; `now` in s."""
    return types.new(CLOCK, clock=to_time(types, now))
