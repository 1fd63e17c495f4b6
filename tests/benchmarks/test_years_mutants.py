"""Years of the whole memory can fail: each of these wrong designs is seen in a short history of one day."""

from __future__ import annotations

import pytest

from benchmarks.years.mutants import MUTANTS, STEPS, Mutant, seed_that_shows
from benchmarks.years.running import Setting, run

SEEDS: dict[str, int] = {
    "everybody may speak for others": 95, "replicas do not move to the winner's channel": 76,
    "a snapshot leaves out what waits": 18, "all worlds of one name meet": 1,
    "answers of trusted ones remove nothing": 7, "anybody's dots may be used": 3,
    "closed worlds stay in the list of open ones": 10, "counters are used in two worlds": 9,
    "deleted worlds stay open": 10, "deltas remove nothing": 26, "edges need no ends": 10,
    "everybody may everything": 5, "everybody may remove everything": 7, "everybody may write everything": 19,
    "files of deleted worlds stay": 15, "forks change with their parent": 9,
    "forks show the writes of their parent": 9, "no digest shows that something is missing": 3,
    "nobody asks for what it lacks": 3, "nobody is trusted": 1, "nothing is settled": 5,
    "of two writes the first is kept": 3, "only the newest journal is read or kept": 42,
    "removals do not pass the gate": 7, "samples are never made durable": 5, "the list is not followed": 10,
    "the old generation goes before the new one is there": 57, "what a peer removed stays": 7,
    "what cannot be judged counts as seen": 3, "what is added in answers does not pass": 1,
    "writes that came too early count as seen": 10,
}  # fmt: skip
"""Of histories that show these; all others are shown by the first."""


@pytest.mark.parametrize("mutant", MUTANTS, ids=[mutant.title for mutant in MUTANTS])
def test_it_is_seen(mutant: Mutant) -> None:
    assert seed_that_shows(mutant, [SEEDS.get(mutant.title, 0)]) is not None


@pytest.mark.parametrize("seed", sorted({0, *SEEDS.values()}))
def test_without_a_mutation_nothing_is_wrong(seed: int) -> None:
    assert not run(Setting(seed, days=1, steps=STEPS)).problem
