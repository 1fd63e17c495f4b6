"""Fault injection into an arm: every fault ends in a stop with its reason, and a blind arm would be noticed."""

from __future__ import annotations

import pytest

from benchmarks.arm_faults import FAULTS, Outcome, play, table
from benchmarks.faulty_devices import LyingArm


@pytest.mark.parametrize("name", FAULTS)
def test_no_fault_lets_the_arm_move_on(name: str) -> None:
    seed = 100 + list(FAULTS).index(name)
    outcome = play(seed, FAULTS[name])
    assert outcome.good, outcome


def test_a_fault_that_nobody_notices_is_a_bad_run() -> None:
    from dataclasses import replace

    def unseen(bench: object, rng: object) -> None:
        LyingArm.lie = None

    outcome = play(1, replace(FAULTS["positions that jump"], inject=unseen))
    assert not outcome.good


def test_the_table_has_a_row_for_each_fault_that_was_played() -> None:
    shown = table([Outcome(0, "positions that jump", 0.03, 0.2, True, "jumped", True), Outcome(1, "lost camera")])
    assert [list(column.cells) for column in shown.columns][:4] == [
        ["positions that jump", "lost camera"], ["1", "1"], ["1", "0"], ["0", "1"],
    ]  # fmt: skip
