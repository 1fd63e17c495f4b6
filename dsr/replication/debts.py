"""For how long a process is waited for that may hold a world or a part: who is there and gives nothing, only so long.

Silence proves nothing of who is stopped or cut off: only words do, for who can speak can answer. So what counts is the
time between two digests of a process that was asked, and owes its answer or its content. A piece of that takes off
as much as it may take to come, and one that brings little takes off little: so nobody is waited for who gives one thing
after the other. Whoever comes long after all were asked need not be waited for: it hears that the place is held here
before it begins.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from dsr.clock import Clock
from dsr.replication.inquiry import REQUEST_TIMEOUT
from dsr.replication.peers import FORGET, MAX_PEERS, SILENCE


@dataclass
class _Account:
    opened_at: float
    counted_at: float
    owed: dict[str, float] = field(default_factory=dict)
    """s, by process."""
    since: dict[str, float] = field(default_factory=dict)
    """Of those that owe something, from when on their words count."""


class Debts:
    """Counts, for each place, the time in which each process owed what it may hold; one thread at a time."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._accounts: dict[str, _Account] = {}

    def open(self, place: str) -> None:
        """Others are asked for a place from now on; if they were lately, the count goes on, for patience was short."""
        now = self._clock.monotonic()
        self._accounts = {name: each for name, each in self._accounts.items() if now - each.counted_at <= FORGET}
        self._accounts.setdefault(place, _Account(now, now)).since.clear()

    def close(self, place: str) -> None:
        """It is not known yet who is there: what was counted does not count."""
        if place in self._accounts:
            self._accounts[place] = _Account(now := self._clock.monotonic(), now)

    def forget(self, place: str) -> None:
        """The question is answered: whoever is asked for the place again is waited for anew."""
        self._accounts.pop(place, None)

    def waits_for(self, place: str, process: str) -> bool:
        """Whether a process has not owed for too long, nor come too late."""
        account = self._accounts.get(place)
        if account is None:
            return True
        if process in account.owed:
            return account.owed[process] <= FORGET
        return self._clock.monotonic() - account.opened_at <= FORGET

    def count(
        self, place: str, there: Iterable[str], owing: Mapping[str, float], gave: Mapping[str, float]
    ) -> list[str]:
        """Count the words that were heard since this was called last; returns those that are given up now.

        Args:
            place: which others are asked for.
            there: all processes that may be waited for.
            owing: of those that were asked, and have not given all they may hold, when they were heard last.
            gave: how many pieces of answers came since the last call: each takes off the time that one may take.
        """
        account, now = self._accounts.get(place), self._clock.monotonic()
        if account is None:
            return []
        account.counted_at = now
        if now - account.opened_at <= FORGET:
            for process in there:
                if len(account.owed) < MAX_PEERS:
                    account.owed.setdefault(process, 0.0)
        account.since = {process: account.since.get(process, now) for process in owing}
        for process in account.owed.keys() & gave.keys():
            account.owed[process] = max(0.0, account.owed[process] - REQUEST_TIMEOUT * gave[process])
        return [process for process, heard_at in owing.items() if _add(account, process, heard_at)]


def _add(account: _Account, process: str, heard_at: float) -> bool:
    """Add what a word proves to what a process has owed; whether that is too much from now on."""
    owed, gap = account.owed.get(process), heard_at - account.since[process]
    if owed is None or gap <= 0.0:
        return False
    account.since[process] = heard_at
    account.owed[process] = owed + min(gap, SILENCE)
    return owed <= FORGET < account.owed[process]
