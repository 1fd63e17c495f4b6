"""Complaints of a replica about its peers: each once, and not about any number of made-up peers."""

from __future__ import annotations

import logging
from collections import Counter

from dsr.errors import WireError
from dsr.replication.peers import MAX_PEERS

_log = logging.getLogger("dsr.replication.sync")


class Complaints:
    """Counts malformed messages, and logs them."""

    def __init__(self) -> None:
        self.dropped: Counter[str] = Counter()
        """Malformed messages, by sender."""
        self._said: set[tuple[str, str]] = set()

    def drop(self, sender: str, error: WireError) -> None:
        """A message of this sender is dropped."""
        if sender not in self.dropped and len(self.dropped) >= MAX_PEERS:
            sender = "others"
        self.dropped[sender] += 1
        self.say(sender, "dropped a message from %s: %s (further ones are only counted)", error)

    def say(self, rid: str, text: str, *details: object, level: int = logging.WARNING) -> None:
        """Log something about a replica, but only once."""
        if (rid, text) not in self._said and len(self._said) < MAX_PEERS:
            self._said.add((rid, text))
            _log.log(level, text, rid, *details)
