"""Short histories of parts under faults: nothing is wrong with them, and each wrong design is seen."""

from __future__ import annotations

import pytest

from benchmarks.interest.histories import Outcome, Setting, run, shortest
from benchmarks.interest.mutants import MUTANTS, Mutant, shown_by

SEEDS = {
    "what is not held counts as removed": 2, "a part that was left answers as if it were empty": 37,
    "edges into other parts are never buried": 1, "counters are used again in a part": 2,
}  # fmt: skip
"""Of histories that show these; all others are shown by the first."""


@pytest.mark.parametrize("mutant", MUTANTS, ids=[mutant.title for mutant in MUTANTS])
def test_a_wrong_design_is_seen(mutant: Mutant) -> None:
    assert shown_by(mutant, [SEEDS.get(mutant.title, 0)]) is not None


def test_nothing_is_wrong_with_the_right_one() -> None:
    outcomes: list[Outcome] = [run(Setting(seed)) for seed in range(12)]
    assert [outcome.problem for outcome in outcomes] == [""] * 12
    assert sum(outcome.changes for outcome in outcomes) > 100 and sum(outcome.waiting for outcome in outcomes) > 5
    met = sum((outcome.met for outcome in outcomes), outcomes[0].met - outcomes[0].met)
    assert min(met[kind] for kind in ("lost", "delayed", "duplicated", "partition", "kill")) > 20


def test_the_same_seed_is_the_same_history() -> None:
    assert run(Setting(3, days=1)) == run(Setting(3, days=1))


def test_a_failing_history_is_made_shorter(monkeypatch: pytest.MonkeyPatch) -> None:
    mutant = next(each for each in MUTANTS if each.title == "a part that is left stays in sight")
    monkeypatch.setattr(mutant.target, mutant.name, mutant.wrong(getattr(mutant.target, mutant.name)))
    setting = Setting(0, days=1)
    problem = run(setting).problem
    assert problem and len(shortest(setting, problem)) < 20 < len(setting.history())
