"""The judge finds what is lost, old or back from the dead, and grants a killed process its last moment."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from benchmarks.soak.journal import JournalWriter, Kind, Record, take_records
from benchmarks.soak.judge import KILL_WINDOW, Judge


def record(kind: Kind, number: int, at: float = 1.0) -> Record:
    return Record(kind, number, at - 0.001, at)


HISTORY = [
    record(Kind.COUNT, 7), record(Kind.POSE, 7), record(Kind.ADD, 4), record(Kind.ADD, 8), record(Kind.REMOVE, 4),
    record(Kind.SHARED, 9, at=2.0),
]  # fmt: skip


def state(**changes: Any) -> dict[str, dict[str, Any]]:
    """What all replicas show if nothing is lost; None takes an element away."""
    shown = {
        "w0": {"seen": 7}, "world w0 RT": {"pose": [7.0, 0.0]}, "w0.8": {"seen": 8}, "shared1": {"note": "w0.9"},
        **changes,
    }  # fmt: skip
    return {name: values for name, values in shown.items() if values is not None}


def findings(shown: dict[str, dict[str, Any]], killed_at: float | None = None, skew: float = 0.0) -> list[str]:
    judge = Judge(skew)
    judge.note("w0", HISTORY, killed_at)
    return judge.check(shown)


def test_a_complete_state_is_fine() -> None:
    assert findings(state()) == []


@pytest.mark.parametrize(
    ("changes", "finding"),
    [
        ({"w0": {"seen": 6}}, "w0 counts 6, not 7"),
        ({"w0": None}, "w0 counts 0, not 7"),
        ({"world w0 RT": {"pose": [5.0]}}, "w0 is at 5.0, not at 7"),
        ({"w0.8": None}, "w0.8 is missing"),
        ({"w0.4": {}}, "w0.4 is there, though removed"),
        ({"w0.16": {}}, "w0.16 came back"),
        ({"shared1": {"note": "w0.6"}}, "shared1 holds w0.6, which nobody wrote lately"),
        ({"shared1": None}, "shared1 holds nothing"),
    ],
)
def test_what_is_missing_is_found(changes: dict[str, Any], finding: str) -> None:
    assert findings(state(**changes)) == [finding]


def test_a_killed_process_may_lose_its_last_moment_and_no_more() -> None:
    lossy = state(**{"w0": {"seen": 6}, "w0.8": None})
    assert findings(lossy, killed_at=1.0 + KILL_WINDOW / 2) == []
    assert findings(lossy, killed_at=1.0 + KILL_WINDOW * 2) == ["w0 counts 6, not 7", "w0.8 is missing"]


def test_the_older_of_two_shared_writes_must_not_win() -> None:
    for skew, expected in ((0.0, ["shared1 holds w1.9, older than others by 0.999 s"]), (1.5, [])):
        judge = Judge(skew)
        judge.note("w0", HISTORY)
        judge.note("w1", [record(Kind.SHARED, 9, at=1.0)])
        assert judge.check(state(shared1={"note": "w1.9"})) == expected


def test_a_removed_node_must_not_come_back_later() -> None:
    judge = Judge()
    judge.note("w0", HISTORY)
    assert judge.check(state()) == []
    assert judge.check(state(**{"w0.4": {}})) == ["w0.4 came back"]


def test_a_journal_survives_its_writer_and_is_taken_once(tmp_path: Path) -> None:
    file = tmp_path / "w0.journal"
    writer = JournalWriter(file)
    for entry in HISTORY:
        writer.append(entry)
    assert list(take_records(file)) == HISTORY and list(take_records(file)) == []
    writer.append(HISTORY[0])
    writer.close()
    assert list(take_records(file)) == HISTORY[:1] and list(take_records(tmp_path / "none")) == []
