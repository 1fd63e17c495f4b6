"""What the shell completes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from dsr import Memory


def completed(line: str, folder: Path) -> list[str]:
    """The candidates for the last word of a command line, which may be empty."""
    words = line.split(" ")
    program = "import sys; sys.argv = ['dsr']\nfrom dsr.cli import start\nstart()"
    environment = {"_DSR_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": str(len(words) - 1)}
    done = subprocess.run(
        [sys.executable, "-c", program], env=os.environ | environment, cwd=folder, capture_output=True, text=True,
        timeout=60, check=True,
    )  # fmt: skip
    assert done.stderr == ""
    return done.stdout.split()


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("dsr ls --graph ", ["scene"]),
        ("dsr ls -g k", []),
        ("dsr record -g s", ["scene"]),
        ("dsr run table", ["tabletop"]),
        ("dsr scenario run hovering_b", ["hovering_blackout"]),
        ("dsr scenario check shell", ["shell_game"]),
        ("dsr replay runs/", ["runs/a-20260101-120000"]),
        ("dsr record info runs/a", ["runs/a-20260101-120000"]),
        ("dsr replay elsewhere/", []),
    ],
)
def test_names_are_completed(line: str, expected: list[str], memory: Memory, tmp_path: Path) -> None:
    for name in ("a-20260101-120000", "without-20260101-120000"):
        (tmp_path / "runs" / name).mkdir(parents=True)
    (tmp_path / "runs" / "a-20260101-120000" / "recording.mcap").touch()
    assert completed(line, tmp_path) == expected


def test_where_nothing_can_be_known_nothing_is_completed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "file"))
    assert completed("dsr ls -g ", tmp_path) == []
