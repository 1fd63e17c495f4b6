"""When a replica speaks, once a second or more often while the network changes."""

from __future__ import annotations

import math

DIGEST_PERIOD = 1.0
"""s between two digests, and between two times at which stream samples are made durable."""
MOST_HELD = 1.5
"""s that they are late at most because writes are held back: peers listen for twice as long to who says nothing"""
HURRIED_PERIOD = 0.25
"""s between two digests while the network changes: the first ones may be lost on routes that are not complete yet."""
HURRY = 1.0
"""s, duration of the hurry after a peer appeared."""
RENEWAL_DELAY = 0.75
"""s after a peer appeared until what is listened to is declared again: then the network has come to rest."""
ABSENCE = 1.0
"""s without a look at the time: this process was stopped, and knows that it lacks something."""


class Pace:
    """Decides by the time alone; all times are of the monotonic clock, in s."""

    def __init__(self) -> None:
        self._next_digest = -math.inf
        self._next_settling = -math.inf
        self._hurry_until = -math.inf
        self._renewal_at = math.inf
        self._last_look = math.inf

    def look(self, now: float) -> None:
        """Notice a pause of this process; call this often with the monotonic time, s."""
        if now - self._last_look > ABSENCE:
            self.hurry(now)
        if math.isinf(self._next_digest):
            self._next_digest = now
        self._last_look = now

    def hurry(self, now: float) -> None:
        """Somebody appeared: a digest is due now, and several soon."""
        self._hurry_until = now + HURRY
        self._renewal_at = now + RENEWAL_DELAY
        self._next_digest = min(self._next_digest, now)

    def is_overdue(self, now: float) -> bool:
        """Whether a digest must be published, whatever is held back."""
        return now - self._next_digest > MOST_HELD

    def digest_due(self, now: float) -> bool:
        """Whether to publish a digest now; true once."""
        if now < self._next_digest:
            return False
        self._next_digest = now + (HURRIED_PERIOD if now < self._hurry_until else DIGEST_PERIOD)
        return True

    def settling_due(self, now: float) -> bool:
        """Whether to make stream samples durable now; true once."""
        if now < self._next_settling:
            return False
        self._next_settling = now + DIGEST_PERIOD
        return True

    def renewal_due(self, now: float) -> bool:
        """Whether to declare the subscriptions again; true once after each hurry."""
        if now < self._renewal_at:
            return False
        self._renewal_at = math.inf
        return True
