"""Wrong designs of what keeps memories equal, keeps their state, guards them and makes worlds: histories must fail.

    python -m benchmarks.years.mutants --seeds 40

Each is put in alone. Exit 0 only if some history of the first seeds shows each.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple
from unittest import mock

from benchmarks.years.running import Setting, run
from dsr.crdt.delta import Delta
from dsr.crdt.pieces import START, Piece
from dsr.crdt.store import Store
from dsr.geometry.exchange import MeshExchange
from dsr.geometry.mesh import Mesh
from dsr.geometry.transfer import Transfer
from dsr.graph.graph import Graph
from dsr.graph.sharing import Sharing
from dsr.memory import Memory
from dsr.network.keys import Keys
from dsr.persistence import keeper
from dsr.persistence.generations import Generations
from dsr.persistence.keeper import StateKeeper
from dsr.persistence.pending import PendingWrites
from dsr.persistence.world_keeper import WorldKeeper
from dsr.replication import replica
from dsr.replication.claims import Claims
from dsr.replication.clock_votes import ClockVerdict
from dsr.replication.fetching import Fetch
from dsr.replication.inquiry import Inquiry
from dsr.replication.lacking import Lacking
from dsr.replication.pace import Pace
from dsr.replication.peers import Peers
from dsr.replication.replica import Replica
from dsr.replication.sync import Synchroniser
from dsr.security import gate
from dsr.security.gate import Gate
from dsr.worlds import opened
from dsr.worlds.fork import ForkedGraph
from dsr.worlds.opened import Worlds
from dsr.worlds.overlay import Overlay

STEPS = 150
"""Steps of the histories that look for most mutants: short ones, of one day"""


class Mutant(NamedTuple):
    """A wrong design in the place of a right one."""

    title: str
    """What is wrong."""
    target: Any
    name: str
    wrong: Callable[[Any], Any]
    """Makes the wrong one of the right one."""
    days: int = 1
    steps: int = STEPS
    """Of the histories that look for it; see `Setting`."""


def constant(value: Any) -> Callable[[Any], Any]:
    """Whatever is asked, this is the answer."""
    return lambda right: lambda *arguments, **options: value


def _empty_answer(right: Any) -> Any:
    def answer(self: Synchroniser, sender: str, payload: bytes) -> Piece:
        return Piece(START, whole=[], joined=self.joined)

    return answer


def _without(*fields: str) -> Callable[[Any], Any]:
    """Some fields of a delta are passed over."""

    def wrong(right: Any) -> Any:
        def call(self: Any, *arguments: Any, **options: Any) -> Any:
            return right(self, *(_stripped(each, fields) for each in arguments), **options)

        return call

    return wrong


def _stripped(item: Any, fields: Iterable[str]) -> Any:
    if not isinstance(item, Delta):
        return item
    copy = Delta(list(item.adds), list(item.writes), list(item.removed), list(item.context), item.live, item.examined)
    for field in fields:
        setattr(copy, field, [] if field not in ("live", "examined") else None)
    return copy


def _result_without(*fields: str) -> Callable[[Any], Any]:
    """Some fields of the resulting delta are passed over."""

    def wrong(right: Any) -> Any:
        return lambda *arguments, **options: _stripped(right(*arguments, **options), fields)

    return wrong


def _pieces_without_last(right: Any) -> Any:
    def pieces(store: Any, lock: Any) -> Iterator[Delta]:
        *first, last = right(store, lock)
        yield from first
        yield Delta(live=last.live)

    return pieces


def _pieces_without_waiting(right: Any) -> Any:
    def pieces(store: Any, lock: Any) -> Iterator[Delta]:
        with mock.patch.object(Store, "waiting_writes", lambda self: []):
            found = right(store, lock)
        return iter(list(found))

    return pieces


def _append_without_fsync(right: Any) -> Any:
    def append(self: StateKeeper, journal: Any, news: list[Delta]) -> None:
        with mock.patch.object(os, "fsync", lambda descriptor: None):
            right(self, journal, news)

    return append


def _only_newest_journal(right: Any) -> Any:
    def numbers(self: Generations, kind: str) -> list[int]:
        found = right(self, kind)
        return list(found[-1:]) if kind == "journal" else list(found)

    return numbers


def _without_journals(right: Any) -> Any:
    def restored(self: Generations) -> Iterator[Delta]:
        with mock.patch.object(Generations, "_journal", lambda self, number: iter(())):
            yield from right(self)

    return restored


def _first_write_wins(right: Any) -> Any:
    def add(self: PendingWrites, delta: Delta) -> None:
        known = dict(self._writes)
        right(self, delta)
        self._writes.update(known)

    return add


def _drop_before_it_is_written(right: Any) -> Any:
    def begin(self: Generations) -> Any:
        journal = right(self)
        for number in [*self._numbers("snapshot"), *self._numbers("journal")]:
            if number < self.newest:
                for kind in ("snapshot", "journal"):
                    self._file(kind, number).unlink(missing_ok=True)
        return journal

    return begin


def _generation_unrecorded(right: Any) -> Any:
    def begin(self: StateKeeper) -> None:
        right(self)
        self._graph.store.recorder = None

    return begin


def _goes_on_with_the_torn_journal(right: Any) -> Any:
    def give_up(self: StateKeeper, error: Exception) -> None:
        if self._journal is None:
            right(self, error)

    return give_up


def _same_rid(right: Any) -> Any:
    return lambda worlds, source: worlds.base.rid


def _one_channel(right: Any) -> Any:
    def keys(self: Any, graph: str) -> Keys:
        return Keys(graph, self.record.info.name, "w")

    return keys


def _all_of(right: Any) -> Any:
    return lambda self, dots, may: iter(list(dots))


def _forget_at_once(right: Any) -> Any:
    def forget(self: Peers, now: float) -> list[str]:
        gone = list(self)
        for rid in gone:
            del self[rid]
        return gone

    return forget


def _any_mesh(right: Any) -> Any:
    def verify(self: Transfer, source: Any, data: memoryview) -> bool:
        self.mesh = Mesh.decode(bytes(data))
        self.finished.set()
        self._running.clear()
        return True

    return verify


def _asks_once(right: Any) -> Any:
    def transfer(self: MeshExchange, hash: str, **options: Any) -> Any:
        return None if hash in self._failures else right(self, hash, **options)

    return transfer


def _silent_is_the_end(right: Any) -> Any:
    def drop(self: Transfer, *arguments: Any) -> None:
        right(self, *arguments)
        self.finished.set()

    return drop


MUTANTS: list[Mutant] = [
    Mutant("nobody asks for what it lacks", Lacking, "_is_behind", constant(False)),
    Mutant("no digest shows that something is missing", Lacking, "have_more", constant([])),
    Mutant("samples are never made durable", Synchroniser, "make_durable", constant(Delta())),
    Mutant("answers are not joined", Synchroniser, "_join_reply", constant(None)),
    Mutant("answers hold nothing", Synchroniser, "answer", _empty_answer),
    Mutant("no digest is due", Pace, "digest_due", constant(False)),
    Mutant("nothing is settled", Pace, "settling_due", constant(False)),
    Mutant("all peers are forgotten at each look", Peers, "forget_gone", _forget_at_once),
    Mutant("no peer is ever asked", Inquiry, "_peer_to_ask", constant(None)),
    Mutant("deltas remove nothing", Claims, "own_part", _result_without("removed")),
    Mutant("deltas write nothing, and account for it", Claims, "own_part", _result_without("writes")),
    Mutant("additions of deltas are left out, and accounted for", Claims, "own_part", _result_without("adds")),
    Mutant("the rest of an answer accounts for nothing", Fetch, "rest", _result_without("context")),
    Mutant("what a peer removed stays", Store, "_remove_absent", constant(None)),
    Mutant("writes that came too early count as seen", Store, "_learn", lambda right: lambda s, d, h: right(s, d, [])),
    Mutant("requests go to nobody", replica, "encode_piece", constant(b"")),
    Mutant("clocks are never compared", Synchroniser, "_compare_clocks", constant(None)),
    Mutant("nobody is off", Synchroniser, "_verdict", lambda right: lambda self, now: ClockVerdict()),
    Mutant("what arrives is thrown away in the inbox", Replica, "_receive", constant(None)),
    Mutant("events of the network are thrown away", Replica, "_enqueue", constant(None)),
    # ---- what keeps the state
    Mutant("news are not written", StateKeeper, "_write_news", constant(None)),
    Mutant("news are not flushed to the disk", StateKeeper, "_append", _append_without_fsync),
    Mutant("after a snapshot nothing is recorded", StateKeeper, "_begin_generation", _generation_unrecorded),
    Mutant("a torn journal is gone on with", StateKeeper, "_give_up_for_now", _goes_on_with_the_torn_journal),
    Mutant("nothing is restored", StateKeeper, "_restore", constant(True)),
    Mutant("removals are not kept", PendingWrites, "add", _without("removed")),
    Mutant("contexts are not kept", PendingWrites, "add", _without("context")),
    Mutant("additions are not kept", PendingWrites, "add", _without("adds")),
    Mutant("writes are not kept", PendingWrites, "add", _without("writes")),
    Mutant("of two writes the first is kept", PendingWrites, "add", _first_write_wins),
    Mutant("a snapshot does not say what was seen", keeper, "pieces", _pieces_without_last),
    Mutant("a snapshot leaves out what waits", keeper, "pieces", _pieces_without_waiting, 3, 300),
    Mutant("replies are kept as they came", Store, "_to_be_kept", lambda right: lambda self, delta: Delta()),
    Mutant("journals are not read", Generations, "restored", _without_journals),
    Mutant("only the newest journal is read or kept", Generations, "_numbers", _only_newest_journal),
    Mutant("the old generation goes before the new one is there", Generations, "begin", _drop_before_it_is_written),
    Mutant("old generations stay", Generations, "_drop_old", constant(None)),
    Mutant("files of deleted worlds stay", WorldKeeper, "_remove_others", constant(None)),
    # ---- what guards
    Mutant("everybody may everything", Gate, "objection", constant(None)),
    Mutant("everybody may remove everything", gate._Screening, "removable", _all_of),
    Mutant("everybody may speak for others", gate._Screening, "_is_own", constant(True)),
    Mutant("anybody's dots may be used", gate._Screening, "_is_own_dot", constant(True)),
    Mutant("nobody is trusted", Gate, "trusts", constant(False)),
    Mutant("what cannot be judged counts as seen", gate, "without", lambda right: lambda ranges, dots: iter(ranges)),
    Mutant("removals do not pass the gate", gate._Screening, "own_changes", _result_without("removed")),
    Mutant("answers of trusted ones remove nothing", gate._Screening, "everybodys_changes", _result_without("live")),
    Mutant("what is added in answers does not pass", gate._Screening, "everybodys_changes", _result_without("adds")),
    # ---- worlds
    Mutant("deleted worlds stay open", Memory, "drop", constant(None)),
    Mutant("replicas do not move to the winner's channel", Memory, "move", constant(None)),
    Mutant("the list is not followed", Worlds, "sweep", constant(None)),
    Mutant("closed worlds stay in the list of open ones", Worlds, "forget", constant(None)),
    Mutant("counters are used in two worlds", Worlds, "_new_rid", _same_rid),
    Mutant("all worlds of one name meet", opened.WorldHandle, "keys", _one_channel),
    Mutant("forks change with their parent", ForkedGraph, "take_over", constant(None)),
    Mutant("forks show the writes of their parent", Sharing, "entry_copied", constant(None)),
    Mutant("edges need no ends", Graph, "_has_ends", constant(True)),
    Mutant("overlays do not hear of what comes below", Overlay, "below_came", constant(None)),
    # ---- meshes
    Mutant("nobody gives meshes", MeshExchange, "_answer", constant(None)),
    Mutant("what comes for a mesh is not looked at", Transfer, "_verify", _any_mesh),
    Mutant("a mesh that nobody gave is not asked for again", MeshExchange, "_transfer", _asks_once),
    Mutant("a source that errs ends the transfer", Transfer, "_drop", _silent_is_the_end),
]


def seed_that_shows(mutant: Mutant, seeds: Iterable[int]) -> int | None:
    """The first of the seeds whose history fails with the wrong design; None if none does."""
    right = getattr(mutant.target, mutant.name)
    with mock.patch.object(mutant.target, mutant.name, mutant.wrong(right)):
        settings = (Setting(seed, days=mutant.days, steps=mutant.steps) for seed in seeds)
        return next((setting.seed for setting in settings if run(setting).problem), None)


def main() -> None:
    """Look for each mutant; exit 1 if one is not seen."""
    parser = argparse.ArgumentParser("python -m benchmarks.years.mutants", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--seeds", type=int, default=40, help="histories that each may take (default: 40)")
    options = parser.parse_args()
    seen = 0
    for mutant in MUTANTS:
        seed = seed_that_shows(mutant, range(options.seeds))
        seen += seed is not None
        print(f"{'NOT SEEN' if seed is None else f'seed {seed}':>9}  {mutant.title}", flush=True)
    print(f"{seen} of {len(MUTANTS)} wrong designs seen")
    raise SystemExit(0 if seen == len(MUTANTS) else 1)


if __name__ == "__main__":
    main()
