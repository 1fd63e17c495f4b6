"""When a newcomer has joined: it holds all that the graph held before; who lacks that too cannot vouch for it alone.

A replica has joined when

1. it is the first: nobody held the graph when it came, or it was told to begin without the others;
2. or one that has joined, and may speak for others, gave it everything;
3. or all who are there, and all who are known to hold the graph, gave it everything that they have. Who does not
   answer is waited for, for it may have more; of a world or a part only for so long (`debts.py`).

Who has not joined says so, and for whom it waits; it gives what it has only to who insists, because nobody there has
joined. So two newcomers that meet nobody else soon know that they hold all there is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from dsr.crdt.pieces import START, Place

UNJOINED_RETRY = 0.25
"""s between two questions whether one of those has joined meanwhile who had not."""
_SHOWN = 3
"""Replicas that are named in a text."""


class Joining:
    """The knowledge of a newcomer about the other replicas; all times are of the monotonic clock, in s.

    Args:
        rid: of the newcomer.
        trusts: tells who may speak for others.
    """

    def __init__(self, rid: str, trusts: Callable[[str], bool]) -> None:
        self.rid = rid
        self.holders: Sequence[str] = ()
        """Other replicas that are known to hold the graph and to live, whether they can be reached or not."""
        self.others_possible = False
        """Whether there may be others of whom nothing is known: then nobody is known to be the last to ask."""
        self.since = math.inf
        """When it began to ask."""
        self.given_up: frozenset[str] = frozenset()
        """Replica ids of those that are not waited for: only what they have given counts."""
        self.weighs_pieces = False
        """Whether somebody counts how much answers bring (`debts.py`)."""
        self._trusts = trusts
        self._present: dict[str, None] = {}
        self._unjoined: dict[str, Sequence[str]] = {}
        self._exhausted: set[str] = set()
        self._reached: dict[str, Place] = {}
        self._went_on: dict[str, float] = {}
        self._asked_again_at, self._asked_again_last = -math.inf, True

    def appeared(self, rid: str) -> None:
        """A replica announced itself."""
        self._present[rid] = None

    def gone(self, rid: str) -> None:
        """Note that a replica is not there any more."""
        self._present.pop(rid, None)
        self._unjoined.pop(rid, None)
        self._exhausted.discard(rid)
        self._reached.pop(rid, None)
        self._went_on.pop(rid, None)

    def declined(self, rid: str, waits_for: Sequence[str]) -> None:
        """Note that a replica said that it has not joined itself, and for whom it waits."""
        self._unjoined[rid] = waits_for

    def exhausted(self, rid: str) -> None:
        """Note that a replica gave its whole content, though that may not be all there is."""
        self._exhausted.add(rid)

    def went_on(self, rid: str, end: Place | None, share: float) -> bool:
        """Note that a piece came which ends there, and tell whether no answer of that replica had gone so far.

        `share` is how much it brought, as `fetching.brought` tells.
        """
        if rid in self._exhausted or (end is not None and end <= self._reached.get(rid, START)):
            return False
        if end is not None:
            self._reached[rid] = end
        self._went_on[rid] = self._went_on.get(rid, 0.0) + share
        return True

    def take_went_on(self) -> dict[str, float]:
        """How many pieces those have brought, by id, whose answers have gone on since this was called last."""
        taken, self._went_on = self._went_on, {}
        return taken

    def owes(self, rid: str) -> bool:
        """Whether a replica has not given all that it has, nor said that it waits for others that may have more."""
        return rid not in self._exhausted and (rid not in self._unjoined or self.insists)

    def may_have_more(self, rid: str) -> bool:
        """Whether a replica has not given its whole content yet."""
        return rid not in self._exhausted

    @property
    def others(self) -> list[str]:
        """Ids of all replicas that may hold content, and of those that gave theirs."""
        given_up, exhausted = self.given_up, self._exhausted
        return [rid for rid in self.claimants if rid in exhausted or rid not in given_up]

    @property
    def claimants(self) -> list[str]:
        """Ids of all replicas that hold the graph or are there, those included that are not waited for any more."""
        return list(dict.fromkeys([*self.holders, *self._present]))

    @property
    def insists(self) -> bool:
        """Whether to take what those have who have not joined: there is nobody else."""
        return all(rid in self._unjoined or rid in self._exhausted for rid in self.others)

    @property
    def nobody_has_more(self) -> bool:
        """Whether all replicas gave their whole content."""
        return bool(self.others) and all(rid in self._exhausted for rid in self.others)

    def choose(self, queued_at: dict[str, float], now: float) -> str | None:
        """Choose the replica to ask, or None, of those that wait for their turn since then.

        Of those that came at once the oldest is the first, for a younger one may be a newcomer, too.
        """
        settled = self._exhausted if self.insists else self._exhausted | self._unjoined.keys()
        age = {rid: number for number, rid in enumerate(self.others)}
        by_turns = sorted(
            queued_at,
            key=lambda rid: (rid in self.given_up, queued_at[rid], not self._trusts(rid), age.get(rid, len(age)), rid),
        )
        fresh = [rid for rid in by_turns if rid not in settled]
        again = [rid for rid in by_turns if rid in settled]
        is_turn_of_fresh = bool(fresh) and self._asked_again_last  # however rarely this is called
        if again and not is_turn_of_fresh and now - self._asked_again_at >= UNJOINED_RETRY:
            self._asked_again_at, self._asked_again_last = now, True
            return again[0]  # who never answers must not keep us from these
        self._asked_again_last = False
        return fresh[0] if fresh else None

    def waits_for(self) -> list[str]:
        """Replica ids of those who may have more, and of whom nothing has come: not even that they wait themselves."""
        return [rid for rid in self.others if rid not in self._exhausted and rid not in self._unjoined]

    def why(self, now: float) -> str:
        """Explain in words which replicas the newcomer waits for, and for how long at time `now` (s)."""
        waited = max(0.0, now - self.since)
        silent, unjoined = self.waits_for(), [rid for rid in self.others if rid in self._unjoined]
        reasons = [f"{listed(silent)}: no answer"] if silent else []
        if unjoined:
            theirs = dict.fromkeys(rid for other in unjoined for rid in self._unjoined[other] if rid != self.rid)
            reasons.append(f"{listed(unjoined)}: not joined either, waiting for {listed(list(theirs)) or 'others'}")
        return f"waiting for {waited:.1f} s; {'; '.join(reasons) or 'nobody is there'}"


def listed(rids: list[str]) -> str:
    """Name the first of these replicas, and how many more there are."""
    shown = ", ".join(rids[:_SHOWN])
    return f"{shown} and {len(rids) - _SHOWN} more" if len(rids) > _SHOWN else shown
