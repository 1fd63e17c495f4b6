"""The pairs that cost the Brier score most are told with their episode and times."""

from __future__ import annotations

from benchmarks.honesty.answers import Answer
from benchmarks.honesty.errors import costly_pairs
from benchmarks.honesty.moments import Answers, RunScores

RIGHT, WRONG, MISSED = ("cup", "table"), ("lid", "cup"), ("ball", "tray")


def run(seed: int, answers: list[Answer]) -> RunScores:
    return RunScores("covers", seed, [], [Answers("on", answers, 9), Answers("in", [], 9)])


def test_the_costliest_pairs_come_first_with_their_moments() -> None:
    answers = [
        Answer(1.0, True, 1.0, RIGHT), Answer(0.8, True, 2.0, RIGHT), Answer(0.95, False, 1.0, WRONG),
        Answer(0.6, False, 2.0, WRONG), Answer(0.2, False, 3.0, WRONG), Answer(0.0, True, 4.0, MISSED),
    ]  # fmt: skip
    wrong, missed = costly_pairs([run(1, answers), run(2, answers[:2])], "on")
    assert (wrong.family, wrong.seed, wrong.about, wrong.sure_and_wrong, wrong.missed) == ("covers", 1, WRONG, 1, 0)
    assert (wrong.first, wrong.last) == (1.0, 2.0), "at 3 s the error is less than one half"
    assert wrong.cost == 0.95**2 + 0.6**2 + 0.2**2
    assert (missed.about, missed.missed, missed.sure_and_wrong, missed.cost) == (MISSED, 1, 0, 1.0)


def test_pairs_of_two_episodes_are_apart_and_kinds_too() -> None:
    found = costly_pairs([run(1, [Answer(1.0, False, 1.0, WRONG)]), run(2, [Answer(0.9, False, 1.0, WRONG)])], "on")
    assert [pair.seed for pair in found] == [1, 2]
    assert costly_pairs([run(1, [Answer(1.0, False, 1.0, WRONG)])], "in") == []
