"""Values as people and programs read them."""

from __future__ import annotations

import json
from pathlib import Path

import msgspec
import numpy as np
import pytest

from dsr import Pose
from dsr.cli.common import new_run_folder, plain, readable, run_folder


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (293.15, "293.15"),
        (0.1 + 0.2, "0.3"),
        (12345.6789, "12345.6789"),
        (1e-7, "1e-07"),
        (-0.0, "0"),
        (0.0, "0"),
        (1764045000.123, "1764045000.123"),
        (1e9, "1000000000"),
        (1e300, f"{int(1e300)}"),
        (7, "7"),
        (True, "True"),
        (b"abc", "3 bytes"),
        ("[idle]", "[idle]"),
        ((0.04, -1e-9, 2.0), "(0.04, 0, 2)"),
        ((0.1 + 0.2, 1e-17, -1.0), "(0.3, 0, -1)"),
        ((1e-7, 2e-7), "(1e-07, 2e-07)"),
        ((0.0, 0.0), "(0, 0)"),
        ((), "()"),
        ((1e300, 1.0), f"({int(1e300)}, 0)"),
        ((5e-324,), "(4.94065646e-324)"),
        (Pose((0.123456, -1e-18, 2.0)), "(0.123456, 0, 2) m, (0, 0, 0, 1) xyzw"),
        (Pose((0.4, 0.0, 0.0), covariance=1e-6 * np.eye(6)), "(0.4, 0, 0) m ± 1.0 mm, (0, 0, 0, 1) xyzw"),
    ],
)
def test_values_are_shown_as_they_were_written(value: object, text: str) -> None:
    assert readable(value) == text


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
