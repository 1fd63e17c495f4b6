"""State folders that somebody else prepared: links are not followed to remove, and only regular files are read."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from dsr import ConfigError, LocalNetwork, ManualClock, Memory
from dsr.persistence.world_keeper import WorldKeeper


def _keep(folder: Path) -> None:
    clock = ManualClock()
    memory = Memory("g", "a", transport=LocalNetwork(clock, seed=1).connect("a"), clock=clock)
    memory.replica.synchroniser.nobody_there()
    WorldKeeper(memory, folder, threaded=False)
    memory.close()


@pytest.mark.parametrize("place", ["worlds", "worlds/idea", "worlds/idea/0"])
def test_nothing_behind_a_link_is_removed(tmp_path: Path, place: str) -> None:
    thesis = tmp_path / "home" / "documents" / "thesis" / "text"
    thesis.mkdir(parents=True)
    (thesis / "chapter").write_text("one")
    link = tmp_path / "state" / place
    link.parent.mkdir(parents=True)
    link.symlink_to(tmp_path / "home")
    _keep(tmp_path / "state")
    assert (thesis / "chapter").read_text() == "one"


def test_folders_of_worlds_that_are_gone_are_still_removed(tmp_path: Path) -> None:
    (tmp_path / "state" / "worlds" / "idea" / "0").mkdir(parents=True)
    _keep(tmp_path / "state")
    assert not list((tmp_path / "state" / "worlds").iterdir())


def _sparse(file: Path) -> None:
    with file.open("wb") as opened:
        opened.write(b"dsr-state 1\n")
        opened.truncate(1 << 40)


@pytest.mark.parametrize("make", [os.mkfifo, lambda file: file.symlink_to("/dev/zero"), Path.mkdir, _sparse])
@pytest.mark.parametrize("kind", ["snapshot", "journal"])
def test_only_regular_files_of_bounded_size_are_read(tmp_path: Path, kind: str, make: Callable[[Path], None]) -> None:
    make(tmp_path / f"{kind}-000001")
    with pytest.raises(ConfigError, match=f"{kind}-000001|no snapshot"):
        _keep(tmp_path)
