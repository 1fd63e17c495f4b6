"""The message that tells the time 0 of a scenario: to the plant, which then moves things, and to who counts from it."""

from __future__ import annotations

import math

import msgspec

from dsr.network.decoding import decoded
from dsr.network.keys import Keys

LEAD = 0.5
"""s before time 0 when the runner tells it: longer than a message takes to every process of a busy machine."""


class Start(msgspec.Struct, frozen=True):
    """The message that starts the timeline, MessagePack."""

    stamp: float
    """s, time 0 of the scenario"""


_start_decoder = msgspec.msgpack.Decoder(Start)


def decode_start(payload: bytes) -> Start:
    """The start in a message; raises `WireError`."""
    return decoded(payload, "start", _read_start)


def _read_start(payload: bytes) -> Start:
    start = _start_decoder.decode(payload)
    if not math.isfinite(start.stamp):
        raise ValueError(f"time {start.stamp}")
    return start


def start_key(keys: Keys) -> str:
    """Key on which the runner of a scenario sends `Start`, once a second."""
    return keys.device("scenario/start")
