"""Messages between replicas about meshes: who has one, and pieces of its bytes."""

from __future__ import annotations

import msgspec

from dsr.errors import WireError
from dsr.geometry.mesh import MOST_BYTES, is_hash
from dsr.geometry.shared import SharedPlace
from dsr.network.decoding import decoded

MOST_ASKED = 1 << 20
"""Bytes of one piece."""


class AskForMesh(msgspec.Struct, frozen=True, array_like=True):
    """Whether the one asked has a mesh (answered by an `Offer`), or a piece of it (answered by just those bytes)."""

    hash: str
    offset: int = 0
    length: int = 0
    """Bytes of the piece; 0 asks whether it is there."""
    keep: bool = False
    """Get it yourself if you have it not: the asker is about to leave."""


class Offer(msgspec.Struct, frozen=True, array_like=True):
    """An offer of a mesh by a process that has it."""

    size: int
    """Number of the mesh's canonical bytes; 0 if the mesh is not here yet."""
    place: SharedPlace | None = None
    """Shared memory in which processes of the same machine can read the mesh; None if there is none."""


_encoder = msgspec.msgpack.Encoder()
_asks = msgspec.msgpack.Decoder(AskForMesh)
_offers = msgspec.msgpack.Decoder(Offer)


def encode_ask(ask: AskForMesh) -> bytes:
    """Encode a request for a mesh; `decode_ask` reads it."""
    return _encoder.encode(ask)


def encode_offer(offer: Offer) -> bytes:
    """Encode an offer of a mesh; `decode_offer` reads it."""
    return _encoder.encode(offer)


def decode_ask(payload: bytes) -> AskForMesh:
    """Raises `WireError` also for a hash that is none, or a piece that nobody may ask for."""
    ask = decoded(payload, "request for a mesh", _asks.decode)
    if not is_hash(ask.hash) or not (0 <= ask.length <= MOST_ASKED and 0 <= ask.offset < MOST_BYTES):
        raise WireError(f"request for bytes {ask.offset} to {ask.offset + ask.length} of mesh {ask.hash[:64]!r}")
    return ask


def decode_offer(payload: bytes) -> Offer:
    """Raises `WireError` also for a size that no mesh has, or that its place has not."""
    offer = decoded(payload, "offer of a mesh", _offers.decode)
    if not 0 <= offer.size <= MOST_BYTES:
        raise WireError(f"offer of a mesh of {offer.size} bytes; at most {MOST_BYTES}")
    if offer.place is not None and offer.place.length != offer.size:
        raise WireError(f"offer of a mesh of {offer.size} bytes in a place of {offer.place.length}")
    return offer
