"""The made-up lab: its truth, its timeline, and questions that are judged by the truth."""

from __future__ import annotations

import json
from pathlib import Path

from benchmarks import days
from benchmarks.lab_life import DAY, HANDS, START, THINGS, Lab


def test_a_life_is_the_same_for_the_same_seed_and_has_weekends() -> None:
    labs = [Lab(20.0, seed) for seed in (1, 1, 2)]
    for lab in labs:
        lab.live(7)
    assert labs[0].moves == labs[1].moves != labs[2].moves
    weekend = [move for move in labs[0].moves if move.time >= START + 5 * DAY]
    assert not weekend and {move.by for move in labs[0].moves} == set(HANDS)
    assert labs[0].place(THINGS[0], START) == labs[0].moves[0].place


def test_questions_are_judged(tmp_path: Path) -> None:
    file = tmp_path / "days.json"
    arguments = ["--days", "2", "5", "--moves", "20", "--questions", "5", "--json", str(file)]
    assert days.main(arguments) == 0
    rows = json.loads(file.read_text())
    assert [row["days"] for row in rows] == [2, 5] and rows[0]["bytes"] < rows[1]["bytes"]
    answers = [answer for row in rows for answer in row["answers"]]
    assert len(answers) == 5 * 3 * 3 and {answer["kind"] for answer in answers} == {"where", "who", "surprising"}
    assert {answer["worth"] for answer in answers} <= {days.RIGHT, days.PARTLY, days.WRONG, days.UNKNOWN}
