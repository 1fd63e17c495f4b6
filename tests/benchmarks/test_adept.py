"""The ADEPT benchmark: reading of cases, scores beside the naive peer, and what it says without or with wrong data."""

from __future__ import annotations

import gzip
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.adept import __main__ as adept
from benchmarks.adept.cases import ROWS, read_case
from benchmarks.real.recordings import DataError

_HALF = [0.3, 0.3, 0.3]
_TURN = [0.0, 0.0, 0.0]


def write(path: Path, present: slice, frames: int = 60) -> None:
    """A box that slides behind a screen, and is in the scene in some frames only; the screen falls at last."""
    course = [[-0.6, -1.6 + 0.04 * frame, 0.3, *_TURN] for frame in range(frames)]
    there: list[Any] = [None] * frames
    there[present] = course[present]
    screen = [[0.2, 0.0, 0.75, *_TURN] if frame < 40 else [5.0, 9.0, 0.0, *_TURN] for frame in range(frames)]
    case = {"dt": 0.04, "objects": [{"half_extents": _HALF, "frames": there}],
            "occluders": [{"half_extents": [0.04, 1.0, 0.75], "frames": screen}]}  # fmt: skip
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(gzip.compress(json.dumps(case).encode()))


def test_what_is_hidden_by_a_screen_is_not_recognised(tmp_path: Path) -> None:
    write(tmp_path / "case.json.gz", slice(0, 60))
    moments = read_case(tmp_path / "case.json.gz").moments
    counts = np.array([len(moment.percepts) for moment in moments])
    assert counts[0] == 1 and counts[35] == 0 and counts[45] == 1
    assert moments[10].time == pytest.approx(0.4)
    assert moments[0].percepts[0].position == pytest.approx([-0.6, -1.6, 0.3])


def test_what_has_vanished_scores_above_what_has_not_and_the_naive_peer_cannot_tell(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    name, violation, controls = ROWS["vanish"]
    write(tmp_path / "cube" / f"{name}_cube_{violation}.json.gz", slice(0, 30))
    for control in controls:
        write(tmp_path / "cube" / f"{name}_cube_{control}.json.gz", slice(0, 60))
    out = tmp_path / "figures.json"
    monkeypatch.setattr(
        sys, "argv", ["adept", "--data", str(tmp_path), "--shape", "cube", "--row", "vanish", "--json", str(out)]
    )
    assert adept.main() == 0
    figures = json.loads(out.read_text())["cube"]["vanish"]
    assert figures["belief"]["accuracy"] == 1.0
    assert figures["last percept"]["accuracy"] <= 0.5
    assert "vanish" in capsys.readouterr().out


def test_a_tie_counts_a_half() -> None:
    assert adept.accuracy(3.0, [2.0, 3.0, 4.0]) == pytest.approx(0.5)


@pytest.mark.parametrize(
    "content",
    [b"", b"no gzip", gzip.compress(b"{}"), gzip.compress(b"[1")],
    ids=["empty", "no gzip", "no case", "no JSON"],  # a compressed file holds its time: no name for a test
)
def test_files_that_are_no_case_are_told(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "case.json.gz").write_bytes(content)
    with pytest.raises(DataError, match=r"case\.json\.gz"):
        read_case(tmp_path / "case.json.gz")


def test_without_data_it_is_skipped_and_with_wrong_data_it_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["adept"])
    assert adept.main() == 0
    assert "skipped" in capsys.readouterr().out
    monkeypatch.setattr(sys, "argv", ["adept", "--data", str(tmp_path), "--shape", "pyramid"])
    assert adept.main() == 2
    assert "pyramid" in capsys.readouterr().out
