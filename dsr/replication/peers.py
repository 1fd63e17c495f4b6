"""The replicas that can be reached: who announced itself, who is heard, who left; bounded, whoever claims what.

A liveliness token is a claim that anybody can make where nothing ties keys to certificates. So what counts is that a
replica speaks, once a second: a token without digests is forgotten, and a withdrawn one of a replica that still answers
counts for nothing. For one that is gone nobody answers, so that is known at once. A digest does not bring the token
back: it may have been under way when the token went. Who goes on speaking is listened to all the same.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

from dsr.network.keys import agent_of
from dsr.replication.pace import DIGEST_PERIOD, MOST_HELD
from dsr.replication.wire import Digest

MAX_PEERS = 1000
"""Replicas that are listened to, and senders told apart when they err: made-up names must take no memory."""
MAX_OF_AGENT = 100
"""Replicas of one agent's name that are listened to: processes that run at once, so a fraction of `MAX_PEERS`."""
SILENCE = 5.0
"""s after which a peer's last digest counts no more, and a token of which no digest came counts for nothing."""
FORGET = 30.0
"""s after which a silent peer counts as gone; its next digest brings it back."""
DEPARTURE = DIGEST_PERIOD + MOST_HELD + 0.5
"""s without a word of a peer whose token was withdrawn until it counts as gone; more than digests are apart."""
FIRST_PATIENCE = 0.5
"""s for which an answer of a peer is waited for until another one is asked; doubles with each that does not come in
time. Each peer has its own: else those that answer at once would leave none for one that is slow."""
LAST_PATIENCE = 8.0
"""s; also for one who has begun to answer: with all else busy, the next piece takes its time."""
FIRST_PAUSE, LAST_PAUSE = 0.5, 32.0
"""s until a peer is asked again whose answer changed nothing; each such answer doubles it, up to the last."""


@dataclass
class Peer:
    """The knowledge about another replica; times are on the monotonic clock (s)."""

    appeared_at: float
    digest: Digest | None = None
    covered: Digest | None = None
    """The last digest of the peer without anything that is unknown here."""
    rest_known: bool = False
    """Whether, when its digest came, there was no difference beyond what that lists."""
    heard_at: float = -math.inf
    told_at: float = -math.inf
    """When the first of its digests came that told of something which has been missing here since."""
    ahead: bool = False
    """Whether the peer's physical clock was more than MAX_DRIFT in our future."""
    queued_at: float = -math.inf
    """Since when it has waited for its turn to be asked: when it came, or its last turn ended."""
    asked: int = 0
    """Number of requests to the peer."""
    asked_at: float = -math.inf
    patience: float = FIRST_PATIENCE
    """How long the peer's answer is waited for now, s."""
    in_vain: int = 0
    """Number of the peer's answers that changed nothing, one after the other."""
    acknowledged: int = 0
    """The highest counter of ours that the peer said to have seen."""
    withdrawn_at: float | None = None
    """Time (s) when the peer's token went, if it has not answered since; None otherwise."""

    @property
    def is_leaving(self) -> bool:
        """Whether the peer's token went, and the peer was not asked since whether it is still there."""
        return self.withdrawn_at is not None and self.asked_at <= self.withdrawn_at

    @property
    def pause(self) -> float:
        """Time that must pass between two requests to it, s."""
        return min(FIRST_PAUSE * 2.0 ** min(self.in_vain - 1, 10), LAST_PAUSE) if self.in_vain else 0.0

    def is_due(self, now: float) -> bool:
        """Whether it was not asked since its last digest, nor too soon after an answer that changed nothing."""
        return self.asked_at < self.heard_at and now - self.asked_at >= self.pause

    def is_gone(self, now: float) -> bool:
        """Whether the peer counts as gone: nothing is expected of it any more."""
        if self.withdrawn_at is not None and now - max(self.withdrawn_at, self.heard_at) > DEPARTURE:
            return True
        if self.digest is None:
            return now - self.appeared_at > SILENCE
        return now - self.heard_at > FORGET


class Peers(dict[str, Peer]):
    """Peers by replica id."""

    def __init__(self) -> None:
        super().__init__()
        self.refused = 0
        """Replicas that were not listened to because there were too many."""
        self.away: dict[str, int] = {}
        """What those that were heard and are gone had acknowledged: they may be cut off, and come back."""
        self._unnamed: list[int] = []  # at most one number: the least that any had acknowledged who has no room there
        self._of_agent: Counter[str] = Counter()

    @property
    def confirmed(self) -> int:
        """The counter up to which all that were ever heard have told to have seen what was written here."""
        heard = [peer.acknowledged for peer in self.values() if peer.digest]
        return min([*heard, *self.away.values(), *self._unnamed], default=0)

    def confirm_nothing(self) -> None:
        """We have another id now, under which nobody has seen anything."""
        for peer in self.values():
            peer.acknowledged, peer.covered = 0, None
        self.away = dict.fromkeys(self.away, 0)
        self._unnamed = [0 for _ in self._unnamed]

    def __delitem__(self, rid: str) -> None:
        peer = self[rid]
        super().__delitem__(rid)
        if peer.digest:
            self._note_away(rid, peer.acknowledged)
        agent = agent_of(rid)
        self._of_agent[agent] -= 1
        if not self._of_agent[agent]:
            del self._of_agent[agent]

    def appeared(self, rid: str, now: float) -> bool:
        """Note that a token of replica `rid` came at time `now` (s), and tell whether the replica is listened to."""
        if rid in self:
            self[rid].withdrawn_at = None
            return True
        return self._take_in(rid, now)

    def heard(self, rid: str, digest: Digest, now: float) -> Peer | None:
        """Note that replica `rid` spoke, and return it; None if it is not listened to.

        It takes the place of a token of which nothing was heard.
        """
        if rid not in self and not self._take_in(rid, now):
            silent = self._silent(agent_of(rid))
            if silent is None:
                return None
            del self[silent]
            self._take_in(rid, now)
        peer = self[rid]
        peer.digest, peer.heard_at = digest, now
        peer.acknowledged = max(peer.acknowledged, self.away.pop(rid, 0))
        return peer

    def withdrawn(self, rid: str, now: float) -> None:
        """Note that a replica's token went: the replica is forgotten unless it goes on speaking."""
        peer = self.get(rid)
        if peer is not None and (peer.digest is None or now - peer.heard_at > SILENCE):
            del self[rid]
        elif peer is not None:
            peer.withdrawn_at = now

    def unanswered(self, rid: str) -> None:
        """No answer came, and none will: it is gone if its token is."""
        if rid in self and self[rid].withdrawn_at is not None:
            del self[rid]

    def answered(self, rid: str) -> None:
        """An answer came in time; if it took long, so may the next."""
        if rid in self:
            self[rid].patience = max(FIRST_PATIENCE, self[rid].patience / 2)

    def gave(self, rid: str, *, useful: bool) -> None:
        """Note that an answer has ended, and whether it changed anything: who gives none is asked ever more rarely."""
        if rid in self:
            self[rid].in_vain = 0 if useful else self[rid].in_vain + 1

    def came_late(self, rid: str) -> None:
        """Note that no answer came in time: it may be long, so wait longer next time."""
        if rid in self:
            self[rid].patience = min(2 * self[rid].patience, LAST_PATIENCE)

    def forget_gone(self, now: float) -> Iterator[str]:
        """Drop those of whom nothing is to be expected any more, and name them."""
        for rid in [rid for rid, peer in self.items() if peer.is_gone(now)]:
            del self[rid]
            yield rid

    def _note_away(self, rid: str, acknowledged: int) -> None:
        """Of too many, the first is named no more, so that nobody who speaks in its name can have it forgotten."""
        if len(self.away) >= MAX_PEERS:
            self._unnamed = [min([self.away.pop(next(iter(self.away))), *self._unnamed])]
        self.away[rid] = acknowledged

    def _take_in(self, rid: str, now: float) -> bool:
        agent = agent_of(rid)
        if len(self) >= MAX_PEERS or self._of_agent[agent] >= MAX_OF_AGENT:
            self.refused += 1
            return False
        self._of_agent[agent] += 1
        self[rid] = Peer(now, queued_at=now)
        return True

    def _silent(self, agent: str) -> str | None:
        """A token of which nothing was heard, of this agent if there are too many of it."""
        crowded = self._of_agent[agent] >= MAX_OF_AGENT
        found = (rid for rid, peer in self.items() if peer.digest is None and (not crowded or agent_of(rid) == agent))
        return next(found, None)
