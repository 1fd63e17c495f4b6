"""Benchmarks on recordings of others: skipped without them, and clear about folders that hold something else."""

from __future__ import annotations

import bz2
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks.real import boxes
from benchmarks.real.__main__ import BENCHMARKS
from benchmarks.real.block import read_block
from benchmarks.real.recordings import DataError, RealBenchmark, quantiles
from benchmarks.real.tags import LENS
from dsr.math3d.transforms import looking_at


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


def test_a_box_on_a_table_is_measured(tmp_path: Path) -> None:
    camera = looking_at((-0.9, 0.0, 0.5), (0.1, 0.0, 0.1))
    v, u = np.mgrid[0:540, 0:960]
    rays = LENS.rays(np.column_stack([u.ravel(), v.ravel()]).astype(float)) @ camera.rotation_matrix.T
    eye = camera.translation
    low, high = np.array([0.0, -0.2, 0.0]), np.array([0.06, 0.2, 0.3])
    with np.errstate(divide="ignore"):
        ends = np.stack([(low - eye) / rays, (high - eye) / rays])
    enter, leave = ends.min(axis=0).max(axis=1), ends.max(axis=0).min(axis=1)
    table = np.where(rays[:, 2] < 0.0, -eye[2] / np.minimum(rays[:, 2], -1e-9), 0.0)
    table[np.abs(eye[1] + table * rays[:, 1]) > 0.6] = 0.0
    depth = np.where((enter < leave) & (enter > 0.0), enter, table).reshape(540, 960)
    depth += np.random.default_rng(0).normal(0.0, 0.001, depth.shape) * (depth > 0.0)
    on_box = ((enter < leave) & (enter > 0.0)).reshape(540, 960)
    picture = np.where(on_box[..., None], np.array([40, 60, 200], np.uint8), np.array([160, 170, 165], np.uint8))
    cv2.imwrite(str(tmp_path / "rgb_1.png"), picture)
    cv2.imwrite(str(tmp_path / "depth_1.png"), np.round(np.clip(depth, 0.0, 5.0) * 1000).astype(np.uint16))
    figures = boxes.run(tmp_path).figures
    assert (figures["different"], figures["used"]) == (1, 1)
    assert figures["methods"]["ours"]["width_m"] == pytest.approx(0.4, abs=0.01)
    assert figures["methods"]["ours"]["height_m"] == pytest.approx(0.3, abs=0.01)
    ((name, drawn),) = boxes.draw(tmp_path)
    rows, columns = np.nonzero((drawn[..., 1] < 100) & (drawn[..., 0] > 150) & (drawn[..., 2] > 150))  # magenta
    true_rows, true_columns = np.nonzero(on_box)
    assert name == "rgb_1.png"
    assert (rows.min(), rows.max()) == pytest.approx((true_rows.min(), true_rows.max()), abs=4)
    assert (columns.min(), columns.max()) == pytest.approx((true_columns.min(), true_columns.max()), abs=4)


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
