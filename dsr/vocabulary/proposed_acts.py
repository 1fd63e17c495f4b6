"""Acts that an assistant proposes and a person decides on: what travels between the tool server and who decides."""

from __future__ import annotations

import hashlib
from enum import StrEnum
from typing import Annotated

import msgspec

from dsr.network.decoding import decoded

ACTS_SERVICE = "assistant_acts"
"""Name of the service that tells what is proposed, see `Keys.service`. Everybody may ask."""
DECISIONS = "assistant_decisions"
"""Name of the key on which a person decides, see `Keys.service`. In a secured graph it takes a grant."""
CONFIRMER = "confirm"
"""The agent as which a person decides, who may do nothing else."""


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


class ActQuestion(msgspec.Struct, frozen=True):
    """A question for one act, or with an empty id for all that wait."""

    id: Annotated[str, msgspec.Meta(max_length=64)] = ""


class Confirmation(msgspec.Struct, frozen=True):
    """What a person decides."""

    id: Annotated[str, msgspec.Meta(max_length=64)]
    accept: bool
    shown: Annotated[str, msgspec.Meta(max_length=64)]
    """`fingerprint` of what the person was shown: nothing else is carried out."""


def fingerprint(act: ProposedAct) -> str:
    """What identifies an act with its preview, in hexadecimal digits (SHA-256)."""
    return hashlib.sha256(msgspec.msgpack.encode((act.id, act.act, act.preview))).hexdigest()


_questions = msgspec.msgpack.Decoder(ActQuestion)
_decisions = msgspec.msgpack.Decoder(Confirmation)
_acts = msgspec.msgpack.Decoder(list[ProposedAct])


def decode_confirmation(payload: bytes) -> Confirmation:
    """A decision of a message; raises `WireError`."""
    return decoded(payload, "decision", _decisions.decode)


def decode_question(payload: bytes) -> ActQuestion:
    """A question of a message; raises `WireError`."""
    return decoded(payload, "question for acts", _questions.decode)


def encode_question(question: ActQuestion) -> bytes:
    """A question as a message."""
    return msgspec.msgpack.encode(question)


def encode_acts(acts: list[ProposedAct]) -> bytes:
    """What waits, or was decided on, as a message."""
    return msgspec.msgpack.encode(acts)


def encode_confirmation(decision: Confirmation) -> bytes:
    """A decision as a message."""
    return msgspec.msgpack.encode(decision)


def decode_acts(payload: bytes) -> list[ProposedAct]:
    """The acts of an answer; raises `WireError`."""
    return decoded(payload, "acts of an assistant", _acts.decode)
