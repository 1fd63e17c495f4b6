"""How a replica notices that somebody else speaks in its name, and when it takes another id for that."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable

from dsr.crdt.context import Dot
from dsr.crdt.delta import Add, Delta
from dsr.errors import WireError
from dsr.graph.graph import Graph
from dsr.replication.claims import MAX_EARLY, goes_beyond
from dsr.replication.complaints import Complaints

NEW_ID_PAUSE = 10.0
"""s between two new ids of a replica: each stays in all contexts, and whoever speaks in its name may go on doing so."""


class Impersonation:
    """Watches over messages that speak in the name of this replica."""

    def __init__(self, graph: Graph, complaints: Complaints) -> None:
        self.noticed = False
        """Whether peers may believe somebody else who spoke in our name, and no other id was taken since."""
        self.forged: dict[Dot, None] = {}
        """Creation dots under which somebody else added something in our name."""
        self.renewed: dict[Dot, Dot] = {}
        """What the last change of the id made anew: each creation dot and the one that came for it."""
        self._graph = graph
        self._complaints = complaints
        self._new_id_at = -math.inf

    def check(self, sender: str, delta: Delta, confirmed: Callable[[], int], *, believed: bool) -> None:
        """Raise `WireError` if it speaks in our name; and if peers may have believed that, take note.

        Args:
            sender: who sent it.
            delta: a delta, or a reply with all that it tells to have been seen.
            confirmed: tells the counter up to which all peers have seen what is ours.
            believed: whether peers may believe of `sender` what it says of others.
        """
        rid, is_reply = self._graph.rid, delta.live is not None
        if sender != rid and not is_reply and not delta.removed:
            return
        known = confirmed() if sender == rid else self._graph.counter  # others may have had it before what is ours
        beyond = goes_beyond(rid, known, delta, removals_only=sender != rid and not is_reply)
        if beyond and (believed or sender == rid):
            self.notice(sender)
            added = [add for add in delta.adds if add.dot[0] == rid and add.dot[1] > known]
            false = [add.dot for add in added if not self._is_true(add)]
            self.forged.update(dict.fromkeys(false[: MAX_EARLY - len(self.forged)]))
        if beyond or sender == rid:
            raise WireError(f"it speaks in the name of {rid}, this replica")

    def notice(self, sender: str) -> None:
        """Note that a peer claims to have seen more of this replica than it has written."""
        self.noticed = True
        self._complaints.say(
            self._graph.rid, "somebody speaks in the name of %s (told by %s): taking another id", sender,
            level=logging.ERROR,
        )  # fmt: skip

    def is_new_id_due(self, now: float) -> bool:
        """Whether to take another id at monotonic time `now` (s); if so it counts as taken."""
        if not self.noticed or now - self._new_id_at < NEW_ID_PAUSE:
            return False
        self.noticed, self._new_id_at = False, now
        return True

    def _is_true(self, add: Add) -> bool:
        """Whether this replica did add that: then it is only said again."""
        ours = self._graph.store.element(add.dot)
        return ours is not None and all(
            getattr(ours, name) == getattr(add, name) for name in ("key", "type", "sources", "destinations")
        )
