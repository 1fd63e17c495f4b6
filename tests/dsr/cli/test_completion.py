"""What the shell completes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import dsr
from dsr import Memory
from dsr.network.rendezvous import lock_claim


def completed(line: str, folder: Path) -> list[str]:
    """The candidates for the last word of a command line, which may be empty."""
    words = line.split(" ")
    program = "import sys; sys.argv = ['dsr']\nfrom dsr.cli import start\nstart()"
    environment = {"_DSR_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": str(len(words) - 1)}
    done = subprocess.run(
        [sys.executable, "-P", "-c", program], env=os.environ | environment, cwd=folder, capture_output=True, text=True,
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
        ("dsr show cu", ["cube_3"]),
        ("dsr show -g scene c", ["camera_overhead", "cube_3"]),
        ("dsr show -g kitchen c", []),
        ("dsr show --world idea c", ["camera_overhead", "cup_1"]),
        ("dsr show --world nowhere c", []),
        ("dsr relations cube_3 --from cam", ["camera_overhead"]),
        ("dsr relations cube_3 ta", ["table"]),
        ("dsr ls --world ", ["base", "idea"]),
        ("dsr diff base i", ["idea"]),
    ],
)
def test_names_are_completed(line: str, expected: list[str], memory: Memory, tmp_path: Path) -> None:
    for name in ("a-20260101-120000", "without-20260101-120000"):
        (tmp_path / "runs" / name).mkdir(parents=True)
    (tmp_path / "runs" / "a-20260101-120000" / "recording.mcap").touch()
    idea = memory.fork("idea")
    idea.remove_node("cube_3")
    idea.add_node("cup_1", "cup")
    assert completed(line, tmp_path) == expected


def test_where_nothing_can_be_known_nothing_is_completed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "file"))
    for line in ("dsr ls -g ", "dsr show ", "dsr ls --world ", "dsr logs "):
        assert completed(line, tmp_path) == []


def test_names_of_nodes_are_completed_in_the_graph_of_the_environment(
    memory: Memory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with dsr.connect("kitchen", agent="cook", must_exist=False) as other:
        other.add_node("cup_1", "cup")
        assert completed("dsr show ", tmp_path) == []  # of which of the two?
        monkeypatch.setenv("DSR_GRAPH", "kitchen")
        assert completed("dsr show ", tmp_path) == ["cup_1"]


def test_who_holds_the_graph_and_does_not_answer_is_not_waited_for(memory: Memory, tmp_path: Path) -> None:
    memory.close()
    program = "import dsr, os, signal; dsr.connect('scene', agent='a'); os.kill(os.getpid(), signal.SIGSTOP)"
    with subprocess.Popen([sys.executable, "-c", program], stderr=subprocess.DEVNULL) as process:
        assert os.WIFSTOPPED(os.waitpid(process.pid, os.WUNTRACED)[1])
        assert completed("dsr show ", tmp_path) == []
        process.kill()


def test_logs_are_completed(tmp_path: Path) -> None:
    for name in ("plant", "planner", "run"):
        (tmp_path / f"{name}.log").touch()
    with dsr.connect("scene", agent="a", must_exist=False):
        assert completed("dsr logs pla", tmp_path) == []
        claim = lock_claim("scene")
        assert claim is not None
        with claim:
            claim.write(f"{os.getpid()} {tmp_path}")
            claim.flush()
            assert completed("dsr logs pla", tmp_path) == ["planner", "plant"]
