"""Folders that may not be written, and files that may not be read, are told in one line."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

SYSTEM = str(Path(__file__).parents[1] / "runtime" / "systems" / "counters.toml")
UNPRIVILEGED = ["setpriv", "--bounding-set=-all", "--inh-caps=-all"] if os.getuid() == 0 else []
"""Modes mean nothing to root; without capabilities they do."""

pytestmark = pytest.mark.skipif(bool(UNPRIVILEGED) and shutil.which("setpriv") is None, reason="root, and no setpriv")


@pytest.fixture
def closed(tmp_path: Path) -> Iterator[Path]:
    """A folder in which nothing can be made, with a file that cannot be read."""
    folder = tmp_path / "closed"
    folder.mkdir()
    (folder / "recording.mcap").touch(mode=0)
    (folder / "system.toml").touch(mode=0)
    folder.chmod(0o555)
    yield folder
    folder.chmod(0o755)


def dsr(folder: Path, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    command = [*UNPRIVILEGED, sys.executable, "-m", "dsr.cli", *arguments]
    return subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=60, check=False, env=os.environ | environment
    )


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["run", SYSTEM], "logs and recordings go to runs/ where the command runs, and {}/runs cannot be written: "),
        (["run", SYSTEM, "-d"], "{}/runs cannot be written: Permission denied; run it in a folder of yours"),
        (["run", SYSTEM, "--folder", "mine"], "mine: Permission denied"),
        (["run", SYSTEM, "--folder", "."], "first.log: Permission denied"),
        (["run", "system.toml"], "system.toml: cannot be read: Permission denied"),
        (["scenario", "run", "hovering_1", "--lockstep"], "{}/runs cannot be written: Permission denied; run it in a"),
        (["replay", "."], "recording.mcap: cannot be read: Permission denied"),
        (["timeline", "."], "recording.mcap: cannot be read: Permission denied"),
        (["new", "robot"], "robot: Permission denied"),
    ],
)
def test_what_may_not_be_is_told_in_a_line(arguments: list[str], said: str, closed: Path) -> None:
    result = dsr(closed, *arguments)
    assert result.returncode in (1, 2)
    assert said.format(closed) in result.stderr and len(result.stderr.splitlines()) == 1, result.stderr


def test_a_runtime_folder_that_may_not_be_used_is_told_with_what_to_do(closed: Path, tmp_path: Path) -> None:
    result = dsr(tmp_path, "ls", XDG_RUNTIME_DIR=str(closed))
    assert result.returncode == 1 and "set XDG_RUNTIME_DIR to a folder of yours" in result.stderr
    assert len(result.stderr.splitlines()) == 1


def test_without_any_folder_for_temporary_files_it_says_so(closed: Path) -> None:
    lacking = f"import tempfile; tempfile._candidate_tempdir_list = lambda: [{str(closed)!r}]\n"
    program = f"{lacking}import os; os.environ.pop('XDG_RUNTIME_DIR')\nfrom dsr.cli import start; start()"
    command = [*UNPRIVILEGED, sys.executable, "-c", program, "ls"]
    result = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert result.returncode == 1
    assert result.stderr == f"No usable temporary directory found in ['{closed}']\n"
