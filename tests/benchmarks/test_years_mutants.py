"""Years of the whole memory can fail: each of these wrong designs is seen in a short history of one day."""

from __future__ import annotations

import pytest

from benchmarks.years.mutants import MUTANTS, STEPS, Mutant, seed_that_shows
from benchmarks.years.running import Setting, run

SEEDS: dict[str, int] = {
    "a mesh that nobody gave is not asked for again": 36, "a snapshot does not say what was seen": 2,
    "a snapshot leaves out what waits": 20, "a source that errs ends the transfer": 3,
    "a torn journal is gone on with": 3, "all worlds of one name meet": 3,
    "answers of trusted ones remove nothing": 1, "anybody's dots may be used": 7, "clocks are never compared": 1,
    "closed worlds stay in the list of open ones": 1, "counters are used in two worlds": 9,
    "deleted worlds stay open": 1, "edges need no ends": 6, "everybody may everything": 9,
    "files of deleted worlds stay": 1, "forks change with their parent": 2,
    "forks show the writes of their parent": 11, "nobody is off": 1, "nobody is trusted": 1, "nothing is settled": 5,
    "of two writes the first is kept": 13, "only the newest journal is read or kept": 2, "removals are not kept": 2,
    "removals do not pass the gate": 1, "replicas do not move to the winner's channel": 6,
    "samples are never made durable": 5, "the list is not followed": 1,
    "the old generation goes before the new one is there": 16, "what cannot be judged counts as seen": 11,
    "what comes for a mesh is not looked at": 3, "what is added in answers does not pass": 3,
    "writes that came too early count as seen": 20,
}  # fmt: skip
"""Of histories that show these; all others are shown by the first."""


@pytest.mark.parametrize("mutant", MUTANTS, ids=[mutant.title for mutant in MUTANTS])
def test_it_is_seen(mutant: Mutant) -> None:
    assert seed_that_shows(mutant, [SEEDS.get(mutant.title, 0)]) is not None


@pytest.mark.parametrize("seed", sorted({0, *SEEDS.values()}))
def test_without_a_mutation_nothing_is_wrong(seed: int) -> None:
    assert not run(Setting(seed, days=1, steps=STEPS)).problem
