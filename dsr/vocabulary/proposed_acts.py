"""Acts that an assistant proposes and a person decides on: what travels between the tool server and who decides."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import msgspec

from dsr.network.decoding import decoded

ACTS_SERVICE = "assistant_acts"
"""Name of the service by which a person confirms, see `Keys.service`."""


class ActState(StrEnum):
    """What became of a proposal."""

    WAITING = "waiting for a person to confirm"
    REFUSED = "refused by a person"
    DONE = "done"
    FAILED = "failed"
    EXPIRED = "expired: nobody confirmed it in time"


class ProposedAct(msgspec.Struct, frozen=True):
    """An act that an assistant proposes."""

    id: str
    act: str
    """The act in a few words, as a person decides on it."""
    preview: tuple[str, ...]
    """What would come of it, sentence by sentence."""
    until: float
    """s, until when it can be confirmed"""
    state: ActState = ActState.WAITING
    outcome: str = ""
    """What came of it, or why nothing did."""


class Confirmation(msgspec.Struct, frozen=True):
    """What a person decides; with an empty id, only a question for what waits."""

    id: Annotated[str, msgspec.Meta(max_length=64)] = ""
    accept: bool = False


_decisions = msgspec.msgpack.Decoder(Confirmation)
_acts = msgspec.msgpack.Decoder(list[ProposedAct])


def decode_confirmation(payload: bytes) -> Confirmation:
    """A decision of a message; raises `WireError`."""
    return decoded(payload, "decision", _decisions.decode)


def encode_acts(acts: list[ProposedAct]) -> bytes:
    """What waits, or was decided on, as a message."""
    return msgspec.msgpack.encode(acts)


def encode_confirmation(decision: Confirmation) -> bytes:
    """A decision as a message."""
    return msgspec.msgpack.encode(decision)


def decode_acts(payload: bytes) -> list[ProposedAct]:
    """The acts of an answer; raises `WireError`."""
    return decoded(payload, "acts of an assistant", _acts.decode)
