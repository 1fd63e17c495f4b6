"""Years of the whole memory can fail: each of these wrong designs is seen in a short history of one day."""

from __future__ import annotations

import pytest

from benchmarks.years.mutants import MUTANTS, STEPS, Mutant, seed_that_shows
from benchmarks.years.running import Setting, run

SEEDS: dict[str, int] = {
    "a mesh that nobody gave is not asked for again": 2, "a snapshot does not say what was seen": 6,
    "a snapshot leaves out what waits": 518, "a source that errs ends the transfer": 2,
    "a torn journal is gone on with": 6, "answers of trusted ones remove nothing": 1,
    "anybody's dots may be used": 33, "closed worlds stay in the list of open ones": 1,
    "counters are used in two worlds": 1, "deleted worlds stay open": 1, "deltas remove nothing": 8,
    "edges need no ends": 1, "everybody may everything": 3, "everybody may remove everything": 3,
    "everybody may speak for others": 27, "files of deleted worlds stay": 1, "forks change with their parent": 1,
    "forks show the writes of their parent": 2, "no digest shows that something is missing": 1,
    "nobody asks for what it lacks": 1, "nobody gives meshes": 1, "nobody is trusted": 1, "nothing is settled": 3,
    "old generations stay": 3, "only the newest journal is read or kept": 16,
    "overlays do not hear of what comes below": 9, "removals are not kept": 32, "removals do not pass the gate": 1,
    "replicas do not move to the winner's channel": 1, "samples are never made durable": 3,
    "the list is not followed": 1, "the old generation goes before the new one is there": 16,
    "what a peer removed stays": 1, "what cannot be judged counts as seen": 1,
    "what comes for a mesh is not looked at": 2, "what is added in answers does not pass": 1,
    "writes that came too early count as seen": 40,
}  # fmt: skip
"""Of histories that show these; all others are shown by the first."""


@pytest.mark.parametrize("mutant", MUTANTS, ids=[mutant.title for mutant in MUTANTS])
def test_it_is_seen(mutant: Mutant) -> None:
    assert seed_that_shows(mutant, [SEEDS.get(mutant.title, 0)]) is not None


@pytest.mark.parametrize("seed", sorted({0, *SEEDS.values()}))
def test_without_a_mutation_nothing_is_wrong(seed: int) -> None:
    assert not run(Setting(seed, days=1, steps=STEPS)).problem
