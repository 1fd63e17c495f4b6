"""Whose clock is wrong: one vote an agent, and no verdict from a single one."""

from __future__ import annotations

import pytest

from dsr.replication.clock_votes import Voice, verdict


def voices(*said: tuple[str, bool, bool]) -> list[Voice]:
    return [Voice(rid, float(time), ahead, behind) for time, (rid, ahead, behind) in enumerate(said)]


@pytest.mark.parametrize(
    ("said", "kind", "text"),
    [
        ([], "", ""),
        ([("a-1", False, False), ("b-1", False, False)], "", ""),
        ([("a-1", True, False)], "apart", "the clock of a is behind this one, or this one is wrong"),
        ([("a-1", False, True)], "apart", "the clock of a is ahead of this one, or this one is wrong"),
        ([("a-1", True, False), ("b-1", True, False)], "ahead", "this clock is ahead of most others (a, b)"),
        ([("a-1", False, True), ("b-1", False, True)], "behind", "this clock is behind most others (a, b)"),
        ([(f"a-{n}", True, False) for n in range(9)], "apart", "a is behind"),
        ([*[(f"a-{n}", True, False) for n in range(9)], ("b-1", False, False)], "apart", "a is behind"),
        ([("a-1", True, False), ("b-1", True, False), ("c-1", False, False), ("d-1", False, False)], "apart", "a, b"),
        ([("a-1", True, False), ("b-1", True, False), ("c-1", False, False)], "ahead", "a, b"),
        ([("a-1", True, False), ("b-1", True, False), ("a-2", False, False)], "apart", "of b is behind"),
        ([(f"{n}-1", True, False) for n in "abcdef"], "ahead", "(a, b, c, d and 2 more)"),
    ],
)
def test_the_verdict_is_that_of_most_agents(said: list[tuple[str, bool, bool]], kind: str, text: str) -> None:
    found = verdict(voices(*said))
    assert found.kind == kind and text in str(found)
    assert (found.is_ahead, found.is_behind) == (kind == "ahead", kind == "behind")
