"""Years of the whole memory can fail: each of these wrong designs is seen in a short history of one day."""

from __future__ import annotations

import pytest

from benchmarks.years.mutants import MUTANTS, STEPS, Mutant, seed_that_shows
from benchmarks.years.running import Setting, run

SEEDS: dict[str, int] = {
    "deltas account for nothing": 10,
    "a snapshot does not say what was seen": 6, "a snapshot leaves out what waits": 24,
    "a torn journal is gone on with": 3, "answers of trusted ones remove nothing": 1, "anybody's dots may be used": 3,
    "clocks are never compared": 1, "closed worlds stay in the list of open ones": 17,
    "counters are used in two worlds": 23, "deleted worlds stay open": 17, "deltas remove nothing": 8,
    "edges need no ends": 5, "everybody may everything": 9, "everybody may remove everything": 25,
    "everybody may speak for others": 31, "everybody may write everything": 33, "files of deleted worlds stay": 5,
    "forks change with their parent": 23, "forks show the writes of their parent": 23, "no digest is due": 1,
    "no digest shows that something is missing": 5, "nobody asks for what it lacks": 5, "nobody is off": 1,
    "nobody is trusted": 1, "nothing is settled": 4, "of two writes the first is kept": 8, "old generations stay": 2,
    "only the newest journal is read or kept": 8, "removals do not pass the gate": 9,
    "replicas do not move to the winner's channel": 23, "samples are never made durable": 4,
    "the list is not followed": 17, "the old generation goes before the new one is there": 8,
    "what a peer removed stays": 5, "what cannot be judged counts as seen": 1,
    "what is added in answers does not pass": 1, "writes are not kept": 1,
    "writes that came too early count as seen": 12,
}  # fmt: skip
"""Of histories that show these; all others are shown by the first."""


@pytest.mark.parametrize("mutant", MUTANTS, ids=[mutant.title for mutant in MUTANTS])
def test_it_is_seen(mutant: Mutant) -> None:
    assert seed_that_shows(mutant, [SEEDS.get(mutant.title, 0)]) is not None


@pytest.mark.parametrize("seed", sorted({0, *SEEDS.values()}))
def test_without_a_mutation_nothing_is_wrong(seed: int) -> None:
    assert not run(Setting(seed, days=1, steps=STEPS)).problem
