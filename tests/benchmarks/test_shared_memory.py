"""Shared memory that Zenoh leaves behind."""

from __future__ import annotations

import fcntl
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks import shared_memory

LOCK = """
import fcntl, sys
file = open(sys.argv[1])
fcntl.flock(file, fcntl.LOCK_SH)
print(flush=True)
sys.stdin.read()
"""
ENDING = """
import fcntl, sys, time
from pathlib import Path
from benchmarks import shared_memory
shared_memory._FOLDER = Path(sys.argv[1])
file = open(shared_memory._FOLDER / "common.zenoh")
fcntl.flock(file, fcntl.LOCK_SH)
print(flush=True)
sys.stdin.read()
shared_memory.remove_leftovers()
time.sleep(0.2)
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(shared_memory, "_FOLDER", tmp_path)
    monkeypatch.setattr(shared_memory, "_PATIENCE", 0.1)
    return tmp_path


def test_segments_of_the_dead_and_our_own_go_and_those_of_the_living_stay(folder: Path) -> None:
    for name in ("dead.zenoh", "own.zenoh", "living.zenoh", "other.file"):
        (folder / name).touch()
    command = [sys.executable, "-c", LOCK, str(folder / "living.zenoh")]
    with (
        (folder / "own.zenoh").open() as own,
        subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as living,
    ):
        fcntl.flock(own, fcntl.LOCK_SH)
        assert living.stdout is not None
        living.stdout.readline()
        shared_memory.remove_leftovers()
        assert {file.name for file in folder.iterdir()} == {"living.zenoh", "other.file"}
        living.communicate()
    shared_memory.remove_leftovers()
    assert {file.name for file in folder.iterdir()} == {"other.file"}


def test_processes_that_end_together_do_not_leave_it_to_each_other(tmp_path: Path) -> None:
    (tmp_path / "common.zenoh").touch()
    command = [sys.executable, "-c", ENDING, str(tmp_path)]
    ending = [subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) for _ in range(3)]
    for process in ending:
        assert process.stdout is not None
        process.stdout.readline()
    for process in ending:
        assert process.stdin is not None
        process.stdin.close()
    for process in ending:
        assert process.wait(20) == 0
        assert process.stdout is not None
        process.stdout.close()
    assert list(tmp_path.iterdir()) == []


def test_machines_without_these_folders_are_left_alone(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(shared_memory, "_FOLDER", tmp_path / "none")
    shared_memory.remove_leftovers()
