"""Years of the whole memory can fail: each of these wrong designs is seen in a short history of one day."""

from __future__ import annotations

import pytest

from benchmarks.years.mutants import MUTANTS, STEPS, Mutant, seed_that_shows
from benchmarks.years.running import Setting, run

SEEDS: dict[str, int] = {
    "a snapshot does not say what was seen": 18, "a torn journal is gone on with": 6,
    "all worlds of one name meet": 1, "answers of trusted ones remove nothing": 1, "anybody's dots may be used": 5,
    "closed worlds stay in the list of open ones": 14, "counters are used in two worlds": 9,
    "deleted worlds stay open": 14, "deltas remove nothing": 2, "edges need no ends": 5,
    "everybody may everything": 21, "everybody may remove everything": 33, "everybody may speak for others": 11,
    "files of deleted worlds stay": 8, "forks change with their parent": 9,
    "forks show the writes of their parent": 9, "no digest shows that something is missing": 2,
    "nobody asks for what it lacks": 2, "nobody is trusted": 3, "nothing is settled": 2,
    "only the newest journal is read or kept": 2, "removals are not kept": 1, "removals do not pass the gate": 3,
    "replicas do not move to the winner's channel": 24, "samples are never made durable": 2,
    "the list is not followed": 14, "the old generation goes before the new one is there": 20,
    "what a peer removed stays": 1, "what cannot be judged counts as seen": 3,
    "what is added in answers does not pass": 1, "writes that came too early count as seen": 10,
}  # fmt: skip
"""Of histories that show these; all others are shown by the first."""


@pytest.mark.parametrize("mutant", MUTANTS, ids=[mutant.title for mutant in MUTANTS])
def test_it_is_seen(mutant: Mutant) -> None:
    assert seed_that_shows(mutant, [SEEDS.get(mutant.title, 0)]) is not None


@pytest.mark.parametrize("seed", sorted({0, *SEEDS.values()}))
def test_without_a_mutation_nothing_is_wrong(seed: int) -> None:
    assert not run(Setting(seed, days=1, steps=STEPS)).problem
