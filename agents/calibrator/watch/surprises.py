"""Follows surprises: how they are explained, and that nothing has been surprising for a while."""

from __future__ import annotations

from dsr.memory import Memory
from dsr.timeline import EXPLAINED, Chronicle, Entry
from dsr.vocabulary.relations import THINGS

CALM = 2.0
"""s without anything surprising after which nothing is in doubt any more"""


class Surprises:
    """Listens from now on.

    Args:
        memory: says what is surprising.
        chronicle: says what explains it.
    """

    def __init__(self, memory: Memory, chronicle: Chronicle) -> None:
        self._memory = memory
        self._chronicle = chronicle
        self._heard = memory.clock.now()
        self._calm_since: float | None = None

    def explanations(self) -> list[Entry]:
        """Explanations since the last call."""
        entries = self._chronicle.query(type="event", kind=EXPLAINED, since=self._heard)
        found = [entry for entry in entries if entry.begin > self._heard]
        self._heard = max((entry.begin for entry in found), default=self._heard)
        return found

    def are_over(self, now: float) -> bool:
        """Whether nothing has been surprising for a while before `now` (s); to be asked all the time."""
        if any(node.get("surprising") is True for node in self._memory.nodes(THINGS)):
            self._calm_since = None
        elif self._calm_since is None:
            self._calm_since = now
        return self._calm_since is not None and now - self._calm_since >= CALM
