"""The prototype of a compiled core: that it does what the Python code does, and that its steps are measured."""

from __future__ import annotations

import sys
from pathlib import Path
from time import thread_time
from typing import Any
from unittest import mock

import numpy as np
import pytest

from benchmarks.compiled import __main__ as command
from benchmarks.compiled import steps
from benchmarks.compiled.building import build, new_core, why_not
from benchmarks.compiled.comparing import DiffersError, compare
from benchmarks.compiled.steps import CORE, PYTHON
from benchmarks.compiled.whole import PARTS, Spent
from dsr.crdt.delta import Write
from dsr.crdt.store import Incarnation, Store

pytestmark = pytest.mark.skipif(why_not() is not None, reason=str(why_not()))


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The prototype, built."""
    return build(tmp_path_factory.mktemp("compiled"))


@pytest.mark.parametrize("seed", range(8))
def test_it_does_what_python_does(file: Path, seed: int) -> None:
    compare(file, seed, 400)


def _last_wins(self: Store, entry: Incarnation, write: Write) -> None:
    entry.registers[write.attribute] = write
    if entry.announced:
        self._observer.register_changed(entry, write.attribute)


def _held_back_counts(self: Store, delta: Any, held_back: Any) -> None:
    for rid, first, last in delta.context:
        self.context.add_range(rid, first, last)


@pytest.mark.parametrize(("name", "wrong"), [("_set", _last_wins), ("_learn", _held_back_counts)])
def test_the_comparison_notices_a_difference(file: Path, name: str, wrong: Any) -> None:
    with mock.patch.object(Store, name, wrong), pytest.raises(DiffersError):
        for seed in range(5):
            compare(file, seed, 400)


def test_broken_messages_are_refused_or_joined_but_harm_nothing(file: Path) -> None:
    holder, random = steps.filled(file, "holder", 20), np.random.default_rng(0)
    holder.write_node("node_1", {"order": 7}, 2.0)
    (delta,), _ = holder.take()
    (piece,) = holder.pieces()
    refused = 0
    for turn in range(3000):
        core = new_core(file, "newcomer")
        whole, join = (piece, core.join_piece) if turn % 2 else (delta, core.join)
        broken = bytearray(whole)
        for place in random.integers(len(broken), size=random.integers(1, 4)):
            broken[place] = random.integers(256)
        try:
            join(bytes(broken[: random.integers(len(broken))] if turn % 5 == 0 else broken), 2.0)
        except (ValueError, NotImplementedError):
            refused += 1
        core.state()
    assert refused > 500


def test_the_steps_are_measured_of_both(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(steps, "JOINED", 50)
    times = steps.measure(file, 1)
    assert all({PYTHON, CORE} <= taken.keys() and min(taken.values()) > 0 for taken in times.values())
    assert {steps.INSERT, steps.UPDATE, steps.RT, steps.SENT, *steps.RECEIVED, *steps.JOIN} <= times.keys()
    live = command.whole_table(1.0, dict.fromkeys(PARTS, 0.05), times)
    assert live.row_count == len(PARTS) + 1


def test_time_inside_counts_for_what_takes_it() -> None:
    spent = Spent()

    def busy(seconds: float) -> None:
        end = thread_time() + seconds
        while thread_time() < end:
            pass

    publish = spent.timed("Zenoh", lambda: busy(0.02))

    def send() -> None:
        publish()
        busy(0.01)

    spent.timed("sent", send)()
    total = spent.total()
    assert 0.019 < total["Zenoh"] < 0.03 and 0.009 < total["sent"] < 0.018
    assert sum(total.values()) == total["Zenoh"] + total["sent"]


def test_without_a_compiler_nothing_is_measured(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(command, "why_not", lambda: "there is no C++ compiler")
    monkeypatch.setattr(sys, "argv", ["compiled"])
    command.main()
    assert capsys.readouterr().out == "not measured: there is no C++ compiler\n"
