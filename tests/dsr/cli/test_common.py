"""Values as people and programs read them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from dsr import Pose
from dsr.cli.common import new_run_folder, plain, readable, run_folder


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (0.123456, "0.1235"),
        (3e-11, "0"),
        (1_700_000_000.25, "1700000000.250"),
        ((0.04, -1e-9, 2.0), "(0.04, 0, 2)"),
        (True, "True"),
        (b"abc", "3 bytes"),
        ("[idle]", "[idle]"),
        (Pose((0.1, 0.0, 0.2)), "(0.1, 0, 0.2), (0, 0, 0, 1)"),
        (Pose((0.1, 0.0, 0.2), covariance=np.eye(6) * 4e-6), "(0.1, 0, 0.2) ± 2.0 mm, (0, 0, 0, 1)"),
    ],
)
def test_values_are_short_for_people(value: Any, expected: str) -> None:
    assert readable(value) == expected


def test_a_pose_keeps_everything_for_programs() -> None:
    pose = Pose((0.1, 0.0, 0.2), stamp=5.0, covariance=np.eye(6))
    read = json.loads(msgspec.json.encode(plain(pose)))
    assert read["translation"] == [0.1, 0.0, 0.2]
    assert (read["rotation"], read["stamp"]) == ([0.0, 0.0, 0.0, 1.0], 5.0)
    assert read["covariance"] == np.eye(6).tolist()


def test_a_new_run_folder_goes_again_if_nothing_is_in_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match="no start"), run_folder(None, "towers") as empty:
        raise ValueError("no start")
    with run_folder(None, "hovering") as used:
        (used / "plant.log").touch()
    with run_folder(tmp_path / "given", "towers") as given:
        given.mkdir()
    assert not empty.exists() and used.exists() and given.exists()


def test_run_folders_are_new_each_time(tmp_path: Path) -> None:
    folders = {new_run_folder("hovering", tmp_path) for _ in range(5)}
    assert len(folders) == 5
    assert all(folder.is_dir() and folder.name.startswith("hovering-") for folder in folders)
