"""The message by which a replay tells what time it is in the recording."""

from __future__ import annotations

import math

import msgspec

from dsr.network.decoding import decoded
from dsr.network.keys import Keys


class Replayed(msgspec.Struct, frozen=True):
    """Where a replay is, MessagePack."""

    stamp: float
    """s, time in the recording: what it shows has stamps up to this one"""
    begin: float
    """s, stamp of the recording's first message"""


_decoder = msgspec.msgpack.Decoder(Replayed)


def decode_replayed(payload: bytes) -> Replayed:
    """The time in a message; raises `WireError`."""
    return decoded(payload, "time of a replay", _read)


def _read(payload: bytes) -> Replayed:
    replayed = _decoder.decode(payload)
    if not (math.isfinite(replayed.stamp) and math.isfinite(replayed.begin)):
        raise ValueError(f"time {replayed.stamp}, begin {replayed.begin}")
    return replayed


def replayed_key(keys: Keys) -> str:
    """Key on which a replay sends `Replayed` as it goes."""
    return keys.device("replay/time")
