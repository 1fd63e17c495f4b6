"""Brings the open situations on the timeline into step with what holds."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Mapping

from agents.chronicler.facts import Fact
from dsr.memory import Memory
from dsr.timeline import SITUATION, Chronicle, Entry, is_keyed

_LAG = 1.0
"""s; what this process never saw hold may be on its way: another writer told it, who heard of it earlier"""


class Keeper:
    """Begins what holds and is not open, and ends what is open and does not hold.

    It goes by what it finds on the timeline, not by what it did: so it goes on after a restart, and several of them
    write the same. Situations that were begun twice with different keys are one: the earliest stays.

    Args:
        memory: the graph.
        chronicle: where to write.
        kinds: of the situations to keep; it looks at those only that have a key.
        ending: tells when (s) and how one ended.
    """

    def __init__(
        self,
        memory: Memory,
        chronicle: Chronicle,
        kinds: Collection[str],
        ending: Callable[[Entry, float], tuple[float, str]],
        lag: float = _LAG,
    ) -> None:
        self._memory = memory
        self._chronicle = chronicle
        self._kinds = frozenset(kinds)
        self._ending = ending
        self._lag = lag
        self._known: set[str] = set()
        self._missed: dict[str, float] = {}

    def update(self, facts: Iterable[Fact], now: float) -> None:
        """Make the open situations those of `facts` at time `now` (s)."""
        open_ones = self._open()
        known = set()
        for fact in facts:
            found = open_ones.pop((fact.kind, fact.participants), [])
            known.add(self._continued(fact, found))
        left = [entry for entries in open_ones.values() for entry in entries]
        self._end(left, known, now)
        self._known = known

    def _open(self) -> dict[tuple[str, tuple[str, ...]], list[Entry]]:
        found: dict[tuple[str, tuple[str, ...]], list[Entry]] = defaultdict(list)
        for entry in self._chronicle.query(type=SITUATION, kind=self._kinds, open=True):
            if is_keyed(entry.name):
                found[entry.kind, entry.participants].append(entry)
        return found

    def _continued(self, fact: Fact, found: list[Entry]) -> str:
        """The name of the situation that a fact is, begun if it is new; `found` are the open ones that it may be."""
        if fact.is_dated:
            same = [entry for entry in found if entry.begin == fact.begin]
            for entry in found:
                if entry not in same:
                    self._chronicle.end(entry.name, max(entry.begin, fact.begin))
        else:
            same = found
            for double in found[1:]:
                self._memory.remove_node(double.name)
        if same:
            return same[0].name
        name = self._chronicle.begin(
            fact.kind, fact.participants, fact.begin, text=fact.text, source=fact.source, key=fact.key
        )
        self._chronicle.resume(name)
        return name

    def _end(self, left: list[Entry], known: Collection[str], now: float) -> None:
        """End what does not hold: at once if it was known to, else if it still does not after a while."""
        missed: dict[str, float] = {}
        for entry in left:
            since = missed[entry.name] = self._missed.get(entry.name, now)
            if entry.name in self._known or now - since >= self._lag:
                time, outcome = self._ending(entry, since)
                self._chronicle.end(entry.name, max(time, entry.begin), outcome=outcome)
        self._missed = missed


def newest_status(entries: Iterable[Entry]) -> Mapping[str, str]:
    """The status that was told last of each intention or action, by name."""
    return {entry.participants[0]: str(entry.details.get("status", "")) for entry in entries if entry.participants}
