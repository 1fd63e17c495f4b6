"""Who holds a world or a part that a process begins to hold: each other process is asked, and silence proves nothing.

Whoever begins to hold something says so to all who ask from then on, and only then asks itself. So of two that begin at
once at least one hears of the other. A process that is slow, or stopped, is waited for as long as its base replica
counts as there. One that speaks, and owes its answer or its content all the same, is given up (`debts.py`).
"""

from __future__ import annotations

import logging
import math
import threading
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from typing import Annotated

import msgspec

from dsr.clock import Clock
from dsr.errors import TransportError, WireError
from dsr.network.decoding import decoded
from dsr.network.keys import Keys, agent_of
from dsr.network.transport import Transport
from dsr.replication.debts import Debts
from dsr.replication.inquiry import REQUEST_TIMEOUT
from dsr.replication.joining import listed
from dsr.replication.peers import FORGET, MAX_PEERS
from dsr.replication.replica import Replica
from dsr.replication.wire import Name

HOLDER_PATIENCE = 1.0
"""s to wait for a sign of processes of which nothing is known: those behind routers, which are not registered here."""
FIRST_PAUSE, LAST_PAUSE = 0.5, 8.0
"""s until all are asked again, for a message may be lost; each pause is twice as long as the one before."""
MAX_PLACES = 1024
"""Worlds and parts that one question is about."""
VERSION = 1
_ROUNDS = 3
"""Exchanges that it takes where nothing moves by itself: who is there, request and reply, merge."""

_log = logging.getLogger("dsr.replication.holders")

_Place = Annotated[str, msgspec.Meta(max_length=256)]


class HolderQuery(msgspec.Struct, array_like=True, frozen=True):
    """Asks under which replica ids a process holds worlds and parts."""

    version: int
    places: Annotated[list[_Place], msgspec.Meta(max_length=MAX_PLACES)]
    """Each as `Keys.place` names it."""


class HoldersAnswer(msgspec.Struct, array_like=True, frozen=True):
    """Tells what one process holds."""

    version: int
    replica: Name
    """Id of its replica of the base."""
    held: Annotated[list[_Place], msgspec.Meta(max_length=MAX_PLACES)]
    """For each place that was asked for the id of its replica there; empty if it does not hold that."""


_encoder = msgspec.msgpack.Encoder()
_queries = msgspec.msgpack.Decoder(HolderQuery)
_answers = msgspec.msgpack.Decoder(HoldersAnswer)


def decode_query(payload: bytes) -> HolderQuery:
    """The question in `payload`. Raises `WireError` unless all of it is valid."""
    question = decoded(payload, "question who holds what", _queries.decode)
    if question.version != VERSION:
        raise WireError(f"question who holds what: version {question.version}, this is version {VERSION}")
    return question


def decode_answer(payload: bytes) -> HoldersAnswer:
    """The answer in `payload`. Raises `WireError` unless all of it is valid."""
    answer = decoded(payload, "answer who holds what", _answers.decode)
    if answer.version != VERSION:
        raise WireError(f"answer who holds what: version {answer.version}, this is version {VERSION}")
    return answer


class Holders:
    """Answers who holds what here, and asks all other processes of a graph.

    Args:
        base: the replica of the base; whoever is known there is asked.
        transport: the network.
        clock: for asking again.
        keys: of the base.
        rid: the replica id with which the process began.
        others: ids of the replicas of the base that live on this machine, whether they can be reached or not.
        held: tells what is held here: the ids of its replicas, by place.
    """

    def __init__(
        self, base: Replica, transport: Transport, clock: Clock, keys: Keys, rid: str,
        others: Callable[[], Iterable[str]], held: Callable[[], Mapping[str, str]],
    ) -> None:  # fmt: skip
        self._base, self._transport, self._clock, self._keys = base, transport, clock, keys
        self._others, self._held = others, held
        self._lock = threading.Lock()
        self._wanted: dict[str, float] = {}
        """Places that are asked for, each since when."""
        self._answers: dict[str, dict[str, str]] = {}
        """By place, what each process said last."""
        self._debts = Debts(clock)
        self._listed: frozenset[str] = frozenset()
        self._asked: set[str] = set()
        """Ids, in the base, of the processes that were there when all were asked last."""
        self._due, self._pause = math.inf, FIRST_PAUSE
        self.malformed = 0
        """Messages that made no sense."""
        self._serving = transport.serve(keys.holders(rid), self._answer)

    def ask(self, place: str) -> None:
        """Ask who holds a place that is held here from now on, until `settle`."""
        with self._lock:
            self._wanted.setdefault(place, self._clock.monotonic())
            self._answers.setdefault(place, {})
            self._debts.open(place)
            self._due, self._pause = -math.inf, FIRST_PAUSE

    def settle(self, place: str, *, answered: bool) -> None:
        """Ask no more for a place. What others owe goes on counting if the question is not `answered`."""
        with self._lock:
            if answered:
                self._debts.forget(place)
            self._wanted.pop(place, None)
            self._answers.pop(place, None)

    def look(self) -> None:
        """Ask what is to be asked now; call this often."""
        now = self._clock.monotonic()
        with self._lock:
            if not self._wanted or now < self._due:
                return
            self._due, self._pause = now + self._pause, min(2.0 * self._pause, LAST_PAUSE)
            places = list(self._wanted)
        self._listed = frozenset(self._others())
        self._asked = self._known()
        for first in range(0, len(places), MAX_PLACES):
            self._send(places[first : first + MAX_PLACES])

    def _send(self, places: list[str]) -> None:
        payload = _encoder.encode(HolderQuery(VERSION, places))
        try:
            self._transport.request(
                self._keys.holders(), payload, lambda key, reply: self._take(places, key, reply), _nothing,
                REQUEST_TIMEOUT,
            )  # fmt: skip
        except TransportError:  # the network was left
            return

    def _take(self, places: list[str], key: str, payload: bytes) -> None:
        try:
            answer = decode_answer(payload)
            agents = {agent_of(rid) for rid in (answer.replica, *answer.held) if rid}
            if len(answer.held) != len(places) or agents != {agent_of(key.rsplit("/", 1)[-1])}:
                raise WireError("an answer to another question, or in the name of another agent")
        except WireError:
            self.malformed += 1
            return
        with self._lock:
            for place, rid in zip(places, answer.held, strict=True):
                answers = self._answers.get(place)
                if answers is not None and (answer.replica in answers or len(answers) < MAX_PEERS):
                    answers[answer.replica] = rid

    def _answer(self, key: str, payload: bytes) -> bytes | None:
        try:
            question = decode_query(payload)
        except WireError:
            self.malformed += 1
            return None
        held = self._held()
        rids = [held.get(place, "") for place in question.places]
        return _encoder.encode(HoldersAnswer(VERSION, self._base.graph.rid, rids))

    def of(self, place: str) -> list[str]:
        """Replica ids of those that hold a place, as far as they have answered and are there."""
        known = self._known()
        return [rid for process, rid in self._told(place).items() if rid and process in known]

    def _silent(self, place: str) -> list[str]:
        """Replica ids, in the base, of those that have not told yet whether they hold a place, and are waited for."""
        told, known = self._told(place), self._known()
        with self._lock:
            return sorted(rid for rid in known if rid not in told and self._debts.waits_for(place, rid))

    def _count(self, replica: Replica, place: str) -> None:
        """Wait no more for those that have owed for too long what they may hold; see `debts.py`."""
        base, sync, told, known = self._base.synchroniser, replica.synchroniser, self._told(place), self._known()
        processes = {rid: process for process, rid in told.items() if rid}
        claimants = {rid: processes.get(rid, rid) for rid in sync.joining.claimants}
        owing = {process: base.heard_at(process) for process in self._asked & known if process not in told}
        for rid, process in claimants.items():
            if sync.joining.owes(rid) and sync.was_asked(rid) and not sync.inquiry.keeps_waiting(rid):
                owing[process] = max(sync.heard_at(rid), base.heard_at(process))
        gave: dict[str, float] = defaultdict(float)
        for rid, pieces in sync.joining.take_went_on().items():
            gave[claimants.get(rid, rid)] += pieces
        with self._lock:
            if not base.joined:  # others may be there of whom nothing is known yet
                self._debts.close(place)
            given_up = self._debts.count(place, {*known, *claimants.values()}, owing, gave)
            waited_for = {rid for rid, process in claimants.items() if self._debts.waits_for(place, process)}
        if given_up:
            _log.warning("%s: not waiting any more for %s: there for %.0f s, without what it may hold of it", place,
                         listed(sorted(given_up)), FORGET)  # fmt: skip
        sync.joining.given_up = frozenset(claimants.keys() - waited_for)

    def _may_be_others(self, place: str) -> bool:
        """Whether somebody may hold a place of whom nothing is known yet."""
        sync = self._base.synchroniser
        since = self._wanted.get(place, self._clock.monotonic())
        waits = sync.joining.others_possible and self._clock.monotonic() - since < HOLDER_PATIENCE
        return not sync.joined or waits or bool(self._silent(place))

    def gathered(self, replica: Replica, place: str, move: Callable[[], None] | None, timeout: float) -> bool:
        """Whether all content of a place that is held from now on is here, or comes by further polls.

        Args:
            replica: that of the place, which has just begun.
            place: see `Keys.place`.
            move: lets messages arrive and be merged; None if threads do.
            timeout: s without an answer or anything of the content, after which nothing more is waited for.
        """
        sync, came = replica.synchroniser, -1

        def done() -> bool:
            self.look()
            return self.note(replica, place)

        while came < (progress := sync.pieces + len(self._told(place))):
            came = progress
            if move is None:
                if replica.wait_until(done, timeout):
                    break
                continue
            for _ in range(_ROUNDS):
                done()
                move()
        done()
        if sync.joined or (sync.peers and move is not None):
            return True
        if sync.joining.nobody_has_more:  # whoever holds it gave all, though nobody there may speak for others
            sync.nobody_there()
            return True
        return False

    def note(self, replica: Replica, place: str) -> bool:
        """Tell the replica of a place what is known of others; whether it has joined, or nobody else holds it."""
        sync = replica.synchroniser
        sync.joining.holders, sync.joining.weighs_pieces = self.of(place), True
        self._count(replica, place)
        sync.joining.others_possible = self._may_be_others(place)
        return sync.joined or self.nobody_holds(replica, place)

    def nobody_holds(self, replica: Replica, place: str) -> bool:
        """Whether all others that are there have told that they do not hold a place."""
        return not self._may_be_others(place) and not replica.synchroniser.joining.others

    def trouble(self, replica: Replica, place: str) -> str:
        """Why it is not known what others hold of a place; empty if nobody may hold anything of it."""
        speaking = {*self._base.synchroniser.heard, *self._listed}
        silent = [rid for rid in self._silent(place) if rid in speaking]
        if silent:
            return f"{listed(silent)}: no word whether they hold it"
        joining = replica.synchroniser.joining
        return "" if joining.insists else joining.why(self._clock.monotonic())

    def _told(self, place: str) -> dict[str, str]:
        with self._lock:
            return dict(self._answers.get(place, {}))

    def _known(self) -> set[str]:
        """Replica ids, in the base, of all other processes that are there."""
        return {*self._base.synchroniser.peers, *self._listed} - {self._base.graph.rid}

    def close(self) -> None:
        """Answer nobody any more."""
        self._serving.close()


def _nothing() -> None:
    pass
