"""What hands and boxes do to things that cannot be seen, in the whole system and in lockstep; the baseline beside."""

from __future__ import annotations

import pytest

from agents.scenario.judge.result import Result
from agents.scenario.run.runner import run_lockstep
from agents.scenario.run.staging import make_run

SEED = 1


def failures(result: Result) -> list[str]:
    return [f"{verdict.text}: {verdict.actual}" for verdict in result.expectations if not verdict.passed]


@pytest.mark.parametrize("name", ["a_hidden_fall", "b_drop_in_box", "e_held_behind_back", "dropped_behind_box"])
def test_what_cannot_be_seen_is_known(name: str) -> None:
    result = run_lockstep(make_run(name, seed=SEED, sensor="poses"))
    assert failures(result) == []
    assert result.passed


def test_the_published_reasoner_drops_what_is_held_out_of_sight() -> None:
    result = run_lockstep(make_run("e_held_behind_back", seed=SEED, sensor="poses", policy="published"))
    assert any(failure.startswith("actions") and "Release(cup" in failure for failure in failures(result))
