"""A causal context in few bytes: a hash of the whole, and recent changes in full.

The hash of a context is the exclusive or of one hash for each replica id. So to keep it up to date costs as much as
changed, and any part of it can be left out of a comparison. A summary costs the same whatever the history is.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from hashlib import blake2b
from typing import NamedTuple

Ranges = Sequence[tuple[int, int]]
"""First and last counters of one replica, both included, in order, with gaps between."""

LISTED = 32
"""Replica ids that a summary lists: those that changed last. More than that rarely write between two digests."""
LISTED_RANGES = 8
"""Ranges of counters of one replica id that is listed; one with more gaps is in the hash alone."""


def hash_of(rid: str, ranges: Ranges) -> int:
    """64 bits that are the same in every process; 0 for no dots."""
    if not ranges:
        return 0
    numbers = [number for dots in ranges for number in dots]
    text = rid.encode(errors="surrogatepass")
    data = struct.pack(f"<{len(numbers)}Q", *numbers)
    return int.from_bytes(blake2b(data, digest_size=8, key=blake2b(text, digest_size=32).digest()).digest(), "little")


class Hashes:
    """The hash of each replica's dots, in the order in which they changed, and that of all."""

    __slots__ = ("all", "by_rid")

    def __init__(self) -> None:
        self.by_rid: dict[str, int] = {}
        self.all = 0

    def put(self, rid: str, ranges: Ranges) -> None:
        """These are the dots of a replica now; it changed last."""
        new = hash_of(rid, ranges)
        self.all ^= self.by_rid.pop(rid, 0) ^ new
        self.by_rid[rid] = new


class Summary(NamedTuple):
    """A short description of a causal context, as a digest carries it."""

    recent: tuple[tuple[str, tuple[tuple[int, int], ...]], ...]
    """Replica ids that changed last, and all their ranges of counters."""
    hash: int
    """Hash of the whole context."""

    @staticmethod
    def of(hashes: Hashes, ranges_of: Callable[[str], Ranges], first: str | None) -> Summary:
        """List `first`, if there is anything of it, and those that changed last."""
        chosen = [first] if first in hashes.by_rid else []
        for rid in reversed(hashes.by_rid):
            if len(chosen) >= LISTED:
                break
            if rid != first and len(ranges_of(rid)) <= LISTED_RANGES:
                chosen.append(rid)
        return Summary(tuple((rid, tuple(ranges_of(rid))) for rid in chosen if rid is not None), hashes.all)

    def last(self, rid: str) -> int | None:
        """The highest counter that is listed of a replica; None if it is not listed."""
        return next((ranges[-1][1] for listed, ranges in self.recent if listed == rid and ranges), None)
