"""Requests of a synchroniser to its owner: it does no I/O itself."""

from __future__ import annotations

from typing import NamedTuple

from dsr.crdt.delta import Delta


class PublishDigest(NamedTuple):
    """Tell all peers the digest of this replica, unless it has another id meanwhile."""

    rid: str
    payload: bytes


class PublishDelta(NamedTuple):
    """Send a delta to all peers."""

    delta: Delta


class Ask(NamedTuple):
    """Request a piece of the missing changes; hand in the answer with `receive_reply`, then call `request_done`."""

    peer: str
    payload: bytes
    number: int
    """Unlike that of any other request."""


class Renew(NamedTuple):
    """Declare the subscriptions to the network again: it has changed, and may have forgotten them."""


class TakeId(NamedTuple):
    """Go on under another replica id: somebody else speaks in the name of this one."""


Output = PublishDigest | PublishDelta | Ask | Renew | TakeId
