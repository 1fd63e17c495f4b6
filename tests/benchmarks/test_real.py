"""Benchmarks on recordings of others: skipped without them, and clear about folders that hold something else."""

from __future__ import annotations

import bz2
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks.real.__main__ import BENCHMARKS
from benchmarks.real.block import read_block
from benchmarks.real.recordings import DataError, RealBenchmark, quantiles


def real(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "benchmarks.real", *arguments], check=False, capture_output=True, text=True, timeout=120
    )


@pytest.mark.parametrize("name", [benchmark.name for benchmark in BENCHMARKS])
def test_without_data_it_is_skipped_and_says_where_they_are(name: str) -> None:
    done = real(name)
    assert done.returncode == 0
    assert "skipped" in done.stdout and "ublished" in done.stdout


@pytest.mark.parametrize("benchmark", BENCHMARKS, ids=lambda benchmark: benchmark.name)
def test_a_wrong_folder_is_told(benchmark: RealBenchmark, tmp_path: Path) -> None:
    for folder in (tmp_path / "nowhere", tmp_path):
        with pytest.raises(DataError, match=str(folder)):
            benchmark.run(folder)


def test_a_wrong_folder_ends_with_2(tmp_path: Path) -> None:
    done = real("tags", "--data", str(tmp_path))
    assert done.returncode == 2 and "rgb_*.png" in done.stdout


def test_pictures_without_depth_are_told(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "rgb_1.png"), np.zeros((540, 960, 3), np.uint8))
    (benchmark,) = (benchmark for benchmark in BENCHMARKS if benchmark.name == "tags")
    with pytest.raises(DataError, match="depth_"):
        benchmark.run(tmp_path)


def test_found_tags_are_drawn_where_they_are(tmp_path: Path) -> None:
    tag = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11), 7, 80)
    picture = np.full((540, 960, 3), 255, np.uint8)
    picture[200:280, 400:480] = tag[..., None]
    cv2.imwrite(str(tmp_path / "rgb_1.png"), picture)
    cv2.imwrite(str(tmp_path / "depth_1.png"), np.full((540, 960), 317, np.uint16))  # mm at which 48 mm are 80 px
    done = real("tags", "--data", str(tmp_path), "--pictures", str(tmp_path / "out"))
    assert done.returncode == 0 and "1 pictures" in done.stdout
    drawn = cv2.imread(str(tmp_path / "out/rgb_1-7.png"))
    assert drawn is not None
    magenta = (drawn[..., 1] < 100) & (drawn[..., 0] > 150) & (drawn[..., 2] > 150)  # the outline of the pose
    rows, columns = np.nonzero(magenta)
    left, top = 440 - 120, 240 - 120
    assert rows.min() / 2 + top == pytest.approx(200, abs=2) and rows.max() / 2 + top == pytest.approx(280, abs=2)
    assert columns.min() / 2 + left == pytest.approx(400, abs=2)


def test_without_images_there_is_nothing_to_draw() -> None:
    assert real("block", "--pictures", "out").returncode == 2


def test_settings_that_are_others_are_told(tmp_path: Path) -> None:
    (tmp_path / "tag_detections.bag.bz2").write_bytes(bz2.compress(b""))
    (tmp_path / "cameras.yaml").write_text("cam0: {intrinsics: [1, 2]}")
    (tmp_path / "tagslam.yaml").write_text("bodies: []")
    with pytest.raises(DataError, match=r"cameras\.yaml"):
        read_block(tmp_path)


def test_no_values_have_no_quantile() -> None:
    assert np.isnan(quantiles([], 0.5, 0.95)).all()
    assert quantiles([1.0, 2.0, 3.0], 0.5) == [2.0]
