"""A causal context in few bytes: a hash of the whole, and recent changes in full.

The hash of a context is the exclusive or of one hash for each replica id. So to keep it up to date costs as much as
changed, and any part of it can be left out of a comparison. A summary costs the same whatever the history is.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from hashlib import blake2b
from typing import NamedTuple

Ranges = Sequence[tuple[int, int]]
"""First and last counters of one replica, both included, in order, with gaps between."""
Listed = tuple[str, tuple[tuple[int, int], ...]]
"""A replica id and all its ranges of counters."""

LISTED = 32
"""Replica ids that a summary lists: those that changed last. More than that rarely write between two digests."""
LISTED_RANGES = 8
"""Ranges of counters of one replica id that is listed; one with more gaps is in the hash alone."""

_NOTHING: tuple[int, Listed] = (0, ("", ()))


def hash_of(rid: str, ranges: Ranges) -> int:
    """64 bits that are the same in every process; 0 for no dots."""
    if not ranges:
        return 0
    numbers = [number for dots in ranges for number in dots]
    text = rid.encode(errors="surrogatepass")
    data = struct.pack(f"<{len(numbers)}Q", *numbers)
    return int.from_bytes(blake2b(data, digest_size=8, key=blake2b(text, digest_size=32).digest()).digest(), "little")


class Hashes:
    """The dots of each replica and their hash, in the order in which they changed, and the hash of all."""

    __slots__ = ("all", "by_rid")

    def __init__(self) -> None:
        self.by_rid: dict[str, tuple[int, Listed]] = {}
        self.all = 0

    def put(self, rid: str, ranges: Ranges) -> None:
        """These are the dots of a replica now; it changed last."""
        new = hash_of(rid, ranges)
        self.all ^= self.by_rid.pop(rid, _NOTHING)[0] ^ new
        self.by_rid[rid] = new, (rid, tuple(ranges))


class Summary(NamedTuple):
    """A short description of a causal context, as a digest carries it."""

    recent: tuple[Listed, ...]
    """Those that changed last."""
    hash: int
    """Hash of the whole context."""

    @staticmethod
    def of(hashes: Hashes, first: str | None) -> Summary:
        """List `first`, if there is anything of it, and those that changed last."""
        chosen = [hashes.by_rid[first][1]] if first in hashes.by_rid else []
        for rid, (_, listed) in reversed(hashes.by_rid.items()):
            if len(chosen) >= LISTED:
                break
            if rid != first and len(listed[1]) <= LISTED_RANGES:
                chosen.append(listed)
        return Summary(tuple(chosen), hashes.all)

    def last(self, rid: str) -> int | None:
        """The highest counter that is listed of a replica; None if it is not listed."""
        return next((ranges[-1][1] for listed, ranges in self.recent if listed == rid and ranges), None)
